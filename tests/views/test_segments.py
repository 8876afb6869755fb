"""The table of segments as pictures use it."""

from __future__ import annotations

import numpy as np
import pytest

from terrain_cli.views import shown_segments


def table(**columns):
    n = len(next(iter(columns.values())))
    base = {
        "source": ["run.csv"] * n,
        "wheel": ["wheel"] * n,
        "segment": np.arange(1, n + 1),
        "terrain": [""] * n,
        "longitude_deg": np.full(n, np.nan),
    }
    return {**base, **columns}


def test_names_say_no_more_than_is_needed():
    assert shown_segments.names(table(segment=np.array([1, 2]))) == ["1", "2"]
    assert shown_segments.names(table(wheel=["a", "b"])) == ["a 1", "b 2"]
    assert shown_segments.names(table(source=["x", "y"], wheel=["a", "b"])) == ["x a 1", "y b 2"]


def test_groups_are_terrains_else_wheels_else_all():
    assert shown_segments.groups(table(terrain=["sand", ""]), 7) == ["sand", "not labelled"]
    assert shown_segments.groups(table(wheel=["a", "b"]), 7) == ["a", "b"]
    assert shown_segments.groups(table(wheel=["a", "b", "c"]), 2) == ["all segments"] * 3


def test_paths_are_read_as_they_were_written():
    lines, dot, nowhere = shown_segments.paths(
        table(WKT=["LINESTRING (1.5 -2.0, 3.0 4e-05)", "POINT (7.0 8.0)", ""])
    )
    np.testing.assert_array_equal(lines, [[1.5, -2.0], [3.0, 4e-5]])
    np.testing.assert_array_equal(dot, [[7.0, 8.0]])
    assert nowhere.shape == (0, 2)


def test_ellipse_holds_95_per_cent():
    one = table(c_kPa=[1.0], c_se_kPa=[0.5], phi_deg=[30.0], phi_se_deg=[3.0], corr_c_phi=[-0.8])
    outline = shown_segments.ellipse(one, 0, 400)
    covariance = np.array([[0.25, -1.2], [-1.2, 9.0]])
    away = outline - [1.0, 30.0]
    distance = np.einsum("ni,ij,nj->n", away, np.linalg.inv(covariance), away)
    # The 95 % quantile of χ² with two degrees of freedom.
    np.testing.assert_allclose(distance, 5.991, rtol=1e-3)


#: 3° in tan φ at 30°.
SLOPE_SE = np.radians(3.0) / np.cos(np.radians(30.0)) ** 2


def test_strength_is_surest_at_the_pivot():
    one = table(
        c_kPa=[1.0],
        c_se_kPa=[np.hypot(0.2, 10.0 * SLOPE_SE)],
        phi_deg=[30.0],
        phi_se_deg=[3.0],
        corr_c_phi=[-10.0 * SLOPE_SE / np.hypot(0.2, 10.0 * SLOPE_SE)],
    )
    stress = np.array([0.0, 10.0, 20.0])
    value, error = shown_segments.strength(one, 0, stress)
    np.testing.assert_allclose(value, 1.0 + stress * np.tan(np.radians(30.0)))
    assert error[1] == pytest.approx(0.2)
    assert error[0] == pytest.approx(error[2])
    # The derivative of tan φ against a difference.
    slope = (np.tan(np.radians(30.1)) - np.tan(np.radians(29.9))) / 0.2
    assert error[0] == pytest.approx(np.hypot(0.2, 10.0 * 3.0 * slope), rel=1e-4)


def test_limits_show_what_is_sure_and_not_what_is_wild():
    n = 101
    c, phi = shown_segments.estimate_limits(
        table(
            c_kPa=np.append(np.ones(n - 1), 500.0),
            c_se_kPa=np.full(n, 0.1),
            phi_deg=np.full(n, 30.0),
            phi_se_deg=np.full(n, 1.0),
            status=["ok"] * (n - 1) + ["not-separable"],
        )
    )
    assert c[0] < 1.0 - 2.4477 * 0.1
    assert 1.0 + 2.4477 * 0.1 < c[1] < 5.0
    assert phi[0] < 30.0 - 2.4 < 30.0 + 2.4 < phi[1]


def test_limits_show_every_soil_that_is_known():
    """One soil far from the others was outside, though the page had marked it."""
    several = table(
        c_kPa=[0.3, 0.35, 0.4, 0.45, 2.65],
        c_se_kPa=[0.1] * 5,
        phi_deg=[26.0, 26.5, 27.0, 27.5, 39.0],
        phi_se_deg=[0.3] * 5,
        status=["ok"] * 5,
    )
    c, phi = shown_segments.estimate_limits(several)
    assert c[1] > 2.65 + 2.4477 * 0.1
    assert phi[1] > 39.0 + 2.4477 * 0.3


def test_map_of_longitudes_is_stretched_by_latitude():
    one = table(longitude_deg=[1.0])
    *_, stretch = shown_segments.frame(one, np.array([[1.0, 60.0], [1.1, 60.0]]))
    assert stretch == pytest.approx(2.0)
    across, up, stretch = shown_segments.frame(table(x=[1.0]), np.array([[0.0, 0.0], [9.0, 0.0]]))
    assert stretch == 1.0
    assert (up[1] - up[0]) >= (across[1] - across[0]) / 3.0 * 0.999


def test_regions_are_seen_whole_where_nothing_is_separated():
    """One test rig at one load: φ ± 12° is the answer, not a point in an empty picture."""
    table = {
        "c_kPa": [1.4],
        "c_se_kPa": [3.1],
        "phi_deg": [27.0],
        "phi_se_deg": [12.0],
        "corr_c_phi": [-0.9],
        "status": ["not-separable"],
    }
    (c_low, c_high), (phi_low, phi_high) = shown_segments.estimate_limits(table)
    c, phi = shown_segments.ellipse(table, 0).T
    assert c_low < c.min() < c.max() < c_high
    assert phi_low < phi.min() < phi.max() < phi_high
    # Errors beyond all measure do not make the picture one line.
    wide = shown_segments.estimate_limits({**table, "c_se_kPa": [1e9], "phi_se_deg": [1e9]})
    assert wide[0][1] - wide[0][0] < 50.0
    assert wide[1][1] - wide[1][0] < 300.0
