"""Episodes as records: no numbers for names, one piece of code for each task and reward, checkpoints of version 2."""

from __future__ import annotations

import ast
import json
import math
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import auvbench
from auvbench.agents.base import Components
from auvbench.config.tasks import TASKS
from auvbench.envs.batch import Batch
from auvbench.errors import AgentError, TrainingError
from auvbench.runs import integrity
from auvbench.tasks import records
from auvbench.tasks.disturbances.version_2 import COLUMNS
from auvbench.training.checkpoint.store import CheckpointStore
from tests import configs
from tests.packages import EXAMPLE, Site, site, tasking

__all__ = ["site"]

PACKAGE = Path(auvbench.__file__).parent
VERSION_2 = Path(__file__).with_name("version_2.npz")
"""state of two environments of each task after 25 steps, as auvbench wrote it before episodes were records, and the next 20 steps"""

DECLARED = {"triple", "vehicle"}
"""functions that give the numbers of an array names"""


def numeric_reads(path: Path) -> list[str]:
    """Return where functions of a file read an array of state or parameters by a number or a constant."""
    found = []
    for function in ast.walk(ast.parse(path.read_text())):
        if not isinstance(function, ast.FunctionDef) or function.name in DECLARED:
            continue
        names = {argument.arg for argument in function.args.args}
        for node in ast.walk(function):
            if not isinstance(node, ast.Subscript) or not isinstance(node.ctx, ast.Load):
                continue
            root = node.value
            while isinstance(root, ast.Attribute | ast.Subscript):
                root = root.value
            index = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
            by_number = any(isinstance(part, ast.Constant) and part.value != 0 for part in index)
            by_number |= any(
                isinstance(part, ast.Name | ast.Attribute) and ast.unparse(part).isupper() for part in index
            )
            by_number |= isinstance(node.value, ast.Attribute) and any(
                isinstance(p, ast.Constant) for p in index
            )
            if by_number and isinstance(root, ast.Name) and root.id in names & {"e", "p", "m", "d", "F", "C"}:
                found.append(f"{path.name}:{node.lineno}: {ast.unparse(node)}")
    return found


def test_compiled_functions_read_records_by_name() -> None:
    files = [
        *(PACKAGE / "tasks").rglob("*.py"),
        PACKAGE / "blocks.py",
        *(EXAMPLE / "auvbench_example").glob("*.py"),
    ]
    assert {"waypoint.py", "rewards.py", "circling.py", "current.py", "fault.py"} <= {
        path.name for path in files
    }
    assert [where for path in files for where in numeric_reads(path)] == []


def test_a_read_by_a_number_is_found(tmp_path: Path) -> None:
    file = tmp_path / "task.py"
    file.write_text(
        "def step(e, v, p):\n    return e.reference[1] + p[P_SPEED] + e.points[k, 2] + v.force[j] + e.points[k, j]\n"
    )
    assert sorted(where.split(": ")[1] for where in numeric_reads(file)) == [
        "e.points[k, 2]",
        "e.reference[1]",
        "p[P_SPEED]",
    ]


@pytest.mark.parametrize(
    "task",
    ["waypoint", "station_keeping", "trajectory_tracking", "path_following", "docking"],
)  # others are newer
def test_a_state_of_version_2_continues(task: str) -> None:
    with np.load(VERSION_2, allow_pickle=False) as archive:
        stored = {key.partition("/")[2]: archive[key] for key in archive.files if key.startswith(f"{task}/")}
    expected = stored.pop("seen")
    batch = Batch(
        configs.training(f"task={task}", "vehicle=bluerov2_heavy", "disturbance=moderate"), 2, seed=9
    )
    batch.reset()
    batch.load_state_dict(stored)
    np.testing.assert_array_equal(batch.task.scenario(), stored["task.F"])
    n_u = len(batch.vehicle.actuators)
    for step, row in enumerate(expected, 25):
        result = batch.step(np.cos(np.arange(2 * n_u).reshape(2, n_u) + step))
        # Another machine may round a sine differently.
        np.testing.assert_allclose(result.observation, row[:, :-1], rtol=1e-5, atol=1e-6)
        np.testing.assert_allclose(result.reward, row[:, -1], rtol=1e-9)


def test_disturbances_of_version_2_continue_by_their_names() -> None:
    config = configs.training("disturbance=severe", "noise=none", "task.max_steps=30")
    stayed, back = Batch(config, 3, seed=9), Batch(config, 3, seed=4)
    stayed.reset()
    back.reset()
    action = np.linspace(-1.0, 1.0, 18).reshape(3, 6)
    for _ in range(45):
        stayed.step(action)
    now = stayed.state_dict()
    state = {key: value for key, value in now.items() if not key.startswith("disturbances.")}
    floats, integers = np.zeros((3, 18)), np.zeros((3, 4), np.int64)
    for name, columns in COLUMNS.items():
        for field, (array, place) in columns.items():
            (floats if array == "D" else integers)[:, place] = now[f"disturbances.{name}.state"][field]
    state |= {"disturbances.D": floats, "disturbances.I": integers}
    for name in ("commands", "measurements", "clock"):
        state[f"disturbances.{name}"] = now[f"disturbances.delay.{name}"]
    state["disturbances.power"] = now["disturbances.power"]
    back.load_state_dict(state)
    for key, value in now.items():
        np.testing.assert_array_equal(back.state_dict()[key], value, err_msg=key)
    for _ in range(40):
        np.testing.assert_array_equal(stayed.step(action).observation, back.step(action).observation)


def test_a_checkpoint_of_version_2_is_read_and_one_of_version_1_is_not(tmp_path: Path) -> None:
    store = CheckpointStore(tmp_path)
    path = store.save(10, Components(values={"x": 1})) / "manifest.json"

    def rewrite(version: int) -> None:
        manifest = json.loads(path.read_text())
        path.write_text(json.dumps(integrity.sealed(manifest | {"schema_version": version})))

    assert json.loads(path.read_text())["schema_version"] == 3
    rewrite(2)
    assert store.read(10).components.values == {"x": 1}
    rewrite(1)
    with pytest.raises(TrainingError, match="schema_version 1, but this auvbench reads 2 and 3"):
        store.read(10)


def test_the_state_is_one_array_that_needs_no_pickle(tmp_path: Path) -> None:
    batch = Batch(configs.training("task=docking", "vehicle=bluerov2_heavy"), 3, seed=9)
    batch.reset()
    state = batch.task.state_dict()
    np.save(tmp_path / "state.npy", state["episodes"], allow_pickle=False)
    read = np.load(tmp_path / "state.npy", allow_pickle=False)
    assert read.dtype.names[:3] == ("reference", "start", "start_yaw")
    np.testing.assert_array_equal(read, state["episodes"])


@pytest.mark.parametrize("name", ["with space", "steps", "_hidden", "7", "view"])
def test_a_field_has_a_name_of_its_own(name: str) -> None:
    with pytest.raises(AgentError, match="task=mine: "):
        records.table(2, [(name, "f8")], "task=mine")


RUN = """
import sys
import numpy as np
from auvbench.config.compose import compose
from auvbench.config.validate import train_config
from auvbench.envs.batch import Batch

for words in sys.argv[1:]:
    batch = Batch(train_config(compose("train", words.split(), folder=None)), 2, seed=3)
    batch.reset()
    rewards = [float(batch.step(np.full((batch.n, len(batch.vehicle.actuators)), 0.5)).reward[0]) for _ in range(3)]
    print(words, rewards)
"""


def run(folder: Path, *words: str, **variables: str) -> tuple[list[str], bool]:
    """Return what a new process prints, and whether it compiled anything."""
    environment = {**os.environ, "XDG_CACHE_HOME": str(folder / "cache"), **variables}
    done = subprocess.run(
        [sys.executable, "-c", RUN, *words],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines(), "auvbench: compiling" in done.stderr


STATION = "task=station_keeping reward=view vehicle=bluerov2_heavy"


@pytest.mark.slow
def test_packages_with_rewards_of_one_name_do_not_take_each_other_s_code(site: Site, tmp_path: Path) -> None:
    """Both are compiled into loops of the same task, whose code is in one folder."""
    given = []
    for changes in ((), (("p.k * (seen -", "2.0 * p.k * (seen -"),)):
        tasking(site, *changes)
        given.append(run(tmp_path, STATION)[0])
    first, other = given
    np.testing.assert_allclose(numbers(other[0]), 2.0 * np.asarray(numbers(first[0])))


@pytest.mark.slow
def test_packages_with_tasks_of_one_name_do_not_take_each_other_s_code(site: Site, tmp_path: Path) -> None:
    """Two environments at one path with one cache, as two containers of a machine have: numba sees the same file and names."""
    words = "task=circling vehicle=bluerov2_heavy"
    environments = []
    for changes in ((), (("add_errors(e)\n", "add_errors(e)\n    e.distance += 0.5\n    e.to_go += 0.5\n"),)):
        cache = site.folder / "auvbench_example" / "__pycache__"
        cache.unlink(missing_ok=True)
        tasking(site, *changes)
        shutil.rmtree(cache, ignore_errors=True)
        cache.write_text("a file in its place: the code is kept in the user's cache, which both share")
        environments.append([run(tmp_path, words) for _ in range(2)])
    (first, again), (other, once_more) = environments
    assert (first[1], again[1]) == (other[1], once_more[1]) == (True, False)
    assert first[0] == again[0]
    assert other[0] == once_more[0]
    # 0.5 m farther from the reference, at a length of 1 m of the reward.
    effort = 0.02 * 0.25  # of reward.view for commands of 0.5
    near, far = (np.asarray(numbers(lines[0])) + effort for lines in (first[0], other[0]))
    np.testing.assert_allclose(far, near * math.exp(-0.5), rtol=1e-9)


@pytest.mark.slow
def test_a_second_process_compiles_nothing_even_where_the_installation_is_read_only(
    site: Site, tmp_path: Path
) -> None:
    tasking(site)
    uncached = shutil.ignore_patterns("__pycache__")
    shutil.copytree(PACKAGE, site.folder / "auvbench", ignore=uncached)
    shutil.copytree(
        PACKAGE.parent / "conf", site.folder / "auvbench" / "conf", ignore=uncached, dirs_exist_ok=True
    )
    for folder in (*(site.folder / "auvbench").rglob("*/"), site.folder / "auvbench_example"):
        shutil.rmtree(folder / "__pycache__", ignore_errors=True)
        if folder.name == "dynamics" and (kept := PACKAGE / "dynamics" / "__pycache__").exists():
            # The simulator is compiled already; its compilation takes as long as all others.
            shutil.copytree(kept, folder / "__pycache__")
            continue
        (folder / "__pycache__").write_text(
            "a file in its place: as little can be written there as on a read-only disk"
        )
    words = (STATION, "task=circling vehicle=bluerov2_heavy")
    first, compiled = run(tmp_path, *words)
    assert compiled
    assert run(tmp_path, *words) == (first, False)
    interpreted, compiled = run(tmp_path, *words, NUMBA_DISABLE_JIT="1")
    assert not compiled
    for one, other in zip(first, interpreted, strict=True):
        np.testing.assert_allclose(numbers(one), numbers(other), rtol=1e-12)


def numbers(line: str) -> list[float]:
    return [float(word) for word in line.partition(" [")[2].rstrip("]").split(",")]


@pytest.mark.slow
def test_every_task_runs_interpreted(tmp_path: Path) -> None:
    words = [f"task={task} vehicle=bluerov2_heavy disturbance=moderate" for task in TASKS]
    compiled, _ = run(
        tmp_path, *words, XDG_CACHE_HOME=os.environ.get("XDG_CACHE_HOME", str(Path.home() / ".cache"))
    )
    interpreted, _ = run(tmp_path, *words, NUMBA_DISABLE_JIT="1")
    for one, other in zip(compiled, interpreted, strict=True):
        np.testing.assert_allclose(numbers(one), numbers(other), rtol=1e-12)


def test_a_field_may_have_the_name_of_an_attribute_of_arrays() -> None:
    rows = records.table(2, [("mean", "f8"), ("size", "f8", (2,))], "task=mine")
    rows[1].mean, rows[1].size[:] = 3.0, (4.0, 5.0)
    assert rows["mean"].tolist() == [0.0, 3.0]
    assert rows[1].size.tolist() == [4.0, 5.0]
    rows.steps = 7
    assert rows.steps.tolist() == [7, 7]
    with pytest.raises(AttributeError):
        _ = rows.nothing
