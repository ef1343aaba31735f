"""The primary analysis: a baseline, a margin, intervals that hold together, and verdicts that agree with them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from auvbench.analysis.measures import measure
from auvbench.analysis.ranking import rank
from auvbench.analysis.records import Agent, Primary, Ranking
from auvbench.errors import ReportError
from auvbench.statistics import Estimate
from tests.unit.analysis.agents import agent

PID = agent("pid", level=3.0, seeds=1)


def primary(ranking: Ranking) -> Primary:
    assert ranking.primary is not None
    return ranking.primary


def test_pid_is_the_baseline_else_the_best_controller_else_the_best_agent() -> None:
    good, lqr, random = agent("sac", level=5), agent("lqr", level=2, seeds=1), agent("random", seeds=1)
    assert primary(rank([good, lqr, PID, random])).baseline == PID.label
    assert primary(rank([good, lqr, random])).baseline == lqr.label
    best = primary(rank([good, agent("ppo", level=-1), random]))
    assert (best.baseline, best.chosen_by_rank) == (good.label, True)
    assert not primary(rank([good, PID])).chosen_by_rank
    assert primary(rank([good, PID], baseline="sac")).baseline == good.label
    assert rank([good]).primary is None
    assert rank([agent("sac", seeds=1), agent("ppo", seeds=1)]).primary is None


def test_the_default_margin_is_two_points_or_a_share_of_the_baseline() -> None:
    agents = [agent("sac"), PID]
    assert primary(rank(agents)).margin == 0.02
    steps = rank(agents, rank_by="par1_steps")
    value = next(row for row in steps.rows if row.label == PID.label).estimates["par1_steps"].value
    assert primary(steps).margin == pytest.approx(0.05 * value)
    assert primary(rank(agents, margin=0.1)).margin == 0.1
    with pytest.raises(ReportError, match="margin must be a positive number, got -1"):
        rank(agents, margin=-1)


def test_each_verdict() -> None:
    def one(name: str, level: float, **options: float) -> Agent:
        return agent(name, level=level, episodes=500, **{"seed_sd": 0, "seeds": 5} | options)  # type: ignore[arg-type]

    middle = one("pid", 1, seeds=1)
    ahead, alike, behind = one("sac", 4), one("ppo", 1), one("ddpg", -2)
    found = primary(rank([ahead, alike, behind, middle], margin=0.15))
    verdicts = {ahead.label: "ahead", alike.label: "equivalent", behind.label: "behind"}
    assert {c.agent: c.verdict for c in found.comparisons} == verdicts
    assert [c.agent for c in found.having("behind")] == [behind.label]
    assert found.of(middle.label) is None
    wild = one("td3", 1, seed_sd=3, seeds=3)
    assert [c.verdict for c in primary(rank([wild, middle])).comparisons] == ["open"]


@pytest.mark.parametrize("rank_by", ["success_rate", "par1_steps"])
def test_agents_that_fail_everything_are_open_and_at_the_limit(rank_by: str) -> None:
    def failing(name: str, seeds: int) -> Agent:
        one = agent(name, seeds=seeds)
        return replace(one, outcome=np.full_like(one.outcome, 2))

    sac, pid = failing("sac", 5), failing("pid", 1)
    found = rank([sac, pid], rank_by=rank_by)
    assert [(c.verdict, c.needed) for c in primary(found).comparisons] == [("open", None)]
    assert any("at the limit" in notice and sac.label in notice for notice in found.notices)
    able = rank([sac, PID], rank_by=rank_by)
    assert [c.verdict for c in primary(able).comparisons] == ["behind"]
    assert able.notices == ()


@pytest.mark.parametrize("rank_by", ["success_rate", "par1_steps"])
def test_verdicts_agree_with_intervals(rank_by: str) -> None:
    """Also where two scales disagree, or a rate is at its end: the interval is all that a verdict is read from."""
    levels = np.linspace(-3, 8, 12)
    agents = [agent(f"a{i}", i + 1, level=x, seeds=5 + i % 4, seed_sd=0.1) for i, x in enumerate(levels)]
    baseline = agent("pid", level=2.0, seeds=1)
    found = primary(rank([*agents, baseline], rank_by=rank_by))
    sign = measure(rank_by).sign
    assert len({c.verdict for c in found.comparisons}) > 2
    for c in found.comparisons:
        low, high = sorted((sign * c.difference.low, sign * c.difference.high))
        inside = -found.margin < low and high < found.margin
        expected = "equivalent" if inside else "ahead" if low > 0 else "behind" if high < 0 else "open"
        assert c.verdict == expected
        assert low <= sign * c.difference.value <= high


def test_the_family_is_that_of_the_comparisons_alone() -> None:
    """More agents, wider intervals; an agent with one seed is no member."""
    few = primary(rank([agent("sac"), PID])).comparisons[0].difference
    others = [agent(f"x{i}", level=2) for i in range(6)]
    many = primary(rank([agent("sac"), PID, *others])).of(agent("sac").label)
    assert many is not None
    assert many.difference.high - many.difference.low > few.high - few.low
    single = agent("ddpg", level=-4, seeds=1)
    with_single = primary(rank([agent("sac"), PID, single]))
    assert with_single.of(agent("sac").label).difference == few  # type: ignore[union-attr]
    lone = with_single.of(single.label)
    assert lone is not None
    assert (lone.verdict, lone.needed) == ("open", None)
    assert np.isnan([lone.difference.low, lone.difference.high]).all()


@pytest.mark.slow
def test_false_verdicts_are_rare_all_comparisons_together() -> None:
    """Five learners that are worth what the controller is: at most 5 % of the tables call one ahead or behind."""
    rng = np.random.default_rng(3)
    tables, wrong = 150, 0
    base = [agent(f"x{i}", seeds=5, episodes=80) for i in range(5)]
    baseline = agent("pid", seeds=1, episodes=80)
    for _ in range(tables):
        hard = rng.normal(size=80)

        def drawn(one: Agent, sd: float, hard: np.ndarray = hard) -> Agent:
            logit = 1 + sd * rng.normal(size=(len(one.outcome), 1)) - hard
            success = rng.random(one.outcome.shape) < 1 / (1 + np.exp(-logit))
            return replace(one, outcome=np.where(success, 0, 2).astype(np.int8))

        found = primary(rank([*(drawn(one, 0.4) for one in base), drawn(baseline, 0.0)], baseline="pid"))
        wrong += any(c.verdict in ("ahead", "behind") for c in found.comparisons)
    assert wrong / tables <= 0.05 + 2.5 * np.sqrt(0.05 * 0.95 / tables)


def test_an_open_comparison_names_the_seeds_that_would_decide_it() -> None:
    def needed(level: float, **options: float) -> int | None:
        agents = [
            agent("sac", level=level, seed_sd=0.8, episodes=2000),
            agent("pid", level=3.0, seeds=1, episodes=2000),
        ]
        (c,) = primary(rank(agents, margin=0.001, **options)).comparisons  # type: ignore[arg-type]
        assert c.verdict == "open"
        assert c.needed is not None
        assert c.needed.unit == "trainings"
        return c.needed.count

    near, nearer = needed(2.2), needed(2.4)
    assert near is not None
    assert nearer is None or nearer > near > 8


def test_few_trainings_say_what_they_lack_and_mark_what_they_decide() -> None:
    """Below five no verdict; below the needed number a star, because a verdict then assumes one hump."""
    for seeds, behind, verdict in (
        (3, -6.0, "open"),
        (5, -6.0, "behind*"),
        (5, 2.5, "open"),
        (9, -6.0, "behind"),
    ):
        one = agent("sac", level=behind, seeds=seeds, seed_sd=0.3)
        others = [agent(f"x{i}", level=2) for i in range(4)]
        c = primary(rank([one, PID, *others])).of(one.label)
        assert c is not None
        assert (c.marked_verdict, c.trainings, c.enough) == (verdict, seeds, 8)
        assert c.few == (seeds < 8)
        assert bool(np.isnan(c.difference.low)) == (seeds < 5)
        assert c.needed is None


def test_a_verdict_of_a_learner_has_its_reliability() -> None:
    sac, lqr = agent("sac", level=3.0, seeds=20, seed_sd=2.0), agent("lqr", level=3.0, seeds=1)
    found = primary(rank([sac, PID, lqr], margin=0.05))
    held, none = found.of(sac.label), found.of(lqr.label)
    assert held is not None
    assert none is not None
    assert none.reliability is None
    gains = sac.success.mean(axis=1) - PID.success.mean()
    assert held.reliability is not None
    assert held.reliability.count == (gains >= -0.05).sum()
    assert 0 < held.reliability.count < held.reliability.trainings == 20
    turned = primary(rank([sac, PID], baseline=sac.label, margin=0.05)).of(PID.label)
    assert turned is not None
    assert turned.reliability is not None
    assert turned.reliability.count == held.reliability.count


def test_the_mean_turns_at_a_share_of_failing_trainings() -> None:
    quick, slow = (
        agent("sac", steps=200, level=6, seed_sd=0, seeds=10),
        agent("pid", steps=300, level=6, seeds=1),
    )
    (c,) = primary(rank([quick, slow], rank_by="par1_steps")).comparisons
    assert c.verdict == "ahead"
    assert c.reliability is not None
    baseline = np.where(slow.outcome == 0, slow.metrics["steps"], 1000.0).mean()
    gain = baseline - np.where(quick.outcome == 0, quick.metrics["steps"], 1000.0).mean()
    assert c.reliability.mean_turns == pytest.approx(gain / (gain + 1000.0 - baseline))


def test_a_training_that_failed_counts_as_a_failure_in_every_measure_that_counts_them() -> None:
    """An RMS error of a training without a policy is the task's bounds, and not left out of the median."""

    def told(failed: int) -> Agent:
        one = agent("sac", level=6, seeds=9, seed_sd=0)
        runs = tuple(replace(run, config={**run.config, "task.bounds": 10.0}) for run in one.runs)
        error = np.full(one.outcome.shape, 0.1)
        error[:failed] = np.nan
        outcome = one.outcome.copy()
        outcome[:failed] = -1
        return replace(
            one, runs=runs, outcome=outcome, metrics={**one.metrics, "position_error_rms_m": error}
        )

    base = agent("pid", level=6, seeds=1)
    pid = replace(base, metrics={**base.metrics, "position_error_rms_m": np.full(base.outcome.shape, 1.0)})
    verdicts = [
        primary(rank([told(failed), pid], rank_by="mean_position_error_rms_m")).comparisons[0].verdict
        for failed in (0, 3, 9)
    ]
    assert verdicts == ["ahead", "open", "behind"]


def test_two_controllers_are_decided_by_episodes() -> None:
    one, other = agent("lqr", level=2.6, seeds=1), agent("pid", level=3.0, seeds=1)
    (c,) = primary(rank([one, other], margin=0.001)).comparisons
    assert c.verdict == "open"
    assert c.needed is not None
    assert c.needed.unit == "episodes"
    assert c.needed.count is None or c.needed.count > 200


def test_a_difference_has_the_sign_of_agent_less_baseline() -> None:
    quick, slow = agent("sac", steps=200, level=6, seed_sd=0), agent("pid", steps=500, level=6, seeds=1)
    (c,) = primary(rank([quick, slow], rank_by="par1_steps")).comparisons
    assert c.difference.value < 0
    assert c.verdict == "ahead"
    assert isinstance(c.difference, Estimate)
