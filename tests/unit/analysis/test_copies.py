"""Two directories of one configuration: the evaluated one counts, and both are named."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from auvbench.analysis.load import agents, load
from tests.synthetic import damage, seal, set_state, write_experiment


@pytest.fixture
def pid(tmp_path: Path) -> Path:
    return write_experiment(tmp_path / "demo", algorithms=("pid",), episodes=12)[0]


def copied(run: Path, *, ended: str = "2027-01-01T00:00:00+00:00") -> Path:
    """The same configuration under another experiment's name, run later."""
    copy = run.parent.parent / "other" / run.name
    shutil.copytree(run, copy)
    seal(copy / "manifest.json", ended=ended)
    return copy


def test_a_later_copy_without_an_evaluation_does_not_hide_the_evaluated_run(pid: Path) -> None:
    copy = copied(pid)
    shutil.rmtree(copy / "evaluations")
    runs, problems = load([pid.parent.parent])
    assert [run.directory for run in runs] == [pid]
    assert [agent.label for agent in agents(runs)[0]] == ["PID"]
    assert [problem.kind for problem in problems] == ["duplicate"]
    assert str(pid) in problems[0].message
    assert str(copy) in problems[0].message


def test_a_later_copy_whose_evaluation_is_damaged_does_not_count(pid: Path) -> None:
    copy = copied(pid)
    damage(copy / "evaluations" / "test" / "episodes.csv", "cut")
    runs, _ = load([pid.parent.parent])
    assert [run.directory for run in runs] == [pid]


def test_a_copy_that_is_not_complete_says_so(pid: Path) -> None:
    copy = copied(pid)
    set_state([copy], "interrupted")
    runs, problems = load([pid.parent.parent])
    assert [run.directory for run in runs] == [pid]
    assert [problem.kind for problem in problems] == ["duplicate"]
    assert str(copy) in problems[0].message


def test_of_two_evaluated_copies_the_one_that_ended_last_counts(pid: Path) -> None:
    copy = copied(pid)
    runs, problems = load([pid.parent.parent])
    assert [run.directory for run in runs] == [copy]
    assert str(pid) in problems[0].message
