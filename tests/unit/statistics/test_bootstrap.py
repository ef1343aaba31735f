"""The bootstrap against scipy, published examples and its own definition."""

import numpy as np
import pytest
from scipy import stats

from auvbench.statistics import (
    bca,
    hierarchical,
    iqm,
    mean,
    median,
    multiplicities,
    paired_means,
    percentile,
    seed_weights,
)

# Efron & Tibshirani (1993), An Introduction to the Bootstrap: table 2.1 (mouse data, treatment) and table 14.1
# (spatial test data, A).
MOUSE = np.array([94.0, 197, 16, 38, 99, 141, 23])
SPATIAL = np.array(
    [48, 36, 20, 29, 42, 42, 20, 42, 22, 41, 45, 14, 6, 0, 33, 28, 34, 4, 32, 24, 47, 41, 24, 26, 30, 41.0]
)


def variance(values, axis=-1):
    return np.asarray(np.var(values, axis=axis))


def test_iqm_is_the_mean_of_the_middle_half():
    rng = np.random.default_rng(0)
    for n in (4, 5, 7, 8, 100, 101):
        x = rng.normal(size=n)
        cut = n // 4
        assert iqm(x) == pytest.approx(np.sort(x)[cut : n - cut].mean())
    assert iqm(rng.normal(size=(3, 8)), -1).shape == (3,)


def test_standard_error_of_the_mouse_data():
    # Efron & Tibshirani, table 2.2: ideal bootstrap standard error of the mean, B = infinity, 23.36.
    weights = multiplicities(7, 20000, np.random.default_rng(1))
    means = paired_means([MOUSE[None]], weights, [seed_weights(1, 20000, np.random.default_rng(2))])
    assert means.std() == pytest.approx(23.36, abs=4 * 23.36 / np.sqrt(2 * 20000))


def test_bca_and_percentile_of_the_spatial_data():
    # Efron & Tibshirani, table 14.2, 90 % intervals of the variance with 2000 resamples: percentile (100.8, 233.9),
    # BCa (115.8, 259.6), estimate 171.5. Theirs and ours both vary with the resamples, by about 2 at the ends.
    assert variance(SPATIAL) == pytest.approx(171.5, abs=0.05)
    rng = np.random.default_rng(3)
    low, high = percentile(SPATIAL, variance, confidence=0.9, resamples=20000, rng=rng)
    assert (low, high) == pytest.approx((100.8, 233.9), abs=5)
    low, high = bca(SPATIAL, variance, confidence=0.9, resamples=20000, rng=rng)
    assert (low, high) == pytest.approx((115.8, 259.6), abs=6)


@pytest.mark.parametrize("statistic", [mean, median, iqm, variance])
@pytest.mark.parametrize(("method", "ours"), [("percentile", percentile), ("BCa", bca)])
def test_agrees_with_scipy(statistic, method, ours):
    x = np.random.default_rng(4).gamma(2, 100, size=41)
    theirs = stats.bootstrap(
        (x,),
        lambda v, axis: statistic(v, axis),
        n_resamples=8000,
        method=method,
        rng=np.random.default_rng(5),
    ).confidence_interval
    found = ours(x, statistic, resamples=8000, rng=np.random.default_rng(6))
    spread = theirs.high - theirs.low
    assert found == pytest.approx((theirs.low, theirs.high), abs=0.06 * spread)


def test_bca_of_a_constant_is_the_constant():
    assert bca(np.full(9, 3.0), rng=np.random.default_rng(0)) == (3.0, 3.0)
    with pytest.raises(ValueError, match="2 values"):
        bca(np.ones(1), rng=np.random.default_rng(0))


def test_same_generator_same_interval():
    first, again = (bca(MOUSE, rng=np.random.default_rng(7)) for _ in range(2))
    assert first == again


def test_multiplicities_count_draws():
    m = multiplicities(5, 3000, np.random.default_rng(8))
    assert (m.sum(axis=1) == 5).all()
    assert m.mean(axis=0) == pytest.approx(np.ones(5), abs=4 * np.sqrt(0.8 / 3000))


@pytest.mark.parametrize("S", [2, 3, 8])
def test_rescaled_seed_weights_have_the_unbiased_variance(S):
    y = np.random.default_rng(9).normal(size=S)
    B = 40000
    for rescaled, expected in ((True, y.var(ddof=1) / S), (False, y.var(ddof=0) / S)):
        weights = seed_weights(S, B, np.random.default_rng(10), rescaled=rescaled)
        assert np.allclose(weights.sum(axis=1), 1)
        assert (weights @ y).var() == pytest.approx(expected, rel=0.05)


def test_paired_means_are_the_means_of_the_resampled_arrays():
    rng = np.random.default_rng(11)
    data = [rng.normal(size=(3, 6)), rng.normal(size=(1, 6)), rng.normal(size=(2, 6))]
    data[0][:, 2] = np.nan
    columns = rng.integers(6, size=(5, 6))
    scenarios = np.array([np.bincount(c, minlength=6) for c in columns], dtype=float)
    picks = [rng.integers(len(x), size=(5, len(x))) for x in data]
    seeds = [
        np.array([np.bincount(p, minlength=len(x)) / len(x) for p in pick])
        for x, pick in zip(data, picks, strict=True)
    ]
    found = paired_means(data, scenarios, seeds)
    for b in range(5):
        for i, x in enumerate(data):
            assert found[b, i] == pytest.approx(np.nanmean(x[picks[i][b]][:, columns[b]]))


def test_equal_agents_never_differ_when_paired():
    x = np.random.default_rng(12).normal(size=(1, 30))
    found = paired_means([x, x], multiplicities(30, 100, np.random.default_rng(0)), [np.ones((100, 1))] * 2)
    assert (found[:, 0] == found[:, 1]).all()


def test_hierarchical_with_one_seed_is_the_percentile_bootstrap():
    x = np.random.default_rng(13).gamma(2, 1, size=(1, 60))
    low, high = hierarchical(x, iqm, resamples=4000, rng=np.random.default_rng(14))
    one = percentile(x[0], iqm, resamples=4000, rng=np.random.default_rng(15))
    assert (low, high) == pytest.approx(one, abs=0.06 * (high - low))


def test_hierarchical_sees_the_seeds():
    rng = np.random.default_rng(16)
    x = rng.normal(size=(5, 200)) + 3 * rng.normal(size=(5, 1))
    low, high = hierarchical(x, resamples=3000, rng=rng)
    expected = 2 * 1.96 * np.sqrt(x.mean(axis=1).var(ddof=1) / 5)
    assert high - low == pytest.approx(expected, rel=0.15)
