"""Memory that is freed and used again."""

import platform
import subprocess
import sys

import pytest

CYCLES = """
import resource, sys
import numpy as np
from terrain_cli.memory import keep_freed

if sys.argv[1:] == ["kept"]:
    keep_freed()
begin = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(20):
    arrays = [np.ones(2**17) for _ in range(8)]
    del arrays
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - begin)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="other C libraries keep memory as they like")
def test_pages_are_asked_for_once():
    every, kept = (
        int(
            subprocess.run(
                [sys.executable, "-c", CYCLES, *arguments], capture_output=True, text=True, check=True
            ).stdout
        )
        for arguments in ([], ["kept"])
    )
    # In each of 20 cycles, or in the first alone.
    assert kept < every / 4
