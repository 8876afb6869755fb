import numpy as np
import pytest

from terrain_cli.vocabulary.arrays import median


@pytest.mark.parametrize("n", [1, 2, 3, 10, 1001, 60_000])
def test_the_median_is_that_of_numpy(n):
    values = np.random.default_rng(n).standard_normal(n)
    assert median(values) == np.median(values)
    assert np.isnan(median(np.append(values, np.nan)))
