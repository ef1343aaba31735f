"""Time that differs with the frequency, budgets that differ between agents, and seeds that would resolve."""

from __future__ import annotations

from dataclasses import replace

import pytest

from auvbench.analysis.effects import effects
from auvbench.analysis.findings import sentences
from auvbench.analysis.measures import measure
from auvbench.analysis.model import Agent
from auvbench.analysis.ranking import rank
from auvbench.analysis.timing import (
    confounded,
    horizon_s,
    limit_s,
    separated,
    step_limit,
    unequal_budgets,
)
from auvbench.reporting.tables import markdown
from tests.unit.analysis.agents import agent


def configured(one: Agent, **values: object) -> Agent:
    changed = {key.replace("__", "."): value for key, value in values.items()}
    return replace(one, runs=tuple(replace(run, config={**run.config, **changed}) for run in one.runs))


def budget(one: Agent, steps: int) -> Agent:
    return replace(
        one,
        runs=tuple(
            replace(r, manifest={**r.manifest, "steps": steps, "total_steps": steps}) for r in one.runs
        ),
    )


def test_the_thesis_s_frequencies_are_confounded_with_time() -> None:
    agents = [configured(agent("sac", 1, f), algo__gamma=0.99) for f in (10, 25, 55)]
    found = confounded(agents)
    assert found is not None
    assert found.text.startswith(
        "Frequency and time are confounded: with the frequency of training the time for an episode and the "
        "discount's horizon in seconds change too."
    )
    assert "At 10 Hz 100 s for an episode and a discount that looks 9.95 s ahead" in found.statistic
    assert "at 55 Hz 18.2 s for an episode and a discount that looks 1.81 s ahead" in found.statistic


def test_in_seconds_they_are_not() -> None:
    seconds = {"task__time_limit": 100.0, "algo__horizon_s": 9.95}
    assert confounded([configured(agent("sac", 1, f), **seconds) for f in (10, 25, 55)]) is None
    half = confounded(
        [configured(agent("sac", 1, f), algo__gamma=0.99, task__time_limit=100.0) for f in (10, 55)]
    )
    assert half is not None
    assert "the discount's horizon in seconds changes too" in half.text
    assert confounded([configured(agent("sac", k, 10), algo__gamma=0.99) for k in (1, 100)]) is None
    assert confounded([agent("pid", 1, f, seeds=1) for f in (10, 55)]) is None


def test_limits_and_horizons_of_a_run() -> None:
    (run, *_) = configured(agent("sac", 1, 55), algo__gamma=0.99).runs
    assert limit_s(run) == pytest.approx(1000 / 55)
    assert horizon_s(run) == pytest.approx(1.809, abs=1e-3)
    assert step_limit(run) == 1000
    (timed, *_) = configured(agent("sac", 1, 55), task__time_limit=100.0, algo__horizon_s=9.95).runs
    assert (limit_s(timed), horizon_s(timed), step_limit(timed)) == (100.0, 9.95, 5500.0)


def test_unequal_budgets_stand_above_the_table() -> None:
    agents = [budget(agent("sac"), 150_000), agent("ppo"), agent("pid", seeds=1)]
    text = unequal_budgets(agents)
    assert text.startswith(
        "Unequal budgets of training, in environment steps: PPO K=1 25 Hz 1,000,000; SAC K=1 25 Hz 150,000."
    )
    ranking = rank(agents)
    assert ranking.notices == (text,)
    assert markdown(ranking).index("Unequal budgets") < markdown(ranking).index("| rank")
    assert unequal_budgets([agent("sac"), agent("ppo"), agent("pid", seeds=1)]) == ""


def test_the_seeds_that_would_resolve_are_named() -> None:
    agents = [agent("sac", level=1.2, seed_sd=0.5), agent("ppo", level=1.9, seed_sd=0.5)]
    ranking = rank(agents)
    assert not ranking.resolved(*ranking.rows)
    (found,) = [f for f in sentences(ranking, agents) if "seeds of each would show it" in f.text]
    seen = 100 * abs(agents[0].success.mean() - agents[1].success.mean())
    assert f"if they truly differ by the {seen:.1f} points seen here, about " in found.text
    assert "(there are 3)" in found.text
    far = [agent("sac", level=-2, seed_sd=0.1), agent("ppo", level=3, seed_sd=0.1)]
    assert not any("would show it" in f.text for f in sentences(rank(far), far))
    single = [agent("sac", seeds=1), agent("ppo", seeds=1)]
    assert not any("would show it" in f.text for f in sentences(rank(single), single))


def test_many_budgets_are_a_range() -> None:
    agents = [budget(agent(label=f"A{i}"), 1000 * (i + 1)) for i in range(7)]
    assert unequal_budgets(agents) == (
        "Unequal budgets of training, in environment steps: from A6 7,000 to A0 1,000, 5 others between. "
        "Who had more may be ahead for that alone."
    )


def timed(f: float, limit: float | None, horizon: float | None, level: float) -> Agent:
    """PPO at a frequency whose time is in steps, in seconds, or half of each."""
    one = agent("ppo", 1, f, level=level, seeds=3, seed_sd=0.3)
    key = {**one.key, "task.time_limit": limit, "algo.horizon_s": horizon}
    one = replace(one, key=key, label=f"PPO {f:g} Hz {limit} {horizon}")
    return configured(one, algo__gamma=0.99, task__time_limit=limit, algo__horizon_s=horizon)


def test_what_is_left_of_the_frequency_where_time_is_equal() -> None:
    both = timed(55, 100.0, 9.95, 2.0)
    agents = [timed(10, None, None, 2.0), timed(55, None, None, -1.0), both]
    texts = [f.text for f in sentences(rank(agents), agents)]
    (text,) = (t for t in texts if "with time equal in seconds" in t)
    low, high = (100 * agents[i].success.mean() for i in (0, 2))
    assert text.startswith("From 10 to 55 Hz success rate changes by ")
    assert abs(high - low) < 15
    assert "points" in text.split("with time equal")[0]
    steps = 100 * agents[1].success.mean() - low
    assert f"by {steps:+.0f} points" in text
    assert separated(agents[:2], measure("success_rate"), 0.95) is None, "nothing is equal in seconds"
    assert separated([agents[0], both], measure("success_rate"), 0.95) is None, "nothing is equal in steps"


def test_a_limit_in_seconds_that_is_null_is_a_level() -> None:
    agents = [timed(f, limit, None, 1.0) for f in (25, 55) for limit in (None, 100.0)]
    found = {(e.factor, e.first, e.second) for e in effects(agents, measure("success_rate"))}
    assert ("task.time_limit", "time_limit=unset", "time_limit=100") in found
    other = replace(agents[0], key={**agents[0].key, "algo.tau": None})
    assert not any(e.factor == "algo.tau" for e in effects([other, *agents[1:]], measure("success_rate")))
