"""What agents know, and the trials that chose their settings."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pandas as pd
import pytest

from auvbench.analysis.effort import knowledge, with_effort
from auvbench.analysis.ranking import rank
from auvbench.analysis.records import Evaluation
from auvbench.reporting.tables import text_formats
from auvbench.reporting.tables.main import main_table
from tests.unit.analysis.agents import agent

TRACKED = {"task.observation": ["velocity", "preview"], "task.preview.points": 3}


@pytest.mark.parametrize(
    ("config", "known"),
    [
        ({"algo.agent": "pid"}, ("sheet",)),
        ({"algo.agent": "pid", **TRACKED}, ("sheet", "true velocities")),
        ({"algo.agent": "mpc", **TRACKED}, ("model", "preview", "true velocities")),
        ({"algo.agent": "ppo", **TRACKED}, ("preview", "true velocities")),
        ({"algo.agent": "ppo", **TRACKED, "task.preview.points": 0}, ("true velocities",)),
        ({"algo.agent": "ppo_residual", "task.observation": ["yaw_error"]}, ("sheet",)),
        ({"algo.agent": "random", **TRACKED}, ()),
        ({"algo.agent": "of_a_package"}, ()),
    ],
)
def test_knowledge_is_read_from_the_configuration(config: dict[str, Any], known: tuple[str, ...]) -> None:
    run = replace(agent("ppo", seeds=1).runs[0], config=config, manifest={})
    assert knowledge(run) == known


def test_the_table_shows_recorded_and_declared_trials() -> None:
    agents = [agent("ppo"), agent("pid", seeds=1)]
    tuned = replace(agents[0].runs[0], config={**agents[0].runs[0].config, "algo.tuned.trials": 50})
    agents[0] = replace(agents[0], runs=(tuned, *agents[0].runs[1:]))
    ranking = with_effort(rank(agents), agents, {"PID K=1 25 Hz": 1000})
    assert {row.label: row.trials for row in ranking.rows} == {"PPO K=1 25 Hz": 50, "PID K=1 25 Hz": 1000}
    table = main_table(ranking)
    column = next(i for i, heading in enumerate(table.headings) if heading.title == "tuning")
    assert {line.cells[0].value: line.cells[column].value for line in table.lines} == {
        "PPO K=1 25 Hz": "50",
        "PID K=1 25 Hz": "1,000",
    }


def test_the_table_shows_steps_and_processor_time_of_a_search_that_recorded_them() -> None:
    agents = [agent("ppo"), agent("pid", seeds=1)]
    spent = {"trials": 30, "steps": 3_500_000, "cpu_s": 5400.0}
    config = {**agents[0].runs[0].config, **{f"algo.tuned.{key}": value for key, value in spent.items()}}
    agents[0] = replace(agents[0], runs=tuple(replace(run, config=config) for run in agents[0].runs))
    ranking = with_effort(rank(agents), agents, {})
    table = main_table(ranking)
    columns = [i for i, heading in enumerate(table.headings) if heading.title == "tuning"]
    assert [table.headings[i].unit for i in columns] == ["trials", "steps", "core hours"]
    assert {line.cells[0].value: [line.cells[i].value for i in columns] for line in table.lines} == {
        "PPO K=1 25 Hz": ["30", "3.5M", "1.5"],
        "PID K=1 25 Hz": ["–", "–", "–"],
    }
    assert "5400" in text_formats.csv(ranking)
    assert "tuning_cpu_s" in text_formats.csv(ranking)
    assert "tuning_cpu_s" not in text_formats.csv(with_effort(rank(agents[1:]), agents[1:], {}))


def test_an_agent_that_was_tested_on_estimates_knows_no_true_velocities() -> None:
    agents = [agent("pid", seeds=1)]
    run = agents[0].runs[0]
    run = replace(run, config={**run.config, "algo.agent": "pid", "task.observation": ["velocity"]})

    def known(error: float | None) -> tuple[str, ...]:
        summary = {"conditions": [{"name": "nominal", "mean_navigation_error_rms_m": error}]}
        tested = replace(run, evaluations={"test": Evaluation("test", "", summary, pd.DataFrame())})
        group = [replace(agents[0], runs=(tested,))]
        (row,) = with_effort(rank(group), group, {}).rows
        return row.knows

    assert known(None) == ("sheet", "true velocities")
    assert known(0.2) == ("sheet",)
