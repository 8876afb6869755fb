"""A pass, and a soil that varies along the drive, which a few passes follow by chance."""

from __future__ import annotations

import pytest
from hidden_drives import Kind, sized, windows_of

from terrain_cli.diagnosis import diagnose
from terrain_cli.models import ModelFile


@pytest.mark.parametrize(
    ("seed", "kind", "verdict", "family"),
    [
        pytest.param(78_997_038, Kind(noise="soil-unlabelled"), "none", (), id="the soil varies"),
        # To first order what a pass leaves lasts as well; fitted, it leaves noise.
        pytest.param(78_998_005, Kind(effects=sized("multi-pass")), "effect", ("multi-pass",), id="a pass"),
    ],
)
def test_where_what_a_pass_leaves_lasts_no_pass_is_tested(seed, kind, verdict, family):
    found = diagnose(windows_of(seed, kind), ModelFile())
    assert (found.verdict, found.family) == (verdict, family)
    untested = [one.because for one in found.not_testable if one.effect == "multi-pass"]
    assert [because.startswith("the soil changes along this drive") for because in untested] == [True] * (
        not family
    )
