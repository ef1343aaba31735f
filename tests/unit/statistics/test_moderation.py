"""Borrowing strength between agents: right where they agree, harmless where they do not."""

import numpy as np
import pytest
from scipy.special import digamma

from auvbench.statistics import crossed
from benchmarks.statistics.moderation import ENOUGH_AGENTS, moderated, prior


@pytest.mark.parametrize(("f0", "d0"), [(1.0, 4.0), (7.0, 20.0)])
def test_the_prior_is_found_again(f0, d0):
    """Ratios drawn by Smyth's model: F = F0 d0/chi2(d0) chi2(d)/d."""
    rng, n, d = np.random.default_rng(0), 40000, 2.0
    ratio = f0 * d0 / rng.chisquare(d0, n) * rng.chisquare(d, n) / d
    found_f0, found_d0 = prior(ratio, np.full(n, d))
    assert found_f0 == pytest.approx(f0, rel=0.05)
    assert found_d0 == pytest.approx(d0, rel=0.25)


def test_equal_variances_have_an_infinite_prior():
    rng, d = np.random.default_rng(1), np.full(12, 2.0)
    # Less spread than chance would give: nothing says that the agents differ.
    ratio = 3.0 * np.exp(rng.normal(0, 0.3, 12) + digamma(1.0))
    f0, d0 = prior(ratio, d)
    assert np.isinf(d0)
    assert f0 == pytest.approx(3.0, rel=0.3)


def table(seed_sds, S=3, E=200):
    rng = np.random.default_rng(2)
    hard = rng.normal(size=E)
    return crossed([sd * rng.normal(size=(S, 1)) + hard + rng.normal(size=(S, E)) for sd in seed_sds])


def test_never_less_variance_and_more_freedom():
    plain = table([0.5] * 10)
    found = moderated(plain)
    assert (found.between_seeds >= plain.between_seeds).all()
    assert (found.between_seeds > plain.between_seeds).any()
    assert (found.seeds_df > 2).all()
    assert (found.mean == plain.mean).all()


def test_agents_that_disagree_lend_little():
    agree, differ = moderated(table([0.5] * 12)), moderated(table([0.01, 5.0] * 6))
    assert np.median(differ.seeds_df) < np.median(agree.seeds_df)
    assert np.median(differ.seeds_df) < 4


def test_few_agents_and_single_seeds_are_left_alone():
    few = table([0.5] * (ENOUGH_AGENTS - 1))
    assert moderated(few) is few
    rng = np.random.default_rng(3)
    mixed = crossed(
        [rng.normal(size=(3, 50)) + rng.normal(size=(3, 1)) for _ in range(6)] + [rng.normal(size=(1, 50))]
    )
    found = moderated(mixed)
    assert found.between_seeds[-1] == 0
    assert np.isinf(found.seeds_df[-1])
    assert (found.seeds_df[:-1] > 2).all()


def test_an_agent_without_failures_borrows_too():
    rng = np.random.default_rng(4)
    data = [(rng.random((3, 100)) < p).astype(float) for p in (0.4, 0.5, 0.6, 0.7, 0.8)] + [np.ones((3, 100))]
    found = moderated(crossed(data, rate=True))
    assert found.between_seeds[-1] > 0
    assert found.seeds_df[-1] == found.seeds_df[0]
