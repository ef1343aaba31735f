"""auvbench replay: the same row once more, on the terminal, as a figure, as a film."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest
from PIL import Image

from auvbench.cli import main
from auvbench.reporting.replay import LONGEST_FILM


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("replay")
    common = ["task.max_steps=60", "task.waypoint_low=[4,0,-20]", "task.waypoint_high=[5,1,-19]"]
    assert main(["train", "algo=pid", f"output={folder}", *common]) == 0
    assert main(["evaluate", str(folder), "protocol.episodes=4"]) == 0
    (manifest,) = folder.glob("*/*/manifest.json")
    return manifest.parent


def test_the_episode_is_the_one_of_the_table(run, tmp_path, capsys):
    with open(run / "evaluations" / "test" / "episodes.csv", newline="", encoding="utf-8") as file:
        row = list(csv.DictReader(file))[3]
    film = tmp_path / "film.gif"
    assert main(["replay", str(run), "--episode", "3", "--out", str(tmp_path), "--video", str(film)]) == 0
    printed = capsys.readouterr().out
    assert f"{row['outcome']} after {row['steps']} steps" in printed
    assert f"ended {float(row['final_distance_m']):.2f} m" in printed
    assert printed.count("thruster") >= 6
    with Image.open(tmp_path / "test-nominal-3.png") as figure:
        assert len(figure.convert("L").getcolors()) > 50, "the figure is blank"
    with Image.open(film) as pictures:
        assert pictures.n_frames == min(int(row["steps"]) + 1, LONGEST_FILM)
        first = pictures.convert("L").tobytes()
        pictures.seek(pictures.n_frames - 1)
        assert pictures.convert("L").tobytes() != first, "nothing moves"


def test_a_condition_with_a_decimal_point_keeps_its_whole_name(run, tmp_path):
    common = ["replay", str(run), "--protocol", "robustness", "--out", str(tmp_path)]
    assert main([*common, "--condition", "current=0.5", "--episode", "2", "--video"]) == 0
    assert main([*common, "--condition", "current=0.75", "--episode", "7"]) == 0
    written = [f"robustness-current=0.5-2.{kind}" for kind in ("gif", "png", "svg")]
    written += [f"robustness-current=0.75-7.{kind}" for kind in ("png", "svg")]
    assert sorted(path.name for path in tmp_path.iterdir()) == written


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--episode", "500"], "protocol test has episodes 0 to 499"),
        (["--condition", "nominl"], "did you mean 'nominal'?"),
        (["--protocol", "tst"], "did you mean 'test'?"),
        (["--video", "film.avi"], "must end in .mp4 or .gif"),
        (["--frobnicate"], "--frobnicate: no such flag"),
    ],
)
def test_mistakes_are_named(run, tmp_path, monkeypatch, capsys, arguments, message):
    monkeypatch.chdir(tmp_path)
    assert main(["replay", str(run), "--out", str(tmp_path), *arguments]) == 2
    assert message in capsys.readouterr().err


def test_a_folder_of_runs_is_no_run(tmp_path, capsys):
    assert main(["replay", str(tmp_path)]) == 2
    assert "no run directory" in capsys.readouterr().err
