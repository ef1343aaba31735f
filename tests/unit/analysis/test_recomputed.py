"""A report's numbers against an independent computation from the CSV files (tests/plain_statistics.py)."""

from pathlib import Path

import pytest

from auvbench.analysis.load import agents, load
from auvbench.analysis.ranking import rank
from tests import plain_statistics as plain
from tests.synthetic import set_state, write_experiment

EXACT = {"rel": 1e-12, "abs": 1e-15}


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    root = tmp_path_factory.mktemp("recomputed") / "grid"
    runs = write_experiment(
        root,
        algorithms=("ppo", "sac", "pid", "random"),
        reward_k=(1, 100),
        frequencies=(25,),
        seeds=(0, 1, 2),
        episodes=40,
        train_episodes=20,
    )
    set_state([next(run for run in runs if run.name.startswith("ppo-k1-f25-s2"))], "failed", "loss is nan")
    for run in runs:  # one agent keeps a single seed
        if run.name.startswith(("sac-k100-f25-s1", "sac-k100-f25-s2")):
            set_state([run], "interrupted")
    return root


@pytest.fixture(scope="module")
def ranking(folder):
    return rank(agents(load([folder])[0])[0])


@pytest.fixture(scope="module")
def recomputed(folder):
    return plain.read(folder)


def by_key(ranking, agent):
    return next(
        row
        for row in ranking.rows
        if str((row.key["algo"], row.key["reward.k"], row.key["step.frequency"])) == agent.name
    )


def test_rows(ranking, recomputed):
    assert len(ranking.rows) == len(recomputed) == 6
    for agent in recomputed:
        row = by_key(ranking, agent)
        assert len(row.seeds) == agent.seeds
        assert row.compared == (agent.seeds > 1 or not agent.learns)
        rate, steps = row.estimates["success_rate"], row.estimates["par1_steps"]
        assert rate.value == pytest.approx(agent.success.to_numpy().mean(), **EXACT)
        assert (rate.low, rate.high) == pytest.approx(plain.rate_interval(agent.success, 0.95), **EXACT)
        assert steps.value == pytest.approx(agent.par1.to_numpy().mean(), **EXACT)
        assert (steps.low, steps.high) == pytest.approx(
            plain.mean_interval(agent.par1, 0.95, 1.0, plain.LIMIT), **EXACT
        )
    assert {agent.seeds for agent in recomputed} == {1, 3}


def interval_of(intervals, name, first, second):
    pair = name[first], name[second]
    if pair in intervals:
        return intervals[pair]
    low, high = intervals[pair[::-1]]
    return -high, -low


def test_order(ranking, recomputed):
    order = sorted(recomputed, key=lambda a: (-a.success.to_numpy().mean(), a.par1.to_numpy().mean()))
    assert [row.label for row in ranking.rows] == [by_key(ranking, agent).label for agent in order]


@pytest.mark.parametrize(
    ("rank_by", "measure", "ends"),
    [("success_rate", "success", (0.0, 1.0)), ("par1_steps", "par1", (1.0, plain.LIMIT))],
)
def test_p_values_and_verdicts(folder, recomputed, rank_by, measure, ends):
    ranking = rank(agents(load([folder])[0])[0], rank_by=rank_by)
    compared = [agent for agent in recomputed if agent.seeds > 1 or not agent.learns]
    p = plain.resolution(compared, measure, *ends)
    adjusted = plain.holm(p)
    name = {agent.name: by_key(ranking, agent).label for agent in compared}
    back = {label: key for key, label in name.items()}
    mean = {name[agent.name]: getattr(agent, measure).to_numpy().mean() for agent in compared}
    intervals = plain.differences(compared, measure, 0.95, *ends)
    expected = {frozenset(name[x] for x in pair): (p[pair], adjusted[pair]) for pair in p}
    assert len(ranking.comparisons) == len(p)
    for c in ranking.comparisons:
        one, holm = expected[frozenset((c.first, c.second))]
        assert c.p_value == pytest.approx(one, **EXACT)
        assert c.p_adjusted == pytest.approx(holm, **EXACT)
        assert c.difference.value == pytest.approx(mean[c.first] - mean[c.second], rel=1e-12, abs=1e-12)
        low, high = interval_of(intervals, back, c.first, c.second)
        assert (c.difference.low, c.difference.high) == pytest.approx((low, high), rel=1e-12, abs=1e-12)
        ahead = (mean[c.first] > mean[c.second]) == (measure == "success")
        assert c.verdict == ("undecided" if holm >= 0.05 else "better" if ahead else "worse")
    assert any(c.verdict != "undecided" for c in ranking.comparisons)
    level = 0.05 / (len(compared) - 1)
    together = plain.differences(compared, measure, 1 - level, *ends)
    for against in ranking.primary.comparisons:
        if against.agent in back:
            baseline = ranking.primary.baseline
            low, high = interval_of(together, back, against.agent, baseline)
            if expected[frozenset((against.agent, baseline))][0] >= level:
                low, high = min(low, 0.0), max(high, 0.0)
            found = against.difference
            assert (found.low, found.high) == pytest.approx((low, high), rel=1e-11, abs=1e-11)
