"""`auvbench report` and `auvbench publish` on runs whose experiment declared its analysis."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from auvbench.cli import main
from auvbench.runs import declared, integrity
from auvbench.runs.declared import Declared
from tests.synthetic import write_evaluation, write_experiment

ANALYSIS = Declared("par1_steps", "ppo", 7.0, 2)
"""A declaration of an earlier version, which names no runs"""
FIRST, SECOND = "2026-11-25T19:00:00+00:00", "2026-11-27T09:00:00+00:00"


@pytest.fixture
def runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """PPO, SAC and PID, made after their analysis was declared."""
    monkeypatch.chdir(tmp_path)
    found = write_experiment(
        tmp_path / "outputs/grid",
        algorithms=("ppo", "sac", "pid"),
        seeds=(0, 1),
        episodes=30,
        train_episodes=20,
    )
    declared.write(tmp_path / "outputs/grid", ANALYSIS)
    for run in found:
        carry(run, ANALYSIS.digest)
    return found


def carry(run: Path, digest: str, **changes: str) -> None:
    manifest = json.loads((run / "manifest.json").read_text()) | {declared.KEY: digest} | changes
    (run / "manifest.json").write_text(json.dumps(integrity.sealed(manifest)))


def report(*words: str) -> tuple[list[dict[str, str]], str]:
    """The rows of table.csv, and report.md."""
    assert main(["report", "outputs/grid", *words, "--format", "csv,md", "--no-figures", "--out", "out"]) == 0
    with open("out/table.csv", newline="") as file:
        return list(csv.DictReader(file)), Path("out/report.md").read_text()


def test_the_declared_analysis_is_the_default(runs: list[Path]) -> None:
    rows, text = report()
    assert {row["baseline"] for row in rows} == {"PPO"}
    assert {float(row["margin"]) for row in rows} == {7.0}
    steps = [float(row["par1_steps"]) for row in rows]
    assert steps == sorted(steps)
    assert f"Declared before the first run ({ANALYSIS.digest})" in text
    assert "Agents, protocol and conditions were not part of the declaration" in text


def test_what_is_typed_beats_it_and_is_said(runs: list[Path]) -> None:
    rows, text = report("--baseline", "pid")
    assert {row["baseline"] for row in rows} == {"PID"}
    assert f"Not the declared analysis ({ANALYSIS.digest}): --baseline pid." in text


def test_runs_that_were_made_before_it_are_counted(runs: list[Path]) -> None:
    carry(runs[0], "0" * 16)
    assert "declared after 1 of 5 runs were made" in report()[1]


def test_another_number_of_seeds_than_planned_is_said(runs: list[Path]) -> None:
    more = Declared("par1_steps", "ppo", 7.0, 5)
    declared.write(Path("outputs/grid"), more)
    text = report()[1]
    assert "declared after 5 of 5 runs were made" in text
    assert "Planned: 5 seeds; PPO has 2 and SAC has 2." in text


def test_without_one_the_report_says_so(runs: list[Path]) -> None:
    (Path("outputs/grid") / declared.FILE).unlink()
    rows, text = report()
    assert {row["baseline"] for row in rows} == {"PID"}
    assert "No analysis was declared before the runs." in text


def test_several_leave_the_choice_to_the_user(runs: list[Path]) -> None:
    declared.write(Path("outputs/other"), Declared("success_rate"))
    assert (
        main(["report", "outputs/grid", "outputs/other", "--format", "md", "--no-figures", "--out", "out"])
        == 0
    )
    assert "everal analyses are declared" in Path("out/report.md").read_text()


def test_a_baseline_that_a_part_of_the_runs_lacks_is_no_error(runs: list[Path]) -> None:
    rows, text = report("--where", "algo!=ppo")
    assert {row["baseline"] for row in rows} == {"PID"}
    assert "--baseline 'ppo' is not one of the agents" in text.replace("\\", "")


@pytest.mark.slow
def test_a_published_study_reports_itself_without_flags(runs: list[Path], tmp_path: Path) -> None:
    words = ["--rank-by", "par1_steps", "--columns", "collision_rate", "--pictures", "success_over_time"]
    assert main(["publish", "outputs/grid", "--to", "results/grid", *words]) == 0
    stored = declared.read(tmp_path / "results/grid" / declared.FILE)
    assert stored == Declared("par1_steps", "ppo", 7.0, 2, report={"columns": ["collision_rate"]})
    assert stored.digest == ANALYSIS.digest
    assert main(["report", "results/grid", "--format", "csv", "--out", "again"]) == 0
    shipped = tmp_path / "results/grid"
    for name in ("table.csv", "comparisons.csv", "verdicts.json"):
        if (shipped / name).is_file():
            assert (shipped / name).read_bytes() == (tmp_path / "again" / name).read_bytes()
    readme = (shipped / "README.md").read_text()
    assert "Declared before the first run" in readme
    block = readme.partition("<!-- begin: table -->")[2]
    assert block.index("**") < block.index("figures/difference_from_baseline.png") < block.index("| agent |")


@pytest.fixture
def declared_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Declared:
    """PPO and PID, declared first; SAC, declared later, when the others were finished."""
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "outputs/grid"
    found = write_experiment(
        folder,
        algorithms=("ppo", "sac", "pid"),
        seeds=(0, 1),
        episodes=30,
        train_episodes=20,
        protocols={"test": ("nominal", "current=1"), "suite": ("nominal",)},
    )
    analysis = Declared("par1_steps", "pid", 7.0, None, "test", ("nominal", "current=1"), 30, 123)
    later = [run for run in found if run.name.startswith("sac")]
    first = [run for run in found if run not in later]
    subject = declared.subject("bluerov2", "waypoint")
    declared.declare(folder, analysis, {subject: [run.name for run in first]}, FIRST)
    whole = declared.declare(folder, analysis, {subject: [run.name for run in found]}, SECOND)
    for run in found:
        stage = whole.stage_of(run.name)
        assert stage is not None
        carry(run, stage[1], created=stage[0].declared, ended=stage[0].declared)
    return whole


def test_runs_that_are_declared_later_are_named_with_their_date(declared_runs: Declared) -> None:
    text = report()[1]
    assert f"declared on 25 November 2026, before the first run ({declared_runs.digests[0]})" in text
    assert "Declared later: SAC (27 November 2026, after 3 of 5 runs)." in text


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--where", "algo!=sac"], "2 of 5 declared runs are missing (sac)"),
        (["--where", "algo=sac,pid"], "2 of 5 declared runs are missing (ppo)"),
        (["--where", "seed!=1"], "2 of 5 declared runs are missing (ppo and sac)"),
        (["--where", "algo!=pid"], "the baseline is SAC instead of pid"),
        (["--baseline", "ppo"], "--baseline ppo"),
        (["--rank-by", "success_rate"], "--rank-by success_rate"),
        (["--margin", "5"], "--margin 5"),
        (["--confidence", "0.9"], "--confidence 0.9"),
        (["--condition", "current=1"], "--condition current=1"),
        (["--protocol", "suite"], "--protocol suite"),
    ],
)
def test_anything_else_than_the_declared_analysis_is_named(
    declared_runs: Declared, words: list[str], said: str
) -> None:
    text = report(*words)[1].replace("\\", "")
    assert f"Not the declared analysis ({declared_runs.digest})" in text
    assert said in text


@pytest.mark.parametrize(
    "words",
    [
        ["--baseline", "PID"],
        ["--condition", "nominal"],
        ["--where", "algo=ppo,sac,pid"],
        ["--confidence", "0.95"],
    ],
)
def test_the_declared_analysis_typed_in_other_words_is_the_declared_one(
    declared_runs: Declared, words: list[str]
) -> None:
    assert "Not the declared analysis" not in report(*words)[1]


def test_runs_and_scenarios_that_were_not_declared_are_named(declared_runs: Declared) -> None:
    write_experiment(Path("outputs/grid"), algorithms=("td3",), seeds=(0, 1), episodes=30, train_episodes=5)
    assert "2 runs were not declared (TD3)" in report()[1]
    for run in Path("outputs/grid").glob("*/manifest.json"):
        write_evaluation(run.parent, "test", ("nominal",), 25, 0)
    assert "25 test episodes instead of 30" in report()[1]


def test_a_single_run_of_a_declared_grid_is_not_the_declared_analysis(declared_runs: Declared) -> None:
    runs = [
        str(run.parent)
        for run in Path("outputs/grid").glob("*/manifest.json")
        if "pid" not in run.parent.name
    ]
    assert main(["report", *runs, "--format", "md", "--no-figures", "--out", "out"]) == 0
    assert "1 of 5 declared runs is missing (pid)" in Path("out/report.md").read_text()


@pytest.mark.slow
def test_a_published_study_keeps_its_declaration(declared_runs: Declared) -> None:
    assert main(["publish", "outputs/grid", "--to", "results/grid", "--pictures", "", "--no-paths"]) == 0
    assert declared.read(Path("results/grid") / declared.FILE) == declared_runs
    assert (
        "Declared later: SAC (27 November 2026, after 3 of 5 runs)."
        in Path("results/grid/README.md").read_text()
    )
    assert (
        main(["report", "results/grid", "outputs/grid", "--format", "md", "--no-figures", "--out", "both"])
        == 0
    )
    assert "before the first run" in Path("both/report.md").read_text()
