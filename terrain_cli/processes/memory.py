"""How much memory there is, and the return of freed memory to the system."""

from __future__ import annotations

import os
from contextlib import suppress
from functools import cache
from pathlib import Path

import numpy as np

#: In bytes: a little less than the largest piece whose size the C library of Linux learns from.
_LARGE = 31 * 2**20
#: Where Linux says what a container may take, in bytes, or "max".
_CONTAINER = Path("/sys/fs/cgroup/memory.max")
#: Of the memory that the columns of a log may take. With all that is made of them `estimate --segments none`
#: took 3.8 times as much as seven columns, 4.6 times as much as four (2 and 33 million rows), and 6.7 times
#: with `--samples`.
_SHARE = 8
#: Bytes of a machine that does not say how many it has.
_UNKNOWN = 8 << 30


@cache
def most_held() -> int:
    """Return how many bytes the columns of a log may have that are held whole.

    A share of the memory of this machine, of the container, or of what ``ulimit -v`` leaves, whichever is
    least.
    """
    limits = []
    with suppress(OSError, ValueError, AttributeError):
        limits.append(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    with suppress(OSError, ValueError):
        limits.append(int(_CONTAINER.read_text()))
    with suppress(ImportError):
        from resource import RLIM_INFINITY, RLIMIT_AS, getrlimit

        limits += [limit for limit in getrlimit(RLIMIT_AS)[:1] if limit != RLIM_INFINITY]
    return min(limits, default=_UNKNOWN) // _SHARE


@cache
def keep_freed() -> None:
    """Keep memory that is freed for the next arrays, instead of asking the operating system every time.

    Pages that come from there are cleared first, which took a third of the time of a fit. The C library
    of Linux keeps pieces as large as the largest that was freed so far (mallopt(3), M_MMAP_THRESHOLD),
    and up to twice as much of what lies at the end; nothing is ever written to this one. Elsewhere it
    does nothing.
    """
    np.empty(_LARGE, dtype=np.uint8)
