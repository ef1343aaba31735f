"""Runs of several vehicles or scenarios: a section for each, and nobody is lost."""

from __future__ import annotations

import shutil
from pathlib import Path

from auvbench.analysis.grouping import agents, sections, split_problems
from auvbench.analysis.load import load
from auvbench.analysis.records import Problem
from tests.synthetic import reconfigure, set_state, write_evaluation, write_experiment


def test_one_vehicle_and_one_set_of_scenarios_is_one_section(tmp_path: Path) -> None:
    written = write_experiment(tmp_path / "grid", episodes=12, train_episodes=20)
    found = sections(load([tmp_path])[0], "test")
    assert [part.title for part in found] == ["vehicle bluerov2"]
    assert [run.id for run in found[0].runs] == sorted(run.name for run in written)
    assert found[0].problems == ()


def test_each_vehicle_has_its_section_whatever_the_fingerprints(tmp_path: Path) -> None:
    write_experiment(tmp_path / "grid", algorithms=("ppo", "pid"), episodes=12, train_episodes=20)
    other = write_experiment(
        tmp_path / "grid", algorithms=("pid",), episodes=12, train_episodes=20, vehicle="rexrov"
    )
    pending = write_experiment(
        tmp_path / "grid", algorithms=("ppo",), seeds=(0,), episodes=12, train_episodes=20, vehicle="rexrov"
    )
    set_state(pending, "interrupted")
    runs, problems = load([tmp_path])
    found = sections(runs, "test")
    assert [part.title for part in found] == ["vehicle bluerov2", "vehicle rexrov"]
    assert [part.folder for part in found] == ["bluerov2", "rexrov"]
    assert [len(part.runs) for part in found] == [3, 2]
    assert {run.id for run in found[1].runs} == {other[0].name, pending[0].name}
    assert [part.problems for part in found] == [(), ()]
    # A problem stands with the section of its run, what is about no run with the first.
    stray = Problem("somewhere", "missing", "no run here")
    assert split_problems([*problems, stray], found) == [[stray], problems]


def test_agents_with_other_sheets_share_a_section_if_the_test_has_one_vehicle(tmp_path: Path) -> None:
    _, other, _ = write_experiment(
        tmp_path / "grid", algorithms=("ppo", "pid"), seeds=(0, 1), episodes=12, train_episodes=20
    )
    reconfigure(other, vehicle__name="rexrov")
    pending = write_experiment(
        tmp_path / "grid", algorithms=("ppo",), seeds=(2,), episodes=12, train_episodes=20, vehicle="rexrov"
    )
    set_state(pending, "interrupted")
    shutil.rmtree(pending[0] / "evaluations")
    (part,) = sections(load([tmp_path])[0], "test")
    assert (part.title, part.folder) == ("several sheets", "several_sheets")
    assert len(part.runs) == 4
    labels = [agent.label for agent in agents(part.runs)[0]]
    assert labels == ["PID", "PPO, sheet bluerov2", "PPO, sheet rexrov"]


def test_other_scenarios_of_the_same_vehicle_are_a_section_that_says_how_to_mend_it(tmp_path: Path) -> None:
    written = write_experiment(tmp_path / "grid", algorithms=("ppo",), episodes=12, train_episodes=20)
    write_evaluation(written[0], "test", ("nominal",), 10)
    found = sections(load([tmp_path])[0], "test")
    assert [len(part.runs) for part in found] == [1, 1]
    assert all(part.title == f"vehicle bluerov2, scenarios {part.fingerprint[:8]}" for part in found)
    assert len({part.folder for part in found}) == 2
    (problem,) = found[1].problems
    assert problem.kind == "foreign"
    assert "10 episodes" in problem.message
    assert "12 episodes" in problem.message
    assert "repeats each outdated test" in problem.message


def test_other_scenarios_because_of_another_sheet_name_what_differs(tmp_path: Path) -> None:
    written = write_experiment(tmp_path / "grid", algorithms=("ppo",), episodes=12, train_episodes=20)
    write_evaluation(written[0], "test", ("nominal",), 10)
    reconfigure(written[0], vehicle__mass=16.0)
    (problem,) = sections(load([tmp_path])[0], "test")[1].problems
    assert problem.message.endswith("they differ in vehicle.mass")


def test_runs_tested_in_their_own_task_have_a_section_each_and_no_complaint(tmp_path: Path) -> None:
    one, other = write_experiment(
        tmp_path / "grid", algorithms=("ppo",), seeds=(0, 1), episodes=12, protocols={"own": ("nominal",)}
    )
    write_evaluation(one, "own", ("nominal",), 10)  # another fingerprint
    reconfigure(one, task__goal_radius=0.5)
    found = sections(load([tmp_path], "own")[0], "own")
    assert {part.title for part in found} == {
        f"vehicle bluerov2, scenarios {part.fingerprint[:8]}" for part in found
    }
    assert [part.problems for part in found] == [(), ()]
    assert other.name in {run.id for part in found for run in part.runs}
