"""Bottoms from files: what is read, and what is refused."""

from __future__ import annotations

import io
import os
import pickle
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from auvbench.cli import main
from auvbench.config.compose import compose
from auvbench.envs.batch import Batch
from auvbench.envs.settings import configuration
from auvbench.errors import ConfigError
from auvbench.runs.plan import plan
from auvbench.worlds import grids
from auvbench.worlds.casting import range_below

Floats = NDArray[np.float64]
X, Y = np.arange(500.0, 541.0), np.arange(-30.0, 31.0)


def bottom(x: Any = X, y: Any = Y) -> Floats:
    """Return heights (rows, columns) in m."""
    return np.asarray(-30.0 + 0.1 * (x - 520.0) + 2.0 * np.cos(0.2 * y)[:, None])


def npz(folder: Path, **arrays: Any) -> Path:
    path = folder / "bottom.npz"
    np.savez(path, **arrays)
    return path


def csv(folder: Path, text: str) -> Path:
    path = folder / "bottom.csv"
    path.write_text(text, encoding="utf-8")
    return path


def points(x: Floats = X, y: Floats = Y, heights: str = "z_m", sign: float = 1.0) -> str:
    """Return a table of the bottom's points in a drawn order."""
    z = sign * bottom(x, y)
    order = np.random.default_rng(0).permutation(z.size)
    rows, columns = np.unravel_index(order, z.shape)
    lines = [f"{x[c]!r},{y[r]!r},{z[r, c]!r}" for r, c in zip(rows, columns, strict=True)]
    return "\n".join([f"x_m,y_m,{heights}", *lines, ""]).replace("np.float64(", "").replace(")", "")


def diving(path: Path, *words: str, n: int = 2) -> Batch:
    chosen = [
        "task=docking",
        "vehicle=bluerov2_heavy",
        "algo=pid",
        "world=bottom",
        "world.vehicle_radius=0.3",
    ]
    return Batch(configuration(overrides=[*chosen, f"world.bottom.file={path}", *words]), n)


# --- What is read ----------------------------------------------------------------------------------------------------------------


def test_tables_and_arrays_have_the_same_heights(tmp_path: Path) -> None:
    arrays = grids.read(npz(tmp_path, x_m=X, y_m=Y, z_m=bottom()))
    for heights, sign in (("z_m", 1.0), ("depth_m", -1.0)):
        table = grids.read(csv(tmp_path, points(heights=heights, sign=sign)))
        assert (table.z == bottom()).all()
        assert (table.x == X).all()
        assert table.spacing == arrays.spacing == 1.0
    assert (arrays.z == table.z).all()
    assert arrays.sha256 != table.sha256


def test_whole_numbers_and_rounded_coordinates_are_read(tmp_path: Path) -> None:
    deep = np.full((4, 5), -30)
    assert grids.read(npz(tmp_path, x_m=np.arange(5), y_m=np.arange(4), z_m=deep)).z.dtype == np.float64
    thirds = np.round(np.arange(30) / 3.0, 3)
    grid = grids.read(npz(tmp_path, x_m=thirds, y_m=thirds, z_m=np.full((30, 30), -5.0)))
    assert grid.spacing == pytest.approx(1.0 / 3.0, rel=1e-4)


@pytest.mark.parametrize("origin", [None, [530.0, 5.0]])
def test_the_bottom_is_where_the_file_has_it_and_mirrored_beyond(tmp_path: Path, origin: Any) -> None:
    words = [] if origin is None else [f"world.bottom.origin={origin}".replace(" ", "")]
    east, north = origin or (520.0, 0.0)
    batch = diving(npz(tmp_path, x_m=X, y_m=Y, z_m=bottom()), *words, "task.start_high=6")
    batch.reset()
    assert batch.task.world is not None
    solids, heights, _ = batch.task.world.loops
    drawn = np.random.default_rng(1).uniform([-5.0, -20.0], [5.0, 20.0], (20, 2))
    on_vertices = np.round(drawn)
    for x, y in on_vertices:
        depth = range_below(solids[0, :1], heights, 0.0, (x, y, 0.0), 1e3)
        assert -depth == pytest.approx(bottom(x + east, np.array([y + north]))[0], abs=1e-9)
    edge = X[-1] - east
    inside, beyond = (
        range_below(solids[0, :1], heights, 0.0, (edge + side, 3.0, 0.0), 1e3) for side in (-2.5, 2.5)
    )
    assert inside == pytest.approx(beyond, abs=1e-9)


def test_the_name_of_the_world_and_the_run_follow_the_content_of_the_file(tmp_path: Path) -> None:
    first = npz(tmp_path, x_m=X, y_m=Y, z_m=bottom())
    same, other = tmp_path / "same.npz", tmp_path / "other.npz"
    same.write_bytes(first.read_bytes())
    np.savez(other, x_m=X, y_m=Y, z_m=bottom() - 1e-3)
    names, runs = [], []
    for path in (first, same, other):
        batch = diving(path, "task.start_high=6", n=1)
        batch.reset()
        assert batch.task.world is not None
        names.append(batch.task.world.name(0, 1))
        words = ["algo=pid", "world=bottom", f"world.bottom.file={path}"]
        runs.append(plan(compose("train", words)).run.path.name)
        assert plan(compose("train", words)).values["world"]["bottom"]["sha256"] == grids.read(path).sha256
    assert names[0] == names[1] != names[2]
    assert names[0].startswith("bottom-")
    assert runs[0] == runs[1] != runs[2]


# --- What is refused -------------------------------------------------------------------------------------------------------------


def holes() -> Floats:
    z = bottom()
    z[3, 4] = np.nan
    return z


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"z_m": holes()}, r"points without a height \(1\), the first at x=504, y=-27 m"),
        ({"z_m": bottom().T}, r"x_m \(41,\), y_m \(61,\), z_m \(41, 61\)"),
        ({"x_m": X[::-1], "z_m": bottom()}, "x_m that does not rise evenly"),
        ({"x_m": (X - 499.0) ** 1.2, "z_m": bottom()}, "x_m that does not rise evenly"),
        ({"x_m": 2.0 * X, "z_m": bottom()}, "2 m between its points along x and 1 m along y"),
        ({"x_m": 1e-5 * X, "y_m": 1e-5 * Y, "z_m": bottom()}, "not degrees"),
        ({"z_m": -bottom()}, "z_m is up from the surface; change the signs, or call it depth_m"),
        ({"depth_m": bottom()}, "depth_m is down from the surface; change the signs, or call it z_m"),
        ({"z_m": 1e3 * bottom()}, "z_m is in m, not cm or mm"),
        ({"z_m": bottom(), "depth_m": -bottom()}, "either z_m or depth_m"),
        ({"z_cm": bottom()}, "unknown array 'z_cm'"),
        ({"x_m": X[:3], "z_m": bottom()[:, :3]}, "3 different x_m; must have at least 4"),
        ({"x_m": np.arange(1025.0), "y_m": np.arange(1024.0), "z_m": np.zeros((1024, 1025))}, "at most 1,048,576"),
        ({"z_m": bottom().astype(str)}, "z_m that is not numeric; must be numbers"),
        ({"z_m": bottom().astype(object)}, "allow_pickle"),
    ],
)  # fmt: skip
def test_wrong_arrays_are_refused(tmp_path: Path, arrays: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message) as error:
        grids.read(npz(tmp_path, **({"x_m": X, "y_m": Y} | arrays)))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (points().replace("z_m", "z"), "unknown column 'z'"),
        (points().replace("x_m", "lon"), "unknown column 'lon'"),
        ("\n".join(points().splitlines()[:-1]), r"points without a height \(1\)"),
        (points() + points().splitlines()[1], "two heights at one point"),
        (points() + ",2,-30", "point without coordinates"),
        ("x_m,y_m,z_m\n" + "\n".join(f"{i + 0.1 * j},{j},-9" for i in range(9) for j in range(9)), "points at 81 different x"),
        (points() + "a,b,c", "x_m that is not numeric; must be numbers"),
        ("", "No columns"),
    ],
)  # fmt: skip
def test_wrong_tables_are_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ValueError, match=message) as error:
        grids.read(csv(tmp_path, text))
    assert "\n" not in str(error.value)


def test_files_that_are_none_are_refused(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe.npz"
    os.mkfifo(pipe)
    other = tmp_path / "bottom.tif"
    other.write_bytes(b"II*\0")
    broken = tmp_path / "broken.npz"
    broken.write_bytes(npz(tmp_path, x_m=X, y_m=Y, z_m=bottom()).read_bytes()[:400])
    bomb = tmp_path / "bomb.npz"
    with zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("z_m.npy", bytes(300 * 1024**2))
    for path, message in (
        (pipe, "a pipe"),
        (other, "ends in .tif; must be a .npz or .csv file"),
        (broken, "not an archive"),
        (bomb, "the limit is"),
        (tmp_path / "none.csv", "No such file"),
    ):
        with pytest.raises(ValueError, match=message):
            grids.read(path)


def test_nothing_in_a_file_is_unpickled(tmp_path: Path) -> None:
    class Trap:
        def __reduce__(self) -> Any:
            return (tmp_path / "sprung").touch, ()

    array = np.array([Trap()], dtype=object)
    data = io.BytesIO()
    np.savez(data, z_m=array)
    (tmp_path / "trap.npz").write_bytes(data.getvalue())
    with pytest.raises(ValueError, match="allow_pickle"):
        grids.read(tmp_path / "trap.npz")
    assert not (tmp_path / "sprung").exists()
    pickle.loads(pickle.dumps(Trap()))
    assert (tmp_path / "sprung").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["task.dock=[0,0,-12]", "task.start_low=12", "task.start_high=15", "world.bottom.origin=[505,0]"], "is not over the grid, which has x from -5.0 to 35.0 m"),
        (["task.dock=[0,0,-40]"], "a (start|goal) at .* is inside the bottom"),
        (["task.dock=[0,0,-27.9]", "task.start_high=6"], "inside the bottom"),
    ],
)  # fmt: skip
def test_starts_and_goals_must_be_over_the_grid_and_in_the_water(
    tmp_path: Path, words: list[str], message: str
) -> None:
    batch = diving(npz(tmp_path, x_m=X, y_m=Y, z_m=bottom()), *words, n=32)
    with pytest.raises(ConfigError, match=message):
        batch.reset()


def test_commands_refuse_bad_files_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = npz(tmp_path, x_m=X, y_m=Y, z_m=holes())
    good = csv(tmp_path, points())
    for words, message in (
        ([], "world.bottom.file: a value is missing"),
        ([f"world.bottom.file={path}"], "has points without a height \\(1\\)"),
        (
            [f"world.bottom.file={good}", "world.bottom.sha256=abc"],
            "differs from the file with the SHA-256 abc",
        ),
        (
            [f"world.bottom.file={good}", "world.bottom.origin=[1]"],
            "world.bottom.origin=\\[1.0\\]: must be two",
        ),
    ):
        assert main(["train", "algo=pid", "world=bottom", *words, f"output={tmp_path}"]) == 2
        (line,) = capsys.readouterr().err.strip().splitlines()
        assert message.replace("\\", "") in line
