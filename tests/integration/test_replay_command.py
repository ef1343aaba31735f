"""auvbench replay: the same row once more, on the terminal, as a figure, as a film."""

from __future__ import annotations

import csv
import dataclasses
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from PIL import Image

from auvbench.cli import main
from auvbench.config.compose import compose
from auvbench.config.validate import evaluate_config
from auvbench.evaluation.replay import replay
from auvbench.identification import csv_log
from auvbench.record import record_columns
from auvbench.registry import TASKS
from auvbench.reporting import replay_pictures as films
from auvbench.runs.directory import RunDirectory
from auvbench.vehicles.sheet import load
from tests import configs


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("replay")
    common = ["task.max_steps=60", "task.waypoint_low=[4,0,-20]", "task.waypoint_high=[5,1,-19]"]
    assert main(["train", "algo=pid", f"output={folder}", *common]) == 0
    assert main(["evaluate", str(folder), "protocol.episodes=4"]) == 0
    (manifest,) = folder.glob("*/*/manifest.json")
    return manifest.parent


@pytest.mark.slow
def test_the_episode_is_the_one_of_the_table(run, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(films, "LONGEST", 10)
    with open(run / "evaluations" / "test" / "episodes.csv", newline="", encoding="utf-8") as file:
        row = list(csv.DictReader(file))[3]
    film = tmp_path / "film.gif"
    assert main(["replay", str(run), "--episode", "3", "--out", str(tmp_path), "--video", str(film)]) == 0
    printed = capsys.readouterr().out
    assert f"{row['outcome']} after {row['steps']} steps" in printed
    assert f"ended {float(row['final_distance_m']):.2f} m" in printed
    with Image.open(tmp_path / "test-nominal-3.png") as figure:
        assert len(figure.convert("L").getcolors()) > 50, "the figure is blank"
    with Image.open(film) as pictures:
        assert pictures.n_frames == min(int(row["steps"]) + 1, films.LONGEST)
        first = pictures.convert("L").tobytes()
        pictures.seek(pictures.n_frames - 1)
        assert pictures.convert("L").tobytes() != first, "nothing moves"


@pytest.mark.slow
def test_several_runs_are_in_one_scene(run, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(films, "LONGEST", 12)
    common = ["task.max_steps=60", "task.waypoint_low=[4,0,-20]", "task.waypoint_high=[5,1,-19]"]
    assert main(["train", "algo=random", f"output={tmp_path / 'other'}", *common]) == 0
    (other,) = (path.parent for path in (tmp_path / "other").glob("*/*/manifest.json"))
    film = tmp_path / "film.gif"
    assert (
        main(["replay", str(run), str(other), "--episode", "3", "--out", str(tmp_path), "--video", str(film)])
        == 0
    )
    assert capsys.readouterr().out.count("command norm") == 2
    with Image.open(film) as pictures:
        assert pictures.n_frames == 12
        pictures.seek(11)
        last = np.asarray(pictures.convert("RGB")).reshape(-1, 3).astype(int)
        assert pictures.info["duration"] > 500, "the end does not stay"
    for colour in ([0, 114, 178], [213, 94, 0]):  # a line of each run
        assert (np.abs(last - colour).sum(axis=1) < 30).any()


@pytest.mark.slow
def test_a_condition_with_a_decimal_point_keeps_its_whole_name(run, tmp_path, monkeypatch):
    monkeypatch.setattr(films, "LONGEST", 3)
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
        (["--protocol", "tst"], "--protocol tst: no such option; did you mean 'test'?"),
        (["--video", "film.avi"], "must end in .gif"),
        (["--frobnicate"], "unknown option '--frobnicate' of replay"),
    ],
)
def test_mistakes_are_named(run, tmp_path, monkeypatch, capsys, arguments, message):
    monkeypatch.chdir(tmp_path)
    assert main(["replay", str(run), "--out", str(tmp_path), *arguments]) == 2
    assert message in capsys.readouterr().err


def test_the_film_is_checked_before_anything_is_computed(run, tmp_path, monkeypatch, capsys):
    from auvbench.evaluation import replay

    def never(*_):
        raise AssertionError("replayed before the film's name was looked at")

    monkeypatch.setattr(replay, "replay", never)
    (tmp_path / "file").write_text("")
    for name, message in (
        ("film.avi", "must end in .gif"),
        ("film.mp4", "must end in .gif"),
        ("file/film.gif", "cannot be written"),
    ):
        assert main(["replay", str(run), "--video", str(tmp_path / name)]) == 2
        assert message in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def an_episode(steps):
    """A replayed episode that needs no simulation."""
    from auvbench.evaluation.replay import Replay

    time = np.linspace(0, steps / 10, steps + 1, dtype=np.float32)
    position = np.stack([time, np.sin(time), -20 + 0 * time], axis=1).astype(np.float32)
    record = {"episode": 0, "outcome": "timeout", "steps": steps}
    names = tuple(f"thruster{i}" for i in range(1, 7))
    command = np.sin(np.arange(6 * steps, dtype=np.float32)).reshape(steps, 6)
    waypoint = np.array([50, 1, -20], dtype=np.float32)
    config = configs.training()
    return Replay(
        "pid-k1", "test", "nominal", config, names, record, time, position, time % 3, command, waypoint
    )


@pytest.mark.slow
def test_a_film_draws_its_axes_once(tmp_path, monkeypatch):
    monkeypatch.setattr(films, "LONGEST", 30)
    drawn = []
    whole = Figure.draw
    monkeypatch.setattr(Figure, "draw", lambda *arguments: (drawn.append(1), whole(*arguments))[1])
    films.film([an_episode(1000)], tmp_path / "film.gif")
    assert len(drawn) == 2, "to settle the layout, and as the background of all pictures"
    with Image.open(tmp_path / "film.gif") as pictures:
        assert pictures.n_frames == 30
        assert pictures.size == (832, 352)


@pytest.mark.slow
def test_a_picture_of_the_film_is_the_scene_drawn_anew():
    """Drawing over a background must not leave traces of the pictures before."""
    episode = an_episode(40)
    *_, last = films.pictures([episode], [0.0, 1.0, 2.0, 4.0])
    (alone,) = films.pictures([episode], [4.0])
    assert np.array_equal(last, alone)


def test_a_folder_of_runs_is_no_run(tmp_path, capsys):
    assert main(["replay", str(tmp_path)]) == 2
    assert "not a run directory" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("task", [name for name in TASKS if name != "waypoint"])
def test_each_task_is_drawn_with_its_reference_or_its_dock(task, tmp_path, monkeypatch):
    monkeypatch.setattr(films, "LONGEST", 5)
    words = [f"task={task}", "vehicle=bluerov2_heavy", "task.time_limit=2.0"]
    words += ["task.hold_time=1.0"] if task == "station_keeping" else []
    words += ["task.settling=0.5"] if task in ("station_keeping", "terrain") else []
    assert main(["train", "algo=pid", f"output={tmp_path}", *words]) == 0
    path = next((tmp_path / "default").glob("*/manifest.json")).parent
    protocol = evaluate_config(compose("evaluate", [])).protocol
    shown = replay(RunDirectory(path), protocol, "nominal", 0)
    moving = ("trajectory_tracking", "path_following", "terrain", "formation", "rendezvous", "tracking")
    assert (shown.reference is not None) == (task in moving)
    assert (shown.others is not None) == (task == "formation")
    assert (shown.dock_yaw is not None) == (task == "docking")
    target = shown.waypoint if shown.reference is None else shown.reference
    assert shown.distance[-1] == np.float32(np.linalg.norm(shown.position - target, axis=1)[-1])
    film, plain = films.film([shown], tmp_path / "film.gif"), tmp_path / "plain.gif"
    films.film([dataclasses.replace(shown, reference=None, dock_yaw=None)], plain)
    same = film.read_bytes() == plain.read_bytes()
    assert same == (task in ("station_keeping", "transit")), "the reference or the dock is not drawn"


@pytest.mark.slow
def test_signals_are_a_log_of_the_episode(run, tmp_path):
    """The table is what `auvbench identify` reads; its last row is the end of the episode's row."""
    file = tmp_path / "signals.csv"
    with open(run / "evaluations" / "test" / "episodes.csv", newline="", encoding="utf-8") as rows:
        row = list(csv.DictReader(rows))[2]
    assert main(["replay", str(run), "--episode", "2", "--out", str(tmp_path), "--signals", str(file)]) == 0
    table = pd.read_csv(file)
    assert len(table) == int(row["steps"]) + 1
    assert table["reference.distance_m"].iloc[-1] == pytest.approx(float(row["final_distance_m"]), abs=1e-5)
    assert table["vehicle.power_W"].sum() * 0.1 == pytest.approx(float(row["energy_J"]), rel=1e-5)
    assert table["task.reward"].sum() == pytest.approx(float(row["return"]), rel=1e-5)
    log = csv_log.read(file)
    assert log.kind == "command"
    assert log.actuators == load("bluerov2_2026").actuators
    np.testing.assert_allclose(
        log.measured[:, 6:9],
        table[["observed.velocity_x_mps", "observed.velocity_y_mps", "observed.velocity_z_mps"]],
    )


@pytest.mark.slow
def test_signals_without_a_name_are_drawn_and_written_next_to_the_figure(run, tmp_path):
    common = ["replay", str(run), "--protocol", "robustness", "--out", str(tmp_path), "--signals"]
    assert main([*common, "--condition", "current=0.5"]) == 0
    stem = tmp_path / "robustness-current=0.5-0-signals"
    with Image.open(f"{stem}.png") as figure:
        assert len(figure.convert("L").getcolors()) > 50, "the figure is blank"
    table = pd.read_csv(f"{stem}.csv")
    current = table[["current.east_mps", "current.north_mps", "current.up_mps"]]
    np.testing.assert_allclose(np.linalg.norm(current, axis=1), 0.5, atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--signals", "a.pdf"], "--signals a.pdf: must end in .png, .svg or .csv"),
        (["{run}", "--signals"], "--signals: shows one run, and 2 are named; name one"),
    ],
)
def test_signals_that_cannot_be_written(run, words, message, capsys):
    assert main(["replay", str(run), *(word.format(run=run) for word in words)]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize("task", list(TASKS))
def test_each_task_has_an_accuracy_that_a_summary_can_name(task: str) -> None:
    for world in ("open", "field"):
        record = dict.fromkeys(record_columns(task, world), 1.5)
        assert films._accuracy(record).endswith(" 1.50 m")
