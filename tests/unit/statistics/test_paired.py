"""Tests, effect sizes and profiles against scipy and published examples."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from auvbench.statistics import (
    discordant,
    holm,
    improvement,
    improvement_matrix,
    mcnemar,
    probability_of_improvement,
    score,
    wilson,
    wins,
)


def test_mcnemar_of_agrestis_voters():
    # Agresti, Categorical Data Analysis, 1600 voters: 150 approve only first, 86 only then; z = -4.17.
    exact = mcnemar(150, 86, mid=False)
    assert exact == pytest.approx(stats.binomtest(86, 236).pvalue)
    assert mcnemar(150, 86) == pytest.approx(2 * stats.norm.sf(64 / np.sqrt(236)), rel=0.1)


def test_mcnemar_of_fagerlands_example():
    # Fagerland et al. (2013), airway hyper-responsiveness before and after: exact 0.070, mid-p 0.039.
    assert mcnemar(1, 7, mid=False) == pytest.approx(0.070, abs=5e-4)
    assert mcnemar(1, 7) == pytest.approx(0.039, abs=5e-4)


@given(st.integers(0, 60), st.integers(0, 60))
def test_mcnemar_agrees_with_the_binomial_test(b, c):
    exact = stats.binomtest(b, b + c).pvalue if b + c else 1.0
    assert mcnemar(b, c, mid=False) == pytest.approx(exact)
    assert mcnemar(b, c) == mcnemar(c, b)
    n, k = b + c, min(b, c)
    mid = min(1.0, 2 * (stats.binom.cdf(k - 1, n, 0.5) + stats.binom.pmf(k, n, 0.5) / 2))
    assert mcnemar(b, c) == pytest.approx(mid)


def test_discordant_counts():
    x = np.array([[1.0, 1, 0, 0], [1, 0, 1, 0], [0, 0, 0, 0]])
    assert discordant(x).tolist() == [[0, 1, 2], [1, 0, 2], [0, 0, 0]]


@given(st.lists(st.floats(0, 1), min_size=1, max_size=6))
def test_holm_is_the_closure_of_bonferroni(p):
    """A hypothesis is rejected if every set of hypotheses with it is, by Bonferroni: Marcus, Peritz & Gabriel 1976."""
    n = len(p)
    for i, adjusted in enumerate(holm(p)):
        sets = [s for size in range(1, n + 1) for s in combinations(range(n), size) if i in s]
        assert adjusted == pytest.approx(max(min(1.0, len(s) * min(p[j] for j in s)) for s in sets))


def test_holm_leaves_out_what_was_not_tested():
    assert holm([0.03, np.nan, 0.02])[[0, 2]].tolist() == [0.04, 0.04]
    assert np.isnan(holm([0.03, np.nan])[1])
    assert holm([]).shape == (0,)


def test_probability_of_improvement_is_mann_whitneys_u():
    rng = np.random.default_rng(0)
    x, y = rng.integers(0, 9, 30), rng.integers(2, 11, 40)
    u = stats.mannwhitneyu(x, y).statistic
    assert probability_of_improvement(x, y) == pytest.approx(u / (30 * 40))


def test_wins_over_one_scenario_are_mann_whitneys_too():
    rng = np.random.default_rng(1)
    x, y = rng.integers(0, 5, (6, 1)).astype(float), rng.integers(0, 5, (8, 1)).astype(float)
    assert wins(x, y).mean() == pytest.approx(probability_of_improvement(x, y))


def test_the_matrix_holds_the_means_of_wins():
    rng = np.random.default_rng(2)
    scores = [rng.integers(0, 6, (S, 40)).astype(float) for S in (3, 1, 2)]
    scores[0][0, :5] = -np.inf
    scores[1][0, 3:9] = -np.inf
    matrix = improvement_matrix(scores)
    for i in range(3):
        assert matrix[i, i] == 0.5
        for j in set(range(3)) - {i}:
            assert matrix[i, j] == pytest.approx(wins(scores[i], scores[j]).mean())
            assert matrix[i, j] + matrix[j, i] == pytest.approx(1)


def test_improvement_of_single_seeds_without_ties_is_wilsons_interval():
    x = np.array([[1.0] * 30 + [0.0] * 10])
    found = improvement(x, 1 - x)
    assert found.value == 0.75
    low, high = wilson(30, 40)
    # The variance between 40 scenarios is over 39.
    assert (found.low, found.high) == pytest.approx((float(low), float(high)), abs=0.003)


def test_improvement_is_never_certain():
    found = improvement(np.ones((1, 40)), np.zeros((1, 40)))
    assert found.value == found.high == 1
    assert found.low == pytest.approx(float(wilson(40, 40)[0]))
    assert improvement(np.ones((3, 40)), np.zeros((3, 40))).low < 1


def test_improvement_covers_its_truth():
    """Two normal agents with seeds and shared scenarios; the truth is that of a normal difference."""
    rng, hits, n = np.random.default_rng(3), 0, 600
    truth = stats.norm.cdf(0.5 / np.sqrt(2 * 0.5**2 + 2))
    for _ in range(n):
        hard = rng.normal(size=50)
        x, y = (m + 0.5 * rng.normal(size=(3, 1)) + hard + rng.normal(size=(3, 50)) for m in (0.5, 0.0))
        found = improvement(x, y)
        hits += found.low <= truth <= found.high
    # Cautious by design, never short: at least 0.95 less 3.5 standard errors.
    assert hits / n > 0.95 - 3.5 * np.sqrt(0.95 * 0.05 / n)


def test_score_orders_success_first_then_quickness():
    good = np.array([True, True, False, False, True])
    quick = score(good, -np.array([10.0, 20.0, 1.0, 1000.0, np.nan]))
    assert quick[0] > quick[1] > quick[4] > quick[2]
    assert quick[2] == quick[3]
