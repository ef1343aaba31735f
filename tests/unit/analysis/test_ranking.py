"""The ranked table."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy import stats

from auvbench import metrics
from auvbench.analysis.measures import measure, measures
from auvbench.analysis.ranking import ALL_PAIRS, rank
from auvbench.errors import ReportError
from auvbench.statistics import EPISODES_ONLY, MIXED, SEEDS_AND_EPISODES, holm, mcnemar
from tests.unit.analysis.agents import agent

GRID = [
    agent("sac", 1, 25, level=3.5),
    agent("sac", 40, 25, level=3.2),
    agent("ppo", 1, 25, level=1.0),
    agent("ppo", 40, 25, level=-1.0),
    agent("pid", 1, 10, level=3.0, seeds=1),
]


@pytest.fixture(scope="module")
def ranking():
    return rank(GRID, baseline="pid")


def test_rows_are_in_the_order_of_the_typical_success_rate(ranking):
    by_label = {a.label: np.median(a.success.mean(axis=1)) for a in GRID}
    rates = [by_label[row.label] for row in ranking.rows]
    assert rates == sorted(rates, reverse=True)
    assert [row.rank for row in ranking.rows] == [1, 2, 3, 4, 5]
    for row in ranking.rows:
        a = next(a for a in GRID if a.label == row.label)
        assert row.estimates["success_rate"].value == pytest.approx(a.success.mean())
        assert row.estimates["mean_steps"].value == pytest.approx(a.metrics["steps"].mean())
        assert row.estimates["success_rate"].value + row.estimates["collision_rate"].value + row.estimates[
            "timeout_rate"
        ].value == pytest.approx(1)
        assert row.rank_interval[0] <= row.rank <= row.rank_interval[1]
        assert row.seeds == tuple(range(len(a.outcome)))
        assert "mean_waypoint_z_m" not in row.estimates


def test_intervals_say_what_they_cover(ranking):
    covers = {row.label: row.estimates["success_rate"].covers for row in ranking.rows}
    assert covers["PID K=1 10 Hz"] == EPISODES_ONLY
    assert covers["SAC K=1 25 Hz"] == SEEDS_AND_EPISODES
    assert {c.difference.covers for c in ranking.primary.comparisons} == {MIXED}


def test_intervals_and_p_values_tell_the_same():
    ranking = rank(GRID)
    places = {row.label: row for row in ranking.rows}
    typical = {a.label: np.median(a.success.mean(axis=1)) for a in GRID}
    assert len(ranking.comparisons) == 10
    better = dict.fromkeys(places, 0)
    for c in ranking.comparisons:
        better[c.second] += c.p_adjusted < 0.05
        assert c.p_adjusted >= c.p_value
        assert c.difference.value >= 0
        assert c.difference.value == pytest.approx(typical[c.first] - typical[c.second])
    for label, row in places.items():
        assert row.rank_interval[0] == 1 + better[label]
    assert [c.p_adjusted for c in ranking.comparisons] == pytest.approx(
        holm([c.p_value for c in ranking.comparisons]).tolist()
    )


def test_order_of_the_agents_does_not_matter(ranking):
    again = rank(GRID[::-1], baseline="PID K=1 10 Hz")
    assert repr(again.rows) == repr(ranking.rows)  # NaN equals NaN
    assert again.comparisons == ranking.comparisons
    assert again.primary == ranking.primary


def test_controllers_are_tested_by_mcnemar_and_on_penalised_steps_by_the_paired_t_test():
    a, b = agent("pid", level=2.0, seeds=1), agent("lqr", level=1.0, seeds=1)
    ranking = rank([a, b])
    comparison = ranking.comparisons[0]
    only_a, only_b = int((a.success > b.success).sum()), int((b.success > a.success).sum())
    assert comparison.p_value == pytest.approx(float(mcnemar(only_a, only_b)))
    assert comparison.difference.covers == EPISODES_ONLY
    steps = rank([a, b], rank_by="mean_steps").comparisons[0]
    penalised = [np.where(x.outcome == 0, x.metrics["steps"], 1000.0)[0] for x in (a, b)]
    test = stats.ttest_rel(*penalised)
    assert steps.p_value == pytest.approx(test.pvalue)


def test_one_training_seed_is_one_policy_and_takes_no_part_in_any_test():
    several = [agent("sac", k, 25, level=level, seed_sd=0.1) for k, level in ((1, 3.5), (40, -1.0))]
    single = [agent("ppo", k, 25, level=level, seeds=1) for k, level in ((1, 4.5), (40, 0.5))]
    pid = agent("pid", 1, 10, level=3.0, seeds=1)
    ranking = rank([*several, *single, pid], baseline="pid", margin=0.02)
    alone = {a.label for a in single}
    assert {row.label for row in ranking.rows if not row.compared} == alone
    for row in ranking.rows:
        if not row.compared:
            assert row.rank_interval == (1, 5)
    assert len(ranking.comparisons) == 3
    assert not any({c.first, c.second} & alone for c in ranking.comparisons)
    # An agent that is not compared changes nothing of what is said of the others.
    assert rank([*several, pid], baseline="pid", margin=0.02).comparisons == ranking.comparisons


def test_a_controller_given_twice_is_one_controller():
    pid = agent("pid", seeds=1)
    twice = replace(
        pid,
        runs=pid.runs * 2,
        outcome=np.repeat(pid.outcome, 2, axis=0),
        metrics={k: np.repeat(v, 2, axis=0) for k, v in pid.metrics.items()},
    )
    assert repr(rank([twice, GRID[0]]).rows) == repr(rank([pid, GRID[0]]).rows)  # NaN equals NaN


def test_a_quick_collision_is_not_quick():
    """An agent that collides at once has few steps; one that succeeds on a few easy scenarios short times."""
    good = agent("sac", level=3, steps=300, seeds=3)
    crash = replace(
        agent("ppo", level=3, seeds=3),
        outcome=np.ones((3, 200), dtype=np.int8),
        metrics={**good.metrics, "steps": np.full((3, 200), 2.0)},
    )
    for name in ("mean_steps", "par1_steps", "par2_steps"):
        ranking = rank([crash, good], rank_by=name)
        assert [row.label for row in ranking.rows] == [good.label, crash.label]
        assert ranking.rank_by == name.replace("mean", "par1")
    assert ranking.rows[1].estimates["mean_steps"].value == 2
    assert ranking.rows[1].estimates["par2_steps"].value == 2000
    rare = np.where(np.arange(200) % 10 == 0, 0, 2).astype(np.int8) * np.ones((3, 1), dtype=np.int8)
    time = {"duration_s": np.full((3, 200), 100.0), "frequency_hz": np.full((3, 200), 10.0)}
    seldom = replace(
        crash,
        outcome=rare,
        metrics={
            **good.metrics,
            **time,
            "steps": np.where(rare == 0, 100.0, 1000.0),
            "duration_s": np.where(rare == 0, 10.0, 100.0),
        },
    )
    usual = replace(good, metrics={**good.metrics, **time, "duration_s": good.metrics["steps"] / 10})
    ranking = rank([seldom, usual], rank_by="mean_time_to_goal_s")
    assert [row.label for row in ranking.rows] == [usual.label, seldom.label]
    assert ranking.rows[1].estimates["par1_time_s"].value == pytest.approx(0.1 * 10 + 0.9 * 100)


def test_verdicts():
    a = agent("sac", level=6, seed_sd=0, seeds=5, episodes=500)
    low = agent("td3", level=-1, seed_sd=0, seeds=5, episodes=500)
    (seen,) = rank([a, low]).comparisons
    assert (seen.first, seen.second, seen.verdict) == (a.label, low.label, "better")
    wild = [agent(name, level=1, seed_sd=2.5) for name in ("sac", "ppo")]
    assert rank(wild).comparisons[0].verdict == "undecided"


def test_direction_follows_the_measure():
    quick, slow = agent("sac", steps=200, level=3), agent("ppo", steps=600, level=3)
    assert rank([slow, quick], rank_by="mean_steps").rows[0].label == quick.label
    rich, poor = agent("sac", k=100), agent("sac", k=1)
    assert rank([rich, poor], rank_by="mean_return").rows[0].label == rich.label
    assert rank([rich, poor], rank_by="collision_rate").rows[0].estimates["collision_rate"].value == min(
        (x.outcome == 1).mean() for x in (rich, poor)
    )
    assert {m.name for m in metrics.registered() if m.kind in ("episode", "derived")} == {
        m.column for m in measures().values()
    } - {"outcome"}


def test_no_interval_leaves_what_is_possible():
    """Two seeds that differ wildly: t(1) = 12.7 would promise negative steps."""
    good, bad = agent("sac", seeds=2, steps=200), agent("ppo", seeds=2, level=-1)
    more = {
        "frequency_hz": np.full((2, 200), 10.0),
        "energy_J": np.array([[1e3], [3e4]]) + np.zeros((2, 200)),
        "path_efficiency": np.array([[0.2], [0.9]]) + np.zeros((2, 200)),
        "return": np.array([[1.0], [600.0]]) + np.zeros((2, 200)),
    }
    agents = [
        replace(a, metrics={**a.metrics, **more, "time_to_goal_s": a.metrics["steps"] * [[0.02], [0.1]]})
        for a in (good, bad)
    ]
    ranking = rank(agents, rank_by="mean_steps")
    limits = {
        "steps": (1, 1000),
        "time_to_goal_s": (0, 100),
        "energy_J": (0, np.inf),
        "path_efficiency": (-1, 1),
    }
    for row in ranking.rows:
        for column, (least, most) in limits.items():
            e = row.estimates[f"mean_{column}"]
            assert least <= e.low < e.value < e.high <= most, (column, e)
    energy = ranking.rows[0].estimates["mean_energy_J"]
    assert energy.low == 0
    assert energy.high == pytest.approx(
        energy.value + 12.7062 * np.std([1e3, 3e4], ddof=1) / np.sqrt(2), rel=1e-4
    )
    (apart,) = rank(
        [agent("sac", seeds=5, steps=200), agent("ppo", seeds=5, level=-6, seed_sd=9)], rank_by="mean_steps"
    ).comparisons
    assert -999 <= apart.difference.low < apart.difference.high <= 999
    assert ranking.rows[0].estimates["mean_return"].low < 0


def test_equal_success_is_decided_by_steps_and_full_equality_shares_the_rank():
    a = agent("sac", level=30, seed_sd=0, steps=200)
    b = agent("ppo", level=30, seed_sd=0, steps=400)
    assert a.success.all()
    assert b.success.all()
    twin = replace(a, label="twin")
    rows = rank([b, twin, a]).rows
    assert [(row.label, row.rank) for row in rows] == [(a.label, 1), ("twin", 1), (b.label, 3)]
    assert {row.rank_interval for row in rows} == {(1, 3)}
    assert all(row.estimates["success_rate"].low < 1 for row in rows)


def test_a_missing_measure_is_nan_and_last_and_named():
    whole, without = agent("sac"), agent("ppo", level=4)
    without = replace(without, metrics={k: v for k, v in without.metrics.items() if k != "return"})
    ranking = rank([without, whole], rank_by="mean_return")
    assert [row.label for row in ranking.rows] == [whole.label, without.label]
    assert np.isnan(ranking.rows[1].estimates["mean_return"].value)
    assert np.isnan(ranking.comparisons[0].p_value)
    assert ranking.rows[0].rank_interval == ranking.rows[1].rank_interval
    assert [problem.where for problem in ranking.problems] == [without.label]


def test_many_agents_list_fewer_pairs_and_still_test_all():
    agents = [agent("pid", k, 25, level=3 - k / 10, seeds=1, episodes=100) for k in range(ALL_PAIRS + 5)]
    ranking = rank(agents)
    n = len(agents)
    listed = {(c.first, c.second) for c in ranking.comparisons}
    labels = [row.label for row in ranking.rows]
    assert set(pairwise(labels)) <= listed
    assert {(labels[0], x) for x in labels[1:]} <= listed
    assert len(listed) < 3 * n


def test_one_agent():
    ranking = rank([GRID[0]])
    row = ranking.rows[0]
    assert (row.rank, row.rank_interval) == (1, (1, 1))
    assert ranking.comparisons == ()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rank_by": "sucess_rate"}, "--rank-by 'sucess_rate' .* did you mean 'success_rate'"),
        ({"baseline": "lqr"}, "--baseline 'lqr' is not one of the agents.*PID K=1 10 Hz, PPO K=1 25 Hz"),
        ({"baseline": "sac"}, "--baseline 'sac' matches 2 agents.*SAC K=1 25 Hz, SAC K=40 25 Hz"),
        ({"confidence": 95}, "confidence must be at least 0.5 and less than 1, for example 0.95, got 95"),
    ],
)
def test_bad_input_is_one_clear_line(change, message):
    with pytest.raises(ReportError, match=message):
        rank(GRID, **change)


def test_agents_that_cannot_share_a_table():
    with pytest.raises(ReportError, match="no agents"):
        rank([])
    with pytest.raises(ReportError, match=r"fedc \(200 episodes\)"):
        rank([GRID[0], replace(GRID[1], fingerprint="fedc")])
    with pytest.raises(ReportError, match="two agents have the label 'SAC K=1 25 Hz'"):
        rank([GRID[0], GRID[0]])


def test_measure_names_its_option():
    assert measure("mean_return").higher_is_better
    with pytest.raises(ReportError, match="--metric"):
        measure("x", "--metric")


@pytest.mark.slow
def test_false_discoveries_are_as_rare_as_promised():
    """Six equal agents with ten seeds: rarely is any pair resolved, in at most 5 % of the reports."""
    rng, wrong, n = np.random.default_rng(5), 0, 200
    base = agent(seeds=10, episodes=60)
    for _ in range(n):
        hard = rng.normal(size=60)
        agents = []
        for name in "abcdef":
            success = rng.random((10, 60)) < 1 / (1 + np.exp(-(1 + 0.5 * rng.normal(size=(10, 1)) - hard)))
            agents.append(replace(base, label=name, outcome=np.where(success, 0, 2).astype(np.int8)))
        wrong += any(c.p_adjusted < 0.05 for c in rank(agents).comparisons)
    assert wrong / n < 0.05 + 3.5 * np.sqrt(0.05 * 0.95 / n)
