"""The variance between seeds that every verdict uses: its values, and that no verdict depends on a third row."""

from dataclasses import replace

import numpy as np
import pytest

from auvbench.analysis.measures import measure
from auvbench.statistics import contrast, crossed, pairs, resolution
from auvbench.statistics.differences import PRIOR_DF, RATIO_OF_MEANS, RATIO_OF_RATES, freedom, seed_variance
from benchmarks.statistics.alternatives import ALTERNATIVES
from benchmarks.statistics.shipped import shipped
from benchmarks.statistics.worlds import World


def agents(sds, S=5, E=80, seed=0):
    rng = np.random.default_rng(seed)
    hard = rng.normal(size=E)
    return [World(1.5, sd).draw(S, E, hard, rng)[0] for sd in sds]


@pytest.mark.parametrize(("rate", "ratio"), [(True, RATIO_OF_RATES), (False, RATIO_OF_MEANS)])
def test_a_variance_is_squeezed_towards_the_prior_but_never_shrunk(rate, ratio):
    data = agents([0.0, 0.3, 3.0])
    table = crossed(data, rate=rate)
    variance, df = seed_variance(table)
    residual = []
    for x in data:
        rest = x - x.mean(axis=1, keepdims=True) - x.mean(axis=0) + x.mean()
        residual.append((rest**2).sum() / (4 * 79))
    own = np.array([x.mean(axis=1).var(ddof=1) for x in data])
    expected = (PRIOR_DF * ratio**2 * np.array(residual) + 4 * own) / (PRIOR_DF + 4)
    assert variance == pytest.approx(np.maximum(expected, own) / 5)
    assert (variance > own / 5).any()
    assert variance[2] == pytest.approx(own[2] / 5), "an outlier keeps its own"
    assert df == pytest.approx(4 + 1 / (1 / 3 + 1 / 4))


def test_the_prior_adds_less_freedom_than_the_seeds_have():
    df = np.array([1.0, 2.0, 4.0, 9.0, 1000.0])
    added = freedom(df) - df
    assert (added < np.minimum(df, PRIOR_DF)).all()
    assert (np.diff(added) > 0).all()
    assert np.isinf(freedom(np.array([np.inf]))).all()


def test_one_seed_has_no_variance_between_seeds():
    table = crossed([*agents([0.3, 0.3]), agents([0.3], S=1)[0]], rate=True)
    variance, df = seed_variance(table)
    assert variance[2] == 0
    assert np.isinf(df[2])


def test_squeezed_variances_reach_intervals_and_contrasts():
    table = crossed(agents([0.0, 0.0]))
    own = replace(table, residual=np.zeros(2))
    assert (seed_variance(table)[0] > table.between_seeds).all()
    both, alone = (pairs(t).high[0, 1] - pairs(t).low[0, 1] for t in (table, own))
    weights = np.array([1.0, -1.0])
    wide, narrow = (contrast(t, weights)[0] for t in (table, own))
    assert both == pytest.approx(wide.high - wide.low)
    assert both != pytest.approx(alone)
    assert alone == pytest.approx(narrow.high - narrow.low)


@pytest.fixture(scope="module")
def studies():
    return shipped(("test", "gazebo"))


@pytest.mark.slow
def test_every_shipped_study_is_here(studies):
    assert {table.name.partition(",")[0] for table in studies} >= {"leaderboard", "thesis", "gazebo"}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["par1_steps", "success_rate"])
def test_a_verdict_does_not_depend_on_a_third_row(studies, name):
    """No p-value changes when any row of any shipped table is dropped."""
    m = measure(name)
    for table in studies:
        whole = resolution(table.on(m))
        for row in range(len(table.agents)):
            rest = np.delete(np.arange(len(whole)), row)
            assert resolution(table.on(m, row)) == pytest.approx(whole[np.ix_(rest, rest)], rel=1e-12), (
                table.name,
                table.agents[row].label,
            )


@pytest.mark.slow
def test_what_was_used_before_lost_verdicts(studies):
    table = next(table for table in studies if table.name.startswith("leaderboard"))
    m = measure("par1_steps")
    assert table.lost(m, ALTERNATIVES["fixed prior (used)"])[1] == 0
    assert table.lost(m, ALTERNATIVES["table's mean (before)"])[1] > 0
