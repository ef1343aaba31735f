"""Time that differs with the frequency, and budgets that differ between agents."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from auvbench.analysis.evidence import limit_s
from auvbench.analysis.findings import effects
from auvbench.analysis.measures import measure
from auvbench.analysis.ranking import rank
from auvbench.analysis.records import Agent
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


def test_the_limit_of_a_run_in_seconds() -> None:
    (run, *_) = agent("sac", 1, 55).runs
    assert limit_s(run) == pytest.approx(1000 / 55)
    timed = replace(run, config={**run.config, "task.time_limit": 100.0})
    assert limit_s(timed) == 100.0
    unknown = replace(run, config={})
    assert math.isnan(limit_s(unknown))


def test_unequal_budgets_stand_beside_the_numbers() -> None:
    agents = [budget(agent("sac"), 150_000), agent("ppo"), agent("pid", seeds=1)]
    ranking = rank(agents)
    assert {row.label: row.budget for row in ranking.rows} == {
        agents[0].label: (150_000,),
        agents[1].label: (1_000_000,),
        agents[2].label: (),
    }
    text = markdown(ranking)
    assert "| 150k |" in text
    assert "| 1M |" in text
    assert "Budgets differ" in text
    assert "Budgets differ" not in markdown(rank(agents[1:]))


def timed(f: float, limit: float | None, horizon: float | None, level: float) -> Agent:
    """PPO at a frequency whose time is in steps, in seconds, or half of each."""
    one = agent("ppo", 1, f, level=level, seeds=8, seed_sd=0.3)
    key = {**one.key, "task.time_limit": limit, "algo.horizon_s": horizon}
    one = replace(one, key=key, label=f"PPO {f:g} Hz {limit} {horizon}")
    return configured(one, algo__gamma=0.99, task__time_limit=limit, algo__horizon_s=horizon)


def test_a_limit_in_seconds_that_is_null_is_a_level() -> None:
    agents = [timed(f, limit, None, 1.0) for f in (25, 55) for limit in (None, 100.0)]
    found = {(e.factor, e.first, e.second) for e in effects(agents, measure("success_rate"))}
    assert ("task.time_limit", "policies trained with no time_limit", "time_limit=100") in found
    other = replace(agents[0], key={**agents[0].key, "algo.tau": None})
    assert not any(e.factor == "algo.tau" for e in effects([other, *agents[1:]], measure("success_rate")))
