"""Tails of distributions, beside those of scipy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import special

from terrain_cli.comparison import distributions

FREEDOM = st.floats(1.0, 5000.0)


@given(t=st.floats(-1e4, 1e4), freedom=FREEDOM)
def test_student_is_that_of_scipy(t, freedom):
    expected = special.stdtr(freedom, -t)
    assert distributions.student_tail(t, freedom) == pytest.approx(expected, rel=1e-10, abs=1e-300)


def test_student_takes_many():
    t = np.array([[0.0, 1.0], [3.0, 40.0]])
    np.testing.assert_allclose(distributions.student_tail(t, 7.5), special.stdtr(7.5, -t), rtol=1e-12)


@given(share=st.floats(1e-6, 0.49), freedom=FREEDOM)
def test_student_quantile_is_that_of_scipy(share, freedom):
    expected = special.stdtrit(freedom, 1.0 - share)
    assert distributions.student_quantile(share, freedom) == pytest.approx(expected, rel=1e-8)


@given(value=st.floats(0.0, 600.0), freedom=st.integers(1, 80))
def test_chi_squared_is_that_of_scipy(value, freedom):
    expected = special.chdtrc(freedom, value)
    assert distributions.chi_squared_tail(value, freedom) == pytest.approx(expected, rel=1e-11, abs=1e-300)


def test_normal_is_that_of_scipy():
    z = np.linspace(-9.0, 9.0, 61).reshape(1, -1)
    np.testing.assert_allclose(distributions.normal_tail(z), special.ndtr(-z), rtol=1e-12)
