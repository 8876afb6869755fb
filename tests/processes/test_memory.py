"""Memory that is freed and used again."""

import platform
import subprocess
import sys

import pytest

CYCLES = """
import resource, sys
import numpy as np
from terrain_cli.processes.memory import keep_freed

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


HELD = """
import resource, sys
limit = int(sys.argv[1])
if limit:
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
from terrain_cli.processes.memory import most_held
print(most_held())
"""


@pytest.mark.skipif(sys.platform != "linux", reason="other systems limit memory in other ways")
def test_what_may_be_held_follows_the_limit_of_the_shell():
    free, limited = (
        int(subprocess.run([sys.executable, "-c", HELD, limit], capture_output=True, check=True).stdout)
        for limit in ("0", str(2 << 30))
    )
    assert limited == (2 << 30) // 8
    assert free >= limited
