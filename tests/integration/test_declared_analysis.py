"""`auvbench report` and `auvbench publish` on runs whose experiment declared its analysis."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from auvbench.cli import main
from auvbench.runs import declared, integrity
from auvbench.runs.declared import Declared
from tests.synthetic import write_experiment

ANALYSIS = Declared("par1_steps", "ppo", 7.0, 2)


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


def carry(run: Path, digest: str) -> None:
    manifest = json.loads((run / "manifest.json").read_text()) | {declared.KEY: digest}
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
    assert f"declared before the first run ({ANALYSIS.digest})" in text


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
    assert "--baseline 'ppo' is not among the agents" in text.replace("\\", "")


@pytest.mark.slow
def test_a_published_study_reports_itself_without_flags(runs: list[Path], tmp_path: Path) -> None:
    words = ["--rank-by", "par1_steps", "--columns", "collision_rate", "--pictures", "success_over_time"]
    assert main(["publish", "outputs/grid", "--to", "results/grid", *words]) == 0
    stored = declared.read(tmp_path / "results/grid" / declared.FILE)
    assert stored == Declared("par1_steps", "ppo", 7.0, 2, {"columns": ["collision_rate"]})
    assert stored.digest == ANALYSIS.digest
    assert main(["report", "results/grid", "--format", "csv", "--out", "again"]) == 0
    shipped = tmp_path / "results/grid"
    for name in ("table.csv", "comparisons.csv", "verdicts.json"):
        if (shipped / name).is_file():
            assert (shipped / name).read_bytes() == (tmp_path / "again" / name).read_bytes()
    readme = (shipped / "README.md").read_text()
    assert "declared before the first run" in readme
    block = readme.partition("<!-- begin: table -->")[2]
    assert block.index("**") < block.index("figures/difference_from_baseline.png") < block.index("| agent |")
