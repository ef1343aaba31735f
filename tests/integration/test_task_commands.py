"""Tasks other than the waypoint task through the commands: train, evaluate, report, replay."""

from __future__ import annotations

import csv
import json
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from auvbench.cli import main
from auvbench.record import record_columns

WORDS = ("algo=pid,random", "vehicle=bluerov2_heavy", "name=two")
EPISODES = ("protocol.episodes=12", "protocol.trajectories=2")


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """PID and random on station keeping and path following, tested on a dozen episodes."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("tasks"))
        assert main(["train", "-m", "task=station_keeping,path_following", *WORDS]) == 0
        assert main(["evaluate", "outputs/two", *EPISODES]) == 0
        yield Path("outputs/two")


def test_a_report_ranks_each_task_by_its_own_measure(study: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["report", str(study), "--format", "terminal,csv,html"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "vehicle bluerov2_heavy, task path_following" in said
    with open(study / "report/table.csv", newline="") as file:
        rows = {(row["vehicle"], row["agent"]): row for row in csv.DictReader(file)}
    station = rows["bluerov2_heavy, task station_keeping", "PID"]
    assert 0.01 < float(station["mean_position_error_rms_m"]) < 0.1
    path = rows["bluerov2_heavy, task path_following", "random"]
    assert float(path["mean_cross_track_rms_m"]) == 10.0
    assert path["verdict"] == "behind"
    assert "a quick failure looks good" not in said


def test_a_report_of_several_tasks_has_a_score(study: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["report", str(study), "--format", "terminal,csv,html,md,tex"]) == 0
    assert "score across tasks" in capsys.readouterr().out
    with open(study / "report/score.csv", newline="") as file:
        rows = {row["agent"]: row for row in csv.DictReader(file)}
    assert {name: float(row["score"]) for name, row in rows.items()} == {"PID": 1.0, "random": 0.0}
    assert rows["PID"]["measure: path following"] == "mean_cross_track_rms_m"
    assert rows["PID"]["score: station keeping"] == "1.0"
    assert rows["PID"]["score_low"] == "1.0"  # it is the scale
    page = (study / "report/index.html").read_text()
    assert page.index('id="score"') < page.index('id="part-1"')
    assert "## Score across tasks" in (study / "report/report.md").read_text()
    assert r"\toprule" in (study / "report/score.tex").read_text()


def test_a_published_study_of_several_tasks_starts_with_the_score(study: Path) -> None:
    words = ["--to", "results/two", "--pictures", "", "--no-paths", "--compact"]
    assert main(["publish", str(study), *words]) == 0
    readme = Path("results/two/README.md").read_text()
    assert "figures/difference_from_baseline.png" in readme
    assert "## Figures" not in readme
    scores = readme.index("### Score across tasks, undisturbed, protocol test")
    assert scores < readme.index("### Vehicle bluerov2_heavy, task station_keeping")
    with open("results/two/score.csv", newline="") as file:
        rows = {(row["protocol"], row["agent"]): float(row["score"]) for row in csv.DictReader(file)}
    assert rows == {("test", "PID"): 1.0, ("test", "random"): 0.0}


def test_without_random_a_report_names_the_command_that_adds_it(
    study: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--format", "terminal,csv,html", "--out", str(tmp_path), "--where", "algo=pid"]
    assert main(["report", str(study), *words]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "auvbench train task=path_following vehicle=bluerov2_heavy algo=random name=two" in said
    assert not (tmp_path / "score.csv").exists()
    assert 'id="score-table"' not in (tmp_path / "index.html").read_text()


def test_the_command_that_adds_random_names_the_folder_of_the_runs(
    study: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = tmp_path / "else where" / "copy"
    shutil.copytree(study, copy)
    assert main(["report", str(copy), "--format", "terminal", "--where", "algo=pid"]) == 0
    said = capsys.readouterr().out.replace("\n", "").replace(" ", "")
    output = os.path.relpath(copy.parent).replace(" ", "")
    assert f"algo=random'output={output}'name=copy&&auvbenchevaluate'{str(copy).replace(' ', '')}'" in said


def test_a_baseline_that_no_task_has_is_answered_with_those_there_are(
    study: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["report", str(study), "--baseline", "pidd", "--out", str(tmp_path)]) == 2
    assert "valid: PID, random" in capsys.readouterr().err


def test_a_margin_needs_one_unit(study: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["report", str(study), "--margin", "0.1", "--out", str(tmp_path), "--format", "csv"]
    assert main(words) == 2
    assert "--margin 0.1: " in capsys.readouterr().err
    assert main([*words, "--where", "task=path_following"]) == 0


def test_rows_have_the_columns_of_the_task(study: Path) -> None:
    for run in study.glob("*-station_keeping-*"):
        with open(run / "evaluations/test/episodes.csv", newline="") as file:
            header = next(csv.reader(file))
        assert header == ["condition", "frequency_hz", *record_columns("station_keeping")]
        summary = json.loads((run / "evaluations/test/summary.json").read_text())
        assert "out_of_bounds_rate" in summary["conditions"][0]


def test_a_run_is_tested_by_the_values_of_the_file(study: Path) -> None:
    main(
        [
            "train",
            "task=station_keeping",
            "task.tolerance=2",
            "algo=pid",
            "vehicle=bluerov2_heavy",
            "name=own",
        ]
    )
    assert main(["evaluate", "outputs/own", *EPISODES]) == 0
    prints = {
        json.loads(path.read_text())["fingerprint"]
        for folder in (study, Path("outputs/own"))
        for path in folder.glob("*-station_keeping-*/evaluations/test/summary.json")
    }
    assert len(prints) == 1


@pytest.mark.parametrize("task", ["station_keeping", "path_following"])
def test_an_episode_is_replayed(study: Path, task: str, capsys: pytest.CaptureFixture[str]) -> None:
    (run,) = study.glob(f"pid-*-{task}-*")
    assert main(["replay", str(run), "--out", "pictures"]) == 0
    assert "success after" in capsys.readouterr().out


def test_agents_of_two_tasks_are_not_compared(study: Path, capsys: pytest.CaptureFixture[str]) -> None:
    runs = sorted(map(str, study.glob("pid-*")))
    assert main(["compare", *runs]) == 2
    said = capsys.readouterr().err
    assert "task=path_following" in said
    assert "task=station_keeping" in said


def test_bounds_are_of_waypoints_alone(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bound", "task=docking"]) == 2
    assert "only for the waypoint task" in capsys.readouterr().err
