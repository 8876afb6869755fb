"""What becomes of memory that arrays leave behind."""

from __future__ import annotations

from functools import cache

import numpy as np

#: In bytes: a little less than the largest piece whose size the C library of Linux learns from.
_LARGE = 31 * 2**20


@cache
def keep_freed() -> None:
    """Keep memory that is freed for the next arrays, instead of asking the operating system every time.

    Pages that come from there are cleared first, which took a third of the time of a fit. The C library
    of Linux keeps pieces as large as the largest that was freed so far (mallopt(3), M_MMAP_THRESHOLD),
    and up to twice as much of what lies at the end; nothing is ever written to this one. Elsewhere it
    does nothing.
    """
    np.empty(_LARGE, dtype=np.uint8)
