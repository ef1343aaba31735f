"""Tests, effect sizes and profiles against scipy and published examples."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from auvbench.statistics import (
    holm,
    mcnemar,
)


def test_mcnemar_of_agrestis_voters():
    # Agresti, Categorical Data Analysis, 1600 voters: 150 approve only first, 86 only then; z = -4.17.
    assert mcnemar(150, 86) == pytest.approx(2 * stats.norm.sf(64 / np.sqrt(236)), rel=0.1)


def test_mcnemar_of_fagerlands_example():
    # Fagerland et al. (2013), airway hyper-responsiveness before and after: mid-p 0.039.
    assert mcnemar(1, 7) == pytest.approx(0.039, abs=5e-4)


@given(st.integers(0, 60), st.integers(0, 60))
def test_mcnemar_agrees_with_the_binomial_test(b, c):
    assert mcnemar(b, c) == mcnemar(c, b)
    n, k = b + c, min(b, c)
    mid = min(1.0, 2 * (stats.binom.cdf(k - 1, n, 0.5) + stats.binom.pmf(k, n, 0.5) / 2))
    assert mcnemar(b, c) == pytest.approx(mid)


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
