"""What is wrong with a run is named, what is right is reported."""

import json
import re
import shlex
import shutil
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from auvbench.analysis.load import agents, available_protocols, load, require
from auvbench.analysis.ranking import rank
from auvbench.analysis.records import NO_POLICY, Problem
from auvbench.errors import ReportError, RunError
from auvbench.reporting.tables.main import remarks
from auvbench.runs import lock
from tests.synthetic import damage, reconfigure, seal, set_state, write_evaluation, write_experiment


@pytest.fixture
def grid(tmp_path: Path) -> list[Path]:
    return write_experiment(
        tmp_path / "grid",
        algorithms=("ppo", "sac", "pid"),
        reward_k=(1, 100),
        frequencies=(10, 25),
        seeds=(0, 1),
        episodes=12,
        train_episodes=20,
    )


def kinds(problems: list[Problem]) -> dict[str, str]:
    return {problem.where: problem.kind for problem in problems}


def edit(path: Path, **values: object) -> None:
    seal(path, **values)


def test_a_sound_grid_has_no_problems(grid: list[Path]) -> None:
    runs, problems = load([grid[0].parent])
    found, more = agents(runs)
    assert problems == more == []
    assert [run.id for run in runs] == sorted(path.name for path in grid)
    assert [a.label for a in found] == [
        "PID",
        *(f"PPO K={k}, trained at {f} Hz" for k in (1, 100) for f in (10, 25)),
        *(f"SAC K={k}, trained at {f} Hz" for k in (1, 100) for f in (10, 25)),
    ]
    assert found[1].key == {"algo": "ppo", "reward.k": 1.0, "step.frequency": 10.0}


def test_metrics_are_the_csv_paired_by_episode(grid: list[Path]) -> None:
    path = grid[1] / "evaluations" / "test" / "episodes.csv"
    written = pd.read_csv(path)
    written.sample(frac=1, random_state=1).to_csv(path, index=False)  # the order of rows must not matter
    seal(path.with_name("summary.json"))
    runs, _ = load([grid[0].parent])
    agent = next(a for a in agents(runs)[0] if a.label == "PPO K=1, trained at 10 Hz")
    assert [run.seed for run in agent.runs] == [0, 1]
    assert np.array_equal(agent.metrics["steps"][1], written["steps"])
    assert agent.metrics["return"][1] == pytest.approx(written["return"].to_numpy(), rel=1e-15)
    assert np.array_equal(agent.success[1], written["outcome"] == "success")
    assert np.array_equal(agent.metrics["waypoint_x_m"][0], agent.metrics["waypoint_x_m"][1])
    arrived = agent.success == 1
    assert np.array_equal(agent.metrics["time_to_goal_s"][arrived], agent.metrics["duration_s"][arrived])
    assert np.isnan(agent.metrics["time_to_goal_s"][~arrived]).all()


def test_paths_may_overlap_and_be_runs(grid: list[Path]) -> None:
    runs, problems = load([grid[0], grid[0].parent, grid[0].parent.parent])
    assert len(runs) == len(grid)
    assert problems == []


def test_no_such_folder_and_no_run_at_all(tmp_path: Path) -> None:
    with pytest.raises(RunError, match=r"nowhere: no such file or directory"):
        load([tmp_path / "nowhere"])
    with pytest.raises(ReportError, match="no run under"):
        load([tmp_path])


def test_an_empty_folder_beside_a_full_one_is_named(grid: list[Path], tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    runs, problems = load([grid[0].parent, tmp_path / "empty"])
    assert len(runs) == len(grid)
    assert kinds(problems) == {str(tmp_path / "empty"): "missing"}


@pytest.mark.parametrize(
    ("file", "harm", "kind", "message"),
    [
        ("episodes.csv", "cut", "damaged", "cut short"),
        ("episodes.csv", "column", "damaged", "lacks the columns duration_s"),
        (
            "episodes.csv",
            "nan",
            "damaged",
            "return is not a finite number",
        ),
        ("summary.json", "schema", "foreign", "schema_version 99, but this auvbench reads 1"),
    ],
)
def test_a_damaged_evaluation_is_left_out_and_named(
    grid: list[Path], file: str, harm: str, kind: str, message: str
) -> None:
    damage(grid[0] / "evaluations" / "test" / file, harm)
    runs, problems = load([grid[0].parent])
    assert kinds(problems) == {grid[0].name: kind}
    assert re.search(message, problems[0].message)
    agent = next(a for a in agents(runs)[0] if a.label == "PPO K=1, trained at 10 Hz")
    assert [run.seed for run in agent.runs] == [1]


def test_rows_lost_from_the_middle_or_the_end_are_noticed(grid: list[Path]) -> None:
    path = grid[0] / "evaluations" / "test" / "episodes.csv"
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join(lines[:-3]))
    _, problems = load([grid[0].parent])
    assert "has 9 episodes of condition 'nominal', summary.json says 12" in problems[0].message
    path.write_text("")
    _, problems = load([grid[0].parent])
    assert "episodes.csv: " in problems[0].message
    path.write_text("".join(lines)[:-1])  # even one lost character may be a lost digit
    _, problems = load([grid[0].parent])
    assert "cut short" in problems[0].message


@pytest.mark.parametrize(
    ("lacking", "message"),
    [
        ([11], "cut short"),
        ([1], "nees is missing in some rows of condition 'nominal'"),
        # As a condition without an estimator: only the digest tells the change.
        (range(12), "bytes instead of"),
    ],
)
def test_all_rows_of_a_condition_have_a_column_or_none(
    grid: list[Path], lacking: Iterable[int], message: str
) -> None:
    path = grid[0] / "evaluations" / "test" / "episodes.csv"
    header, *rows = path.read_text().splitlines()
    values = ["" if row in lacking else "3.0" for row in range(12)]
    lines = [f"{header},nees", *(f"{row},{value}" for row, value in zip(rows, values, strict=True))]
    path.write_text("\n".join(lines) + "\n")
    _, problems = load([grid[0].parent])
    assert message in problems[0].message


def test_damaged_manifest_and_config_are_named(grid: list[Path]) -> None:
    (grid[0] / "manifest.json").write_text("{")
    edit(grid[1] / "manifest.json", schema_version=2)
    (grid[2] / "config.yaml").write_text("a: [")
    (grid[3] / "config.yaml").unlink()
    (grid[4] / "manifest.json").unlink()
    runs, problems = load([grid[0].parent])
    assert len(runs) == len(grid) - 5
    expected = ["damaged", "foreign", "damaged", "damaged", "damaged"]
    assert kinds(problems) == {str(path): kind for path, kind in zip(grid, expected, strict=False)}


def test_fields_of_another_type_are_named(grid: list[Path]) -> None:
    edit(grid[0] / "manifest.json", seed=None)
    edit(grid[1] / "evaluations" / "test" / "summary.json", conditions=[{"name": "nominal"}])
    edit(grid[2] / "manifest.json", state="failed", error="just words")
    _, problems = load([grid[0].parent])
    assert kinds(problems) == {str(grid[0]): "damaged", grid[1].name: "damaged", str(grid[2]): "damaged"}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"fingerprint": "f", "conditions": [{"episodes": 12}]}', "conditions[0].name is missing"),
        (
            '{"fingerprint": "f", "conditions": [{"name": "nominal", "episodes": Infinity}]}',
            "Infinity is not JSON",
        ),
        (
            '{"fingerprint": "f", "conditions": '
            '[{"name": "nominal", "episodes": 6, "frequency_hz": 10, "max_steps": 9}]}',
            "has 12 episodes of condition 'nominal', summary.json says 6",
        ),
        ("[" * 100_000, "nested more than"),
        ('{"fingerprint": "f\\r\\u001b[2J", "conditions": []}', "fingerprint is"),
        ('{"fingerprint": 12, "conditions": []}', "fingerprint is 12"),
    ],
)
def test_a_summary_that_no_evaluation_wrote_is_damage(grid: list[Path], text: str, message: str) -> None:
    path = grid[0] / "evaluations" / "test" / "summary.json"
    if text.startswith("{") and "Infinity" not in text:
        seal(path, json.loads(path.read_text()) | json.loads(text))
    else:
        path.write_text(text)
    runs, problems = load([grid[0].parent])
    assert kinds(problems) == {grid[0].name: "damaged"}
    assert message in problems[0].message
    agents(runs)


@pytest.mark.parametrize(
    ("column", "values", "message"),
    [
        ("return", [1e308] * 12, "return is not a finite number up to"),
        ("steps", [-1, *range(1, 12)], "steps is not a whole number from 1"),
        ("steps", [1.5, *range(1, 12)], "steps is not a whole number from 1"),
        ("episode", [1, *range(1, 12)], "has an episode of a condition twice"),
        ("episode", ["x", *range(1, 12)], r"episode is not a whole number from 0 in every row"),
        ("path_efficiency", [np.nan] * 12, "path_efficiency is not a finite number"),
        ("path_efficiency", ["abc"] * 12, "path_efficiency is not a finite number"),
        ("environment", ["abc"] * 12, "environment is not a whole number"),
        ("frequency_hz", ["abc"] * 12, "frequency_hz is not a finite number"),
    ],
)
def test_a_value_that_cannot_be_is_damage(grid: list[Path], column: str, values: list, message: str) -> None:
    path = grid[0] / "evaluations" / "test" / "episodes.csv"
    pd.read_csv(path).assign(**{column: values}).to_csv(path, index=False)
    runs, problems = load([grid[0].parent])
    assert kinds(problems) == {grid[0].name: "damaged"}
    assert re.search(message, problems[0].message)
    agents(runs)


def test_a_column_that_an_older_evaluation_lacks_is_no_damage(grid: list[Path]) -> None:
    path = grid[0] / "evaluations" / "test" / "episodes.csv"
    pd.read_csv(path).drop(columns="path_efficiency").to_csv(path, index=False)
    seal(path.with_name("summary.json"))
    assert load([grid[0].parent])[1] == []


@pytest.mark.parametrize(
    ("config", "message"),
    [
        ("a: 1", "not a run's configuration (algo.name must be a name; it is absent)"),
        ("algo: {name: [1, 2]}", "algo.name must be a name; it is [1, 2]"),
        (
            "algo: {name: ppo}\nstep: {frequency: fast}",
            "step.frequency must be a number of plausible size, got 'fast'",
        ),
        ("algo: {name: ppo}\ntask: {name: [1]}", "task.name must be a name, got [1]"),
        ("algo: {name: ppo}\nvehicle: {name: 7}", "vehicle.name must be a name, got 7"),
        ("algo: {name: ppo}\nreward: {k: .nan}", "reward.k must be a number of plausible size, got nan"),
        ("algo: &a {name: ppo, again: *a}", "is inside"),
    ],
)
def test_a_configuration_that_no_run_has_is_damage(grid: list[Path], config: str, message: str) -> None:
    (grid[0] / "config.yaml").write_text(config)
    runs, problems = load([grid[0].parent])
    assert kinds(problems) == {str(grid[0]): "damaged"}
    assert message in problems[0].message
    agents(runs)


def test_a_manifest_whose_steps_are_no_number_is_damage(grid: list[Path]) -> None:
    edit(grid[0] / "manifest.json", state="running", steps="x", total_steps=[1])
    _, problems = load([grid[0].parent])
    assert [(p.where, p.message) for p in problems] == [
        (str(grid[0]), "manifest.json: steps is 'x', must be a whole number")
    ]


def test_a_list_of_the_configuration_groups_as_its_text(grid: list[Path]) -> None:
    reconfigure(grid[0], noise__sensor=[0.1, 0.2])
    runs, _ = load([grid[0].parent])
    found, _ = agents(runs)
    assert {agent.key["noise.sensor"] for agent in found} >= {"[0.05, 0.1]", "[0.1, 0.2]"}


def test_failed_and_unfinished_runs_are_named(grid: list[Path]) -> None:
    set_state([grid[0]], "failed", "loss is nan")
    set_state([grid[1]], "interrupted")
    _, problems = load([grid[0].parent])
    assert kinds(problems) == {grid[0].name: "failed", grid[1].name: "unfinished"}
    assert "failed at step 1,000: loss is nan" in problems[0].message


def test_a_run_is_running_only_while_a_process_works_on_it(grid: list[Path]) -> None:
    set_state(grid[:2], "running")
    with lock.acquire(grid[0]):
        _, problems = load([grid[0].parent])
        assert len(load([grid[0].parent], where=["state=interrupted"])[0]) == 1
    messages = {problem.where: problem.message for problem in problems}
    assert "running at" in messages[grid[0].name]
    assert "report again" in messages[grid[0].name]
    assert "interrupted at" in messages[grid[1].name]
    assert "repeat its `auvbench train` command" in messages[grid[1].name]


def test_a_killed_run_has_the_steps_of_its_progress_file(grid: list[Path]) -> None:
    set_state(grid[:1], "running")
    seal(grid[0] / "manifest.json", steps=0)
    progress = {"steps": 700, "total_steps": 1000, "steps_per_s": 1.0, "episodes": 3, "success_rate": 0.5}
    (grid[0] / "progress.json").write_text(json.dumps({**progress, "mean_return": None, "time": 0.0}))
    _, problems = load([grid[0].parent])
    assert "interrupted at 700 of " in problems[0].message


def test_a_failed_training_is_a_seed_without_success(grid: list[Path]) -> None:
    set_state([grid[0]], "failed", "loss is nan")
    runs, _ = load([grid[0].parent])
    agent = next(a for a in agents(runs)[0] if a.label == "PPO K=1, trained at 10 Hz")
    assert [run.seed for run in agent.runs] == [0, 1]
    assert (agent.outcome[0] == NO_POLICY).all()
    assert agent.success[0].sum() == 0
    assert np.isnan(agent.metrics["steps"][0]).all()
    assert (agent.metrics["waypoint_z_m"][0] == agent.metrics["waypoint_z_m"][1]).all()
    ranking = rank(agents(runs)[0])
    row = next(row for row in ranking.rows if row.label == agent.label)
    assert row.failed_seeds == (0,)
    assert row.compared
    success, steps = row.estimates["success_rate"].value, row.estimates["par1_steps"].value
    assert success == pytest.approx(agent.success[1].mean() / 2)
    alone = np.where(agent.outcome[1] == 0, agent.metrics["steps"][1], 1000)
    assert steps == pytest.approx((1000 + alone.mean()) / 2)
    assert "PPO K=1, trained at 10 Hz: 1 of 2 trainings failed (seed 0) and count as success 0" in " ".join(
        remarks(ranking)
    )


@pytest.mark.parametrize("failed", [1, 2])
def test_a_failed_training_is_a_seed_without_success_under_each_condition(
    grid: list[Path], failed: int
) -> None:
    for path in grid:
        write_evaluation(path, "robustness", ("nominal", "current=0.5"), 6)
    set_state(grid[:failed], "failed", "loss is nan")
    runs, _ = load([grid[0].parent], ("robustness",))
    for condition in rank(agents(runs, "robustness")[0], protocol="robustness").conditions:
        own = agents(runs, "robustness", condition.name)[0]
        expected = {agent.label: agent.success.mean() for agent in own}
        assert {label: rate.value for label, rate in condition.success.items()} == pytest.approx(expected)
        assert len(own) == len({agent.label for agent in own}) > 1


def test_an_agent_all_of_whose_trainings_failed_is_in_the_table(grid: list[Path]) -> None:
    set_state(grid[:2], "failed", "loss is nan")
    shutil.rmtree(grid[0] / "evaluations")
    runs, _ = load([grid[0].parent])
    row = rank(agents(runs)[0]).rows[-1]
    assert (row.label, row.failed_seeds, row.estimates["success_rate"].value) == (
        "PPO K=1, trained at 10 Hz",
        (0, 1),
        0.0,
    )
    assert np.isnan(row.estimates["mean_steps"].value)


def test_runs_that_were_not_evaluated(grid: list[Path]) -> None:
    shutil.rmtree(grid[0] / "evaluations" / "test")
    runs, problems = load([grid[0].parent])
    assert kinds(problems) == {grid[0].name: "missing"}
    assert f"auvbench evaluate {grid[0]} protocol=test" in problems[0].message
    runs, _ = load([grid[0]])
    with pytest.raises(ReportError, match="none of the 1 runs has a usable evaluation by protocol 'test'"):
        agents(runs)


def test_why_there_is_nothing_to_report(grid: list[Path]) -> None:
    for protocol in ("tset", "../test", "../evaluations/test"):
        runs, problems = load(grid, protocol)
        with pytest.raises(ReportError, match=rf"evaluated by protocol '{protocol}'; .*valid: test$"):
            require(runs, problems, protocol)
    for path in grid:
        damage(path / "evaluations" / "test" / "summary.json", "schema")
    runs, problems = load(grid)
    with pytest.raises(
        ReportError, match=rf"protocol 'test': .*schema_version 99, .* and {len(grid) - 3} more$"
    ):
        require(runs, problems, "test")
    for path in grid:
        shutil.rmtree(path / "evaluations")
    for paths, protocol, command in (
        (grid[:1], "test", f"auvbench evaluate {grid[0]}"),
        (grid, "test", f"auvbench evaluate {grid[0].parent}"),
        (grid, "robustness", f"auvbench evaluate {grid[0].parent} protocol=robustness"),
    ):
        runs, problems = load(paths, protocol)
        with pytest.raises(ReportError, match=rf"tested by protocol '{protocol}'; type {command}$"):
            require(runs, problems, protocol)
    set_state(grid, "failed", "diverged")
    runs, problems = load(grid[:1])
    with pytest.raises(ReportError, match=r"failed at step 1,000: diverged$"):
        require(runs, problems, "test")


def test_what_to_type_for_runs_of_several_folders(grid: list[Path], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(grid[0].parents[2])
    one, other = (path.relative_to(Path.cwd()) for path in grid[:2])
    there = Path.cwd() / "other place" / "b"
    there.mkdir(parents=True)
    other.rename(there / other.name)
    for path in (one, there / other.name):
        shutil.rmtree(path / "evaluations")
    runs, problems = load([one, there])
    with pytest.raises(ReportError) as error:
        require(runs, problems, "test")
    command = f"auvbench evaluate {shlex.quote(str(there))} {one.parent}"
    assert str(error.value) == f"none of the 2 runs was tested by protocol 'test'; type {command}"


def test_two_runs_with_one_id(grid: list[Path], tmp_path: Path) -> None:
    copy = tmp_path / "other" / grid[0].name
    shutil.copytree(grid[0], copy)
    edit(copy / "manifest.json", ended="2027-01-01T00:00:00+00:00")
    runs, problems = load([grid[0].parent, copy])
    assert kinds(problems) == {grid[0].name: "duplicate"}
    assert len(runs) == len(grid)
    assert next(r for r in runs if r.id == copy.name).directory == copy  # the one that ended last


@pytest.mark.slow
def test_conditions(grid: list[Path]) -> None:
    for path in grid[:-1]:
        write_evaluation(path, "robustness", ("nominal", "current=0.5"), 6)
    runs, problems = load([grid[0].parent], ("test", "robustness"))
    assert problems == []  # a second protocol may be absent from a run
    assert available_protocols(runs) == ["robustness", "test"]
    found, _ = agents(runs, protocol="robustness", condition="current=0.5")
    assert {a.outcome.shape for a in found} == {(2, 6)}
    with pytest.raises(ReportError, match=r"no condition 'curent=0.5'; did you mean 'current=0.5'\?"):
        agents(runs, protocol="robustness", condition="curent=0.5")
