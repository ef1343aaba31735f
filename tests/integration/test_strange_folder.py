"""Every command in a folder of another person, full of files that dependencies read or run unasked."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from tests import dds
from tests.waiting import LIMIT

pytestmark = pytest.mark.slow

MODULES = [
    "multiprocessing",
    "numpy",
    "yaml",
    "torch",
    "matplotlib",
    "numba",
    "optuna",
    "pandas",
    "pickle",
    "sitecustomize",
    "usercustomize",
]
"""Modules that a process with the working directory in its path would run."""

PROFILES = """<?xml version="1.0" encoding="UTF-8" ?>
<dds xmlns="http://www.eprosima.com"><profiles><participant profile_name="p" is_default_profile="true"><rtps><builtin>
<initialPeersList><locator><udpv4><address>127.0.0.1</address><port>{port}</port></udpv4></locator></initialPeersList>
</builtin></rtps></participant></profiles></dds>"""

AUDIT = """
import os, sys
HERE, LOG = {here!r}, {log!r}
def hook(event, arguments):
    if event not in ("open", "os.listdir", "os.scandir") or not isinstance(arguments[0], (str, bytes, os.PathLike)):
        return
    path = os.path.abspath(os.fsdecode(arguments[0]))
    inside = path[len(HERE) + 1 :] if path.startswith(HERE + "/") else ""
    if inside and inside.partition("/")[0] not in ("conf", "typed") and "__editable__" not in inside:
        with open(LOG, "a") as file:
            file.write(f"{{event}} {{inside}}: {{sys.orig_argv}}\\n")
sys.addaudithook(hook)
"""
"""Writes down each file of the folder that a Python process opens, except `conf` and what the commands name.

An editable installation has a relative path that is searched before auvbench runs.
"""


def set_traps(folder: Path, home: Path) -> socket.socket:
    """Fill a folder and a home with traps; return the socket that profiles of DDS name."""
    for name in MODULES:
        package = folder / name
        package.mkdir(parents=True)
        (package / "__init__.py").write_text(
            "import pathlib; pathlib.Path(__file__).with_name('FIRED').touch()\n"
        )
    (folder / ".numba_config.yaml").write_text(f"cache_dir: {folder / 'FIRED'}\n")
    (folder / "matplotlibrc").write_bytes(b"\xff\xfe")
    (folder / "ipopt.opt").write_text("output_file FIRED\nfile_print_level 5\n")
    for name in (".env", "setup.cfg", "tox.ini", "mlflow.db", "wandb/settings", "alembic.ini", ".netrc"):
        path = folder / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(b"\xff\xfe")
    styles = home / "matplotlib" / "stylelib"
    styles.mkdir(parents=True)
    (styles.parent / "matplotlibrc").write_text("axes.facecolor: red\ntext.usetex: True\n")
    (styles / "ggplot.mplstyle").write_bytes(b"\xff\xfe")
    listener = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    listener.bind(("127.0.0.1", 0))
    profiles = PROFILES.format(port=listener.getsockname()[1])
    for name in ("DEFAULT_FASTRTPS_PROFILES.xml", "DEFAULT_FASTDDS_PROFILES.xml"):
        (folder / name).write_text(profiles)
    return listener


def fired(folder: Path, log: Path) -> list[str]:
    """Return the traps that fired, and other files that were opened."""
    opened = log.read_text().splitlines() if log.exists() else []
    return [str(path) for path in folder.rglob("FIRED")] + opened


GRID = ["algo=pid", "seed=0,1", "task.max_steps=40", "output=typed/out", "launcher.workers=2"]
PPO = [
    "algo=ppo",
    "algo.n_envs=2",
    "algo.n_steps=16",
    "algo.batch_size=32",
    "train.total_steps=64",
    "task.max_steps=40",
]
NEAR = """\
name: near
scenarios: test
episodes: 1
seed: 123
frequency: 10.0
batch: 1
trajectories: 0
overrides: [task=waypoint, "task.waypoint_low=[-4,-4,-24]", "task.waypoint_high=[4,4,-23]", noise=thesis, disturbance=none]
conditions: [{name: nominal}]
"""
PREPARATION = [
    ["train", "-m", *GRID],
    ["train", *PPO, "output=typed/ppo"],
    ["evaluate", "typed/out", "typed/ppo", "protocol.episodes=2", "--workers", "2"],
    ["export", "typed/ppo", "--out", "typed/policies"],
]
READING = [
    ["--help"],
    ["init", "typed/project"],
    ["runs", "typed/out"],
    ["compare", "typed/out", "typed/ppo"],
    ["plan", "--sd", "0.5", "--rates", "90,95"],
    ["vehicles"],
    ["completion", "bash"],
    ["bound", "protocol=near", "output=typed/bounds", "--workers", "1"],
    ["resume", "typed/again", "train.total_steps=96"],
]
DRAWING = [
    ["report", "typed/out", "typed/ppo", "--out", "typed/drawn/report"],
    ["replay", "RUN", "--out", "typed/drawn/replay"],
    ["simulate", "output=typed/drawn/s.csv", "plot=typed/drawn/s.png", "duration=2"],
    ["publish", "typed/out", "--to", "typed/drawn/shipped"],
    [
        *(
            "tune",
            "algo=pid",
            "tune.trials=4",
            "tune.startup=2",
            "protocol.episodes=2",
            "tune.fresh_seeds=[7]",
        ),
        *("launcher.workers=1", "task.max_steps=40", "output=typed/drawn"),
    ],
]


def run(command: list[str], folder: Path, environment: dict[str, str]) -> None:
    """Run a command and assert its success."""
    done = subprocess.run(
        [str(Path(sys.executable).with_name("auvbench")), *command],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=LIMIT,
        check=False,
    )
    assert done.returncode == 0, f"{command}: {done.stdout[-2000:]}{done.stderr[-2000:]}"


def figures(folder: Path) -> dict[str, bytes]:
    """Return the bytes of all drawn files by name."""
    found = (path for path in folder.rglob("*") if path.suffix in (".png", ".svg"))
    return {str(path.relative_to(folder)): path.read_bytes() for path in found}


@dds.needs_ros
@pytest.mark.long
def test_no_command_obeys_the_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, plain, home, audit = (tmp_path / name for name in ("strange", "plain", "home", "audit"))
    log = tmp_path / "opened"
    for path in (folder, plain, audit):
        path.mkdir()
    listener = set_traps(folder, home)
    (folder / "conf" / "protocol").mkdir(parents=True)
    (folder / "conf" / "protocol" / "near.yaml").write_text(NEAR)
    (audit / "sitecustomize.py").write_text(AUDIT.format(here=str(folder), log=str(log)))
    clean = {key: value for key, value in os.environ.items() if key not in ("MPLBACKEND", "MPLCONFIGDIR")}
    hostile = clean | {
        "PYTHONPATH": str(audit),
        "XDG_CONFIG_HOME": str(home),
        "MPLBACKEND": "module://FIRED",
    }
    for command in (*PREPARATION, *READING):
        if command[0] == "resume":
            shutil.copytree(folder / "typed" / "ppo", folder / "typed" / "again")
        run(command, folder, hostile)
        assert fired(folder, log) == [], command
    (trained,) = (folder / "typed" / "ppo" / "default").glob("ppo-*")
    shutil.copytree(folder / "typed", plain / "typed")
    for words in DRAWING:
        command = [f"typed/ppo/default/{trained.name}" if word == "RUN" else word for word in words]
        run(command, folder, hostile)
        assert fired(folder, log) == [], command
        run(command, plain, clean)
    drawn = figures(folder / "typed" / "drawn")
    assert len(drawn) > 10
    assert drawn == figures(plain / "typed" / "drawn")

    monkeypatch.chdir(folder)
    # `python -c`, with which these tests start servers, has the folder in its path, unlike the command.
    for key, value in {**hostile, "PYTHONSAFEPATH": "1"}.items():
        monkeypatch.setenv(key, value)
    with dds.domain(), dds.serving("vehicle=bluerov2"):
        pilot = dds.Process("pilot", "pid", "--vehicle", "bluerov2", "--record", "typed/missions")
        with contextlib.ExitStack() as ending:
            ending.callback(pilot.stop)
            pilot.says("bluerov2")
            pilot.send(signal.SIGINT)
            pilot.ends()
    assert fired(folder, log) == []
    listener.setblocking(False)
    with pytest.raises(BlockingIOError):
        listener.recv(1)
    listener.close()
