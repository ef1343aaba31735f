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
    assert list(house.words(tree)) == ["slurm_tools", "x", "over ROS 2"]
    assert house.INTEGRATION.search("over ROS 2")
    assert not house.INTEGRATION.search("array")


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
    files = house.naming(name, folder)
    assert files
    assert not folder or f"{folder}/{name}.yaml" in files


def test_a_task_of_auvbench_is_its_code_its_declaration_its_yaml_and_a_line() -> None:
    """A reward is for this task only, `scenario_sets.py` has its published scenario sets, and rendezvous is docking with a moving dock."""
    assert house.naming("docking", "conf/task") == [
        "auvbench/config/rewards.py",
        "auvbench/config/tasks/docking.py",
        "auvbench/config/tasks/rendezvous.py",
        "auvbench/evaluation/scenario_sets.py",
        "auvbench/registry.py",
        "auvbench/tasks/docking.py",
        "auvbench/tasks/rendezvous.py",
        "conf/task/docking.yaml",
    ]


def test_an_agent_of_auvbench_is_its_code_its_declaration_its_yaml_and_a_line() -> None:
    """A residual learner and a pilot take LQR too."""
    assert house.naming("lqr", "conf/algo") == [
        "auvbench/agents/classical/lqr.py",
        "auvbench/config/algorithms/lqr.py",
        "auvbench/config/algorithms/residual.py",
        "auvbench/integrations/commands/pilot.py",
        "auvbench/registry.py",
        "conf/algo/lqr.yaml",
    ]


def test_a_reward_of_auvbench_is_its_code_its_declaration_its_yaml_and_a_line() -> None:
    assert house.naming("gym_dockauv", "conf/reward") == [
        "auvbench/config/rewards.py",
        "auvbench/registry.py",
        "auvbench/tasks/rewards.py",
        "conf/reward/gym_dockauv.yaml",
    ]


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
