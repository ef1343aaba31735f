"""The package in examples/, installed into an environment of its own: its agents and agents on its task stand in tables."""

from __future__ import annotations

import csv
import json
import os
import shlex
import shutil
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

import pytest

from tests.waiting import LIMIT

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "auvbench-example"
COMMANDS = """
import json, sys
from auvbench.cli import main
for words in json.loads(sys.argv[1]):
    if code := main(words):
        sys.exit(f"auvbench {' '.join(words)} ends with exit code {code}")
"""
"""Run commands in one process: each of its own would import everything anew."""
TRAIN = ("algo=pursuit,search,pid,ppo", "seed=0,1", "train.total_steps=4096", "launcher.workers=2")


def said(python: Path, *words: str, cwd: Path) -> str:
    """What a command of that environment prints; it must end well."""
    environment = {
        key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "VIRTUAL_ENV")
    }
    done = subprocess.run(
        [python, *words], cwd=cwd, capture_output=True, text=True, check=False, timeout=LIMIT, env=environment
    )
    assert done.returncode == 0, f"{' '.join(words)}: {done.stdout[-2000:]}\n{done.stderr[-2000:]}"
    return done.stdout


def source(folder: Path) -> Path:
    """A copy of the example, so that building it leaves nothing in the repository."""
    return Path(
        shutil.copytree(EXAMPLE, folder / "source", ignore=shutil.ignore_patterns("build", "*.egg-info"))
    )


def commands(page: str) -> list[list[str]]:
    """The commands of auvbench that a page of the docs tells to type."""
    lines = (ROOT / "docs" / page).read_text(encoding="utf-8").splitlines()
    return [shlex.split(line)[2:] for line in lines if line.startswith("$ auvbench ")]


def runs_through(python: Path, folder: Path) -> None:
    assert " pursuit," in said(python, "-m", "auvbench.cli", "train", "--help", cwd=folder)
    agents = (
        ("train", "-m", *TRAIN),
        ("evaluate", "outputs", "protocol.episodes=20", "--workers", "2"),
        ("report", "outputs"),
    )
    said(python, "-c", COMMANDS, json.dumps(agents), cwd=folder)
    with (folder / "outputs/default/report/table.csv").open() as file:
        rows = {row["agent"]: row for row in csv.DictReader(file)}
    assert {"pursuit", "search", "PID", "PPO"} <= rows.keys()
    assert float(rows["pursuit"]["success_rate"]) > 0.9
    said(python, "-c", COMMANDS, json.dumps(commands("adding-a-task.md")), cwd=folder)
    with (folder / "outputs/poles/report/table.csv").open() as file:
        ranked = list(csv.DictReader(file))
    assert [row["agent"] for row in ranked] == ["LQR", "PID", "random"]
    assert float(ranked[1]["mean_in_view"]) > 0.7 > 0.05 > float(ranked[2]["mean_in_view"])


@pytest.mark.long
@pytest.mark.slow
def test_installed_beside_the_packages_that_are_here(tmp_path: Path) -> None:
    venv.create(tmp_path / "own", with_pip=False, symlinks=True)
    python = tmp_path / "own" / "bin" / "python"
    # The packages of the environment that tests, editable ones included; the example goes into the new one alone.
    here = sysconfig.get_path("purelib")
    there = Path(
        said(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", cwd=tmp_path).strip()
    )
    (there / "beside.pth").write_text(f"import site; site.addsitedir({here!r})\n")
    command = [
        sys.executable,
        "-m",
        "pip",
        "--python",
        str(python),
        "install",
        "-q",
        "--no-deps",
        "--no-index",
    ]
    subprocess.run(
        [*command, "--no-build-isolation", str(source(tmp_path))],
        check=True,
        capture_output=True,
        timeout=LIMIT,
    )
    assert (there / "auvbench_example").is_dir()
    runs_through(python, tmp_path)
    said(
        python,
        "-m",
        "pytest",
        "-q",
        "-p",
        "no:cacheprovider",
        "source/tests",
        "-k",
        "not search",
        cwd=tmp_path,
    )


@pytest.mark.programs
@pytest.mark.slow
def test_installed_from_the_package_index(tmp_path: Path) -> None:
    venv.create(tmp_path / "own", with_pip=True)
    python = tmp_path / "own" / "bin" / "python"
    pip = [str(python), "-m", "pip", "install", "-q", "-c", str(ROOT / "constraints.txt")]
    subprocess.run([*pip, str(ROOT), str(source(tmp_path)), "pytest"], check=True)
    runs_through(python, tmp_path)
    said(python, "-m", "pytest", "-q", "source/tests", cwd=tmp_path)
