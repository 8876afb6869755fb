from __future__ import annotations

import pytest

from terrain_cli.presentation import summary


@pytest.mark.parametrize(
    ("counts", "shown"),
    [({"ok": 3}, "ok"), ({"at-bound": 1}, "at-bound"), ({"ok": 2, "at-bound": 1}, "2 ok, 1 at-bound")],
)
def test_a_terrain_says_of_which_status_its_windows_are(counts, shown):
    pooled = dict.fromkeys(summary._SHOWN)
    entry = {"terrain": "sand", "wheel": "front", "segments": 3, "separable": 3, "samples": 9}
    head, row = summary._terrain_rows([{**entry, "distance_m": None, "status": counts, "pooled": pooled}])
    assert row[head.index("status")] == shown
