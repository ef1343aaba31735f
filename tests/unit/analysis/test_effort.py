"""What agents know, and the trials that chose their settings."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from auvbench.analysis.effort import knowledge, with_effort
from auvbench.analysis.ranking import rank
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
