"""Other people's programs train on our environment, each in a virtual environment of its own.

Each takes its newest version and what that pulls in, except torch, which is held at the version of constraints.txt.
The virtual environments are kept in `$AUVBENCH_PROGRAMS` if that is set, else they go with the test.
`python -m tests.programs.test_programs` prints the table of docs/environments.md from the last results there.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import venv
from pathlib import Path

import pytest

pytestmark = [pytest.mark.programs, pytest.mark.slow]

ROOT = Path(__file__).parents[2]
SCRIPTS = Path(__file__).parent / "scripts"

PROGRAMS = {
    "cleanrl": ("gymnasium==1.0.0", "moviepy"),
    "contrib": ("sb3-contrib",),
    "zoo": ("rl-zoo3", "requests", "moviepy"),
    "sbx_": ("sbx-rl",),
    "skrl_": ("skrl",),
    "rllib": ("ray[rllib]",),
    "torchrl_": ("torchrl",),
    "tianshou_": ("tianshou",),
    "minari_": ("minari[hdf5,create]",),
    "d3rlpy_": ("d3rlpy",),
    "benchmarl_": ("benchmarl", "pettingzoo"),
}
"""What each script needs besides auvbench; a script ends with one line, `trained N steps; NAME VERSION`."""


def python_of(folder: Path, requirements: tuple[str, ...]) -> Path:
    """The interpreter of a virtual environment with auvbench and the requirements, made if need be."""
    python = folder / "bin" / "python"
    done = folder / "installed.json"
    if done.exists() and json.loads(done.read_text()) == list(requirements):
        return python
    if not python.exists():
        venv.create(folder, with_pip=True)
    torch = next(
        line for line in (ROOT / "constraints.txt").read_text().split() if line.startswith("torch==")
    )
    constraints = folder / "constraints.txt"
    constraints.write_text(f"{torch}\n")
    pip = [python, "-m", "pip", "install", "-q", "-c", constraints, "-e", ROOT, *requirements]
    subprocess.run(pip, check=True, timeout=3000)
    done.write_text(json.dumps(list(requirements)))
    return python


@pytest.fixture(scope="session")
def places(tmp_path_factory: pytest.TempPathFactory) -> Path:
    kept = os.environ.get("AUVBENCH_PROGRAMS")
    return Path(kept) if kept else tmp_path_factory.mktemp("programs")


@pytest.mark.parametrize("program", PROGRAMS)
def test_it_trains(program: str, places: Path, tmp_path: Path) -> None:
    folder = places / program
    folder.mkdir(parents=True, exist_ok=True)
    python = python_of(folder, PROGRAMS[program])
    done = subprocess.run(
        [python, SCRIPTS / f"{program}.py"],
        cwd=tmp_path,
        env=os.environ | {"OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        timeout=900,
    )
    assert done.returncode == 0, f"{done.stdout[-3000:]}\n{done.stderr[-3000:]}"
    last = [line for line in done.stdout.splitlines() if " steps; " in line][-1]
    (folder / "result.txt").write_text(f"{last}\n")


def table(places: Path) -> str:
    """The results in `places` as rows of Markdown: program and version, what it did."""
    rows = []
    for program in PROGRAMS:
        result = places / program / "result.txt"
        if result.exists():
            did, _, version = result.read_text().strip().partition("; ")
            what = (SCRIPTS / f"{program}.py").read_text().split('"""')[1]
            rows.append(
                f"| {version} | {what.strip().replace(chr(10), ' ')} | {did.removesuffix(' steps')} |"
            )
    return "\n".join(["| with | what the test does | steps |", "|---|---|---|", *rows])


if __name__ == "__main__":
    print(table(Path(os.environ.get("AUVBENCH_PROGRAMS", sys.argv[-1]))))
