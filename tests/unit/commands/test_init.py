"""`auvbench init` makes a project whose controller, vehicle, task and experiment run."""

from __future__ import annotations

import csv
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from auvbench import cli
from auvbench.config.compose import compose


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    assert cli.main(["init", "my-study"]) == 0
    monkeypatch.chdir("my-study")
    return tmp_path / "my-study"


def test_nothing_in_it_has_the_examples_name(project: Path) -> None:
    assert tomllib.loads((project / "pyproject.toml").read_text())["project"]["name"] == "my-study"
    assert (project / "my_study" / "pursuit.py").is_file()
    for path in project.rglob("*"):
        assert "example" not in path.name
        if path.is_file():
            assert "auvbench_example" not in path.read_text(encoding="utf-8"), path


def test_its_vehicle_and_task_compose(project: Path) -> None:
    config = compose("train", ["vehicle=my_vehicle", "task=my_task"])
    assert config.vehicle.rigid_body.mass.value == 13.2
    assert config.task.goal_radius == 1.0


@pytest.mark.parametrize("name", ["My Study", "1st", "a--b", "auvbench", "there", "class", "json", "numpy"])
def test_a_wrong_name_writes_nothing(tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "there").mkdir()
    assert cli.main(["init", str(tmp_path / name)]) == 2
    assert name in capsys.readouterr().err
    assert [path.name for path in tmp_path.rglob("*")] == ["there"]


@pytest.mark.slow
def test_what_its_readme_says_to_type_runs(project: Path, tmp_path: Path) -> None:
    site = tmp_path / "site"
    pip = ["-m", "pip", "install", "-q", "--no-deps", "--no-build-isolation", "--target", str(site), "."]
    auvbench = ["-m", "auvbench"]
    environment = os.environ | {"PYTHONPATH": str(site)}
    for words in (
        pip,
        [*auvbench, "train", "-m", "experiment=first"],
        [*auvbench, "evaluate", "outputs/first", "protocol=own", "protocol.episodes=10"],
        [*auvbench, "report", "outputs/first", "--protocol", "own"],
    ):
        done = subprocess.run(
            [sys.executable, *words], env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
    with (project / "outputs" / "first" / "report" / "table.csv").open() as file:
        rows = {row["agent"]: float(row["success_rate"]) for row in csv.DictReader(file)}
    assert rows.keys() == {"pursuit", "PID"}
    assert rows["PID"] > 0.5
