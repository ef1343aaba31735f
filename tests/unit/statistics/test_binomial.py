"""Probabilities from few trials, against scipy and by their own definition."""

import numpy as np
import pytest
from scipy import stats

from auvbench.statistics import limits, p_more_than_half, succeeded, trials_that_bound


@pytest.mark.parametrize(("k", "n"), [(0, 5), (3, 5), (5, 5), (17, 40)])
def test_limits_are_scipys(k, n):
    exact = stats.binomtest(k, n).proportion_ci(0.9, method="exact")
    assert limits(k, n, 0.05) == pytest.approx((exact.low, exact.high))


@pytest.mark.parametrize("rate", [0.5, 0.1, 0.05, 0.003])
@pytest.mark.parametrize("confidence", [0.8, 0.95, 0.999])
def test_so_many_trials_without_a_failure_bound_the_rate_and_one_fewer_does_not(rate, confidence):
    n = trials_that_bound(rate, confidence)
    assert limits(0, n, 1 - confidence)[1] <= rate
    assert limits(0, n - 1, 1 - confidence)[1] > rate


def test_a_training_succeeds_with_half_of_the_episodes():
    success = np.array([[1, 1, 0, 0], [1, 0, 0, 0], [1, 1, 1, 1]], dtype=float)
    assert succeeded(success) == 2


def test_p_of_more_than_half_is_scipys():
    for k in range(7):
        expected = stats.binomtest(k, 6, alternative="greater").pvalue
        assert p_more_than_half(k, 6) == pytest.approx(expected)
