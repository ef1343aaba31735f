"""`make house` counts what it says."""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from auvbench import integrations
from auvbench.registry import TASKS
from benchmarks import house
from tests.waiting import LIMIT


def counted(text: str) -> list[str]:
    return [read for _, read in house.reads(ast.parse(textwrap.dedent(text)))]


def test_reads_of_arrays_by_number_are_counted_in_compiled_functions() -> None:
    text = """
    @compiled("tasks")
    def kernel(i: int, F: Floats, P: Floats, names: tuple) -> None:
        F[i, k.F_YAW] = P[3] + F[i, k.F_YAW + 1] + F[i, 0] + P[i] + names[0] + F[i, column]
        P[1] = F[k.F_START : k.F_START + 3][0]

    def plain(P: Floats) -> float:
        return P[3]
    """
    assert sorted(counted(text)) == [
        "F[i, 0]",
        "F[i, k.F_YAW + 1]",
        "F[k.F_START:k.F_START + 3]",
        "P[3]",
    ]


def test_names_and_texts_count_and_docstrings_do_not() -> None:
    tree = ast.parse('"""About gazebo."""\nimport slurm_tools as tools\nx = "over ROS 2"\n"""alone"""\n')
    assert [word for _, word in house.words(tree)] == ["slurm_tools", "x", "over ROS 2"]
    assert house.INTEGRATION.search("over ROS 2")
    assert not house.INTEGRATION.search("array")


@pytest.mark.parametrize(
    "text",
    [
        'if config.task.name == "docking": pass',
        "from auvbench.tasks.docking import step",
        "from auvbench.config.tasks.docking import Docking as Dock",
        "class Other(DockingTask): pass",
        "x = config.docking",
        "make(docking=3)",
        'x = "task=docking vehicle=x"',
        'x = f"task.docking.{key}"',
        'x = "auvbench.tasks.docking:draw"',
    ],
)
def test_code_that_names_a_part_is_found(text: str) -> None:
    assert list(house.names("docking", ast.parse(text)))


@pytest.mark.parametrize(
    "text",
    [
        'x = "docking is slow in the lower bound"',
        "def f(docking): bound = docking; return bound",
        "undocking = docking_time = 3",
    ],
)
def test_an_ordinary_word_names_no_part(text: str) -> None:
    assert not list(house.names("docking", ast.parse(text)))
    assert not list(house.names("bound", ast.parse(text)))


def test_a_command_is_named_by_its_word_and_its_module() -> None:
    def named(text: str) -> bool:
        return any(house.names("bound", ast.parse(text), typed=True))

    assert named('x = "run auvbench bound first"')
    assert named('x = {"bound": 3}')
    assert named("from auvbench.commands import bound")
    assert not named('S = TypeVar("S", bound=int)')


def test_lines_that_ask_for_a_task_are_found() -> None:
    text = """
if name == "waypoint" or isinstance(task, tasks.Docking | int) or name in ("a", "docking"):
    columns = {"waypoint": isinstance(task, Task)}
"""
    assert sorted(line for _, line in house.task_tests(ast.parse(text))) == [
        "isinstance(task, tasks.Docking | int)",
        "name == 'waypoint'",
        "name in ('a', 'docking')",
    ]


def test_no_disturbance_reads_an_array_by_a_number() -> None:
    found = [
        f"{path.name}:{line}: {text}"
        for path, tree in house.sources(house.PACKAGE / "tasks" / "disturbances")
        for line, text in house.reads(tree)
    ]
    assert found == []


def test_nothing_outside_tasks_asks_for_a_task() -> None:
    assert TASKS.own == house.TASKS
    assert not house.naming_a_task()


@pytest.mark.parametrize("kind", house.KINDS)
def test_each_kind_has_an_example_that_exists(kind: str) -> None:
    name, folder = house.KINDS[kind]
    files = house.naming(kind)
    assert files
    assert not folder or f"{folder}/{name}.yaml" in files


def test_no_file_of_the_core_names_an_integration() -> None:
    assert house.naming_an_integration() == []


PARTS = {
    # Residual learners correct LQR too: their schema has its keys.
    "agent": [
        "auvbench/agents/classical/lqr.py",
        "auvbench/config/algorithms/lqr.py",
        "auvbench/config/algorithms/residual.py",
        "auvbench/registry.py",
        "conf/algo/lqr.yaml",
    ],
    # A reward is for this task only, `scenario_sets.py` has its published scenario sets, and rendezvous is docking with a moving dock.
    "task": [
        "auvbench/config/rewards.py",
        "auvbench/config/tasks/docking.py",
        "auvbench/config/tasks/rendezvous.py",
        "auvbench/evaluation/scenario_sets.py",
        "auvbench/registry.py",
        "auvbench/tasks/docking.py",
        "auvbench/tasks/rendezvous.py",
        "conf/task/docking.yaml",
    ],
    "reward": [
        "auvbench/config/rewards.py",
        "auvbench/registry.py",
        "auvbench/tasks/rewards.py",
        "conf/reward/gym_dockauv.yaml",
    ],
    # The stream of its random numbers has a number of its own in `random.py`.
    "disturbance": [
        "auvbench/dynamics/random.py",
        "auvbench/registry.py",
        "auvbench/tasks/disturbances/tether.py",
        "conf/disturbance/tether.yaml",
    ],
    # The help of serve has an example with Gazebo.
    "simulator": [
        "auvbench/integrations/__init__.py",
        "auvbench/integrations/commands",
        "auvbench/integrations/gazebo",
        "conf/simulator/gazebo.yaml",
    ],
    "launcher": [
        "auvbench/integrations/__init__.py",
        "auvbench/integrations/cluster",
        "conf/launcher/slurm.yaml",
    ],
    "tracker": ["auvbench/integrations/__init__.py", "auvbench/integrations/tracking"],
    # A report without bounds names the command that computes them.
    "command": [
        "auvbench/analysis/optional_columns.py",
        "auvbench/commands/bound.py",
        "auvbench/config/commands.py",
        "auvbench/registry.py",
    ],
}
"""What names the example of a kind: its code, its declaration, its YAML file, its line, and the rest that the comments explain"""


@pytest.mark.parametrize("kind", PARTS)
def test_a_part_is_its_code_its_declaration_its_yaml_and_a_line(kind: str) -> None:
    assert house.naming(kind) == PARTS[kind]


def test_each_integration_is_registered() -> None:
    registered = [code for kind in integrations.REGISTERED.values() for code in kind.values()]
    folders = {path.parent.name for path in (house.PACKAGE / house.INTEGRATIONS).glob("*/__init__.py")}
    # A pilot is chosen by a flag and enters nothing.
    assert {code.split(".")[2] for code in registered} == folders - {"mavlink"}


WITHOUT = """
import pkgutil, sys
import auvbench
from auvbench.cli import main

names = [module.name for module in pkgutil.walk_packages(auvbench.__path__, "auvbench.")]
for name in names:
    if not name.startswith(("auvbench.template", "auvbench.__main__")):
        __import__(name)
assert main(["train", "algo=pid"]) == 0
assert main(["train", "simulator=gazebo"]) == 2
assert not [name for name in sys.modules if name.startswith("auvbench.integrations.")]
"""


@pytest.mark.slow
def test_the_core_works_without_integrations(tmp_path: Path) -> None:
    copy, folder = tmp_path / "copy", tmp_path / "folder"
    folder.mkdir()
    for name in ("auvbench", "conf"):
        shutil.copytree(house.ROOT / name, copy / name, ignore=shutil.ignore_patterns("__pycache__"))
    here = copy / "auvbench" / "integrations"
    for path in here.iterdir():
        if path.is_dir():
            shutil.rmtree(path)
    (here / "__init__.py").write_text("REGISTERED, LOGS, FIGURES = {}, {}, {}\nUSED = JOBS = EXPORTS = ()\n")
    for name in ("simulator/gazebo", "simulator/ros2", "launcher/slurm", "launcher/ray", "algo/ardusub"):
        (copy / "conf" / f"{name}.yaml").unlink()
    environment = {**os.environ, "PYTHONPATH": str(copy), "NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=LIMIT,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-3000:]
    assert "gazebo" in done.stderr
