"""What a report says of solves and of the time an action takes, and that it believes no file blindly."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pandas as pd

from auvbench.analysis.optional_columns import action_time, training_time, with_columns
from auvbench.analysis.ranking import rank
from auvbench.analysis.records import Agent, Evaluation
from auvbench.reporting.tables.main import main_table, notes
from tests.unit.analysis.agents import agent

INFERENCE = {"median_ms": 7.5, "p95_ms": 20.0, "cpu": "EPYC", "cores": 2}


def evaluated(
    made: Agent, notes: Any = None, inference: Any = INFERENCE, condition: str = "nominal"
) -> Agent:
    """The agent with what its tests' summaries say beside the rates."""
    summary = {"conditions": [{"name": condition, "notes": notes}], "inference": inference}
    evaluation = Evaluation("test", made.fingerprint, summary, pd.DataFrame())
    runs = tuple(replace(run, evaluations={"test": evaluation}) for run in made.runs)
    return replace(made, runs=runs)


def mpc(**options: Any) -> Agent:
    return evaluated(agent("mpc", seeds=1), **options)


def test_the_time_of_an_action_is_a_column_of_every_table() -> None:
    agents = [mpc(), evaluated(agent("pid", seeds=1), inference={"median_ms": 0.25, "cpu": "EPYC"})]
    table = main_table(with_columns(rank(agents), agents, []))
    titles = [heading.text for heading in table.headings]
    place = titles.index("computing time (ms)")
    shown = {line.cells[0].value: float(line.cells[place].value) for line in table.lines}
    assert shown == {agents[0].label: 7.5, agents[1].label: 0.25}
    untimed = main_table(with_columns(rank([agent("sac")]), [agent("sac")], []))
    assert "computing time" not in [heading.title for heading in untimed.headings]


def test_the_cores_of_a_training_are_the_mean_over_runs() -> None:
    learner = agent("ppo", seeds=2)
    runs = [
        replace(run, manifest={**run.manifest, "cpu_time_s": t})
        for run, t in zip(learner.runs, (10.0, 20.0), strict=True)
    ]
    found = training_time(replace(learner, runs=tuple(runs)))
    assert found is not None
    assert found.value == 15.0
    assert training_time(agent("pid", seeds=1)) is None


def test_a_test_whose_actions_were_not_timed_gives_no_time() -> None:
    assert action_time(mpc(inference=None), "test") is None


def on(cpu: Any, made: Agent) -> Agent:
    """The agent as tested and trained on a processor of this name."""
    made = evaluated(made, inference={**INFERENCE, "cpu": cpu})
    host = {"host": {"cpu": cpu}, "cpu_time_s": 3.0}
    return replace(made, runs=tuple(replace(run, manifest={**run.manifest, **host}) for run in made.runs))


def test_times_of_different_processors_are_told_apart_below_the_table() -> None:
    agents = [on("old", agent("pid", seeds=1)), on("old", agent("sac")), on("new", agent("ppo"))]
    said = with_columns(rank(agents), agents, ["action_ms", "training_cpu_s"]).machines
    assert len(said) == 2
    assert all("new, old" in line for line in said)
    assert with_columns(rank(agents), agents, []).machines == said[:1]
    assert set(said) <= set(notes(with_columns(rank(agents), agents, ["action_ms", "training_cpu_s"])))


def test_nothing_is_said_of_one_processor() -> None:
    agents = [on("old", agent("sac")), on("old", agent("ppo"))]
    assert with_columns(rank(agents), agents, ["action_ms", "training_cpu_s"]).machines == ()
