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
        seeds=tuple(range(9)),
        episodes=40,
        train_episodes=20,
    )
    set_state([next(run for run in runs if run.name.startswith("ppo-k1-f25-s2"))], "failed", "loss is nan")
    for run in runs:  # one agent keeps a single seed
        if run.name.startswith("sac-k100-f25") and not run.name.startswith("sac-k100-f25-s0"):
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
    assert {agent.seeds for agent in recomputed} == {1, 9}


def test_order(ranking, recomputed):
    def place(agent):
        return -agent.success.mean(axis=1).median().round(12), agent.par1.mean(axis=1).median()

    order = sorted(recomputed, key=place)
    assert [row.label for row in ranking.rows] == [by_key(ranking, agent).label for agent in order]


@pytest.mark.parametrize(
    ("rank_by", "measure", "ends"),
    [("success_rate", "success", (0.0, 1.0)), ("par1_steps", "par1", (1.0, plain.LIMIT))],
)
def test_differences_and_verdicts(folder, recomputed, rank_by, measure, ends):
    ranking = rank(agents(load([folder])[0])[0], rank_by=rank_by)
    compared = {
        by_key(ranking, agent).label: agent for agent in recomputed if agent.seeds > 1 or not agent.learns
    }
    higher = measure == "success"
    found = {}
    for c in ranking.comparisons:
        d, low, high, p = plain.compare(compared[c.first], compared[c.second], measure, 0.05, *ends)
        found[c.first, c.second] = p
        assert (c.difference.value, c.difference.low, c.difference.high) == pytest.approx(
            (d, low, high), rel=1e-11, abs=1e-12
        )
        assert c.p_value == pytest.approx(p, rel=1e-5)
    assert len(found) == len(compared) * (len(compared) - 1) / 2
    adjusted = plain.holm(found)
    for c in ranking.comparisons:
        assert c.p_adjusted == pytest.approx(adjusted[c.first, c.second], rel=1e-5)
        ahead = (c.difference.value > 0) == higher
        expected = "undecided" if adjusted[c.first, c.second] >= 0.05 else "better" if ahead else "worse"
        assert c.verdict == expected
    assert any(c.verdict != "undecided" for c in ranking.comparisons)
    primary = ranking.primary
    baseline, level = compared[primary.baseline], 0.05 / (len(compared) - 1)
    margin = 0.02 if higher else 0.05 * float(baseline.par1.to_numpy().mean())
    assert primary.margin == pytest.approx(margin)
    decided = 0
    for against in primary.comparisons:
        if against.agent in compared:
            agent = compared[against.agent]
            d, low, high, p = plain.compare(agent, baseline, measure, level, *ends)
            if agent.seeds == 1 and p >= level:
                low, high = min(low, 0.0), max(high, 0.0)
            shown = against.difference
            assert (shown.value, shown.low, shown.high) == pytest.approx((d, low, high), rel=1e-11, abs=1e-12)
            decided += against.verdict != "open"
        if against.agent in compared and compared[against.agent].seeds > 1:
            value = float(getattr(baseline, measure).to_numpy().mean())
            r = against.reliability
            assert (r.count, r.low, r.high) == pytest.approx(
                plain.not_behind(getattr(agent, measure), value, margin, higher), rel=1e-9
            )
    assert decided
