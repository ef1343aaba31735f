"""Where a run's numbers come from: versions, commit, machine."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

PACKAGES = (
    "auvbench",
    "torch",
    "stable-baselines3",
    "gymnasium",
    "numpy",
    "numba",
    "hydra-core",
    "omegaconf",
)


def versions() -> dict[str, str]:
    """Versions of Python, of the packages that the result depends on, and of Gazebo, a server over ROS 2 or ArduSub
    where this process uses them.
    """
    from auvbench.simulators.gazebo import bindings

    # Only where this process has a server: nothing of ROS 2 is imported to find that it has none.
    clients = map(sys.modules.get, ("auvbench.simulators.ros2", "auvbench.ardusub.radio"))
    used = [client.used() for client in clients if client is not None]
    return (
        _packages() | bindings.versions() | {name: version for each in used for name, version in each.items()}
    )


@cache
def _packages() -> dict[str, str]:
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            found[package] = "not installed"
    return found


@cache
def git() -> dict[str, Any]:
    """Commit of the checkout that auvbench runs from, and whether it was changed; None outside a checkout."""
    root = Path(__file__).resolve().parents[2]
    if not (root / ".git").exists():
        return {"commit": None, "dirty": None}

    def ask(*arguments: str) -> str | None:
        try:
            done = subprocess.run(
                ["git", "-C", str(root), *arguments], capture_output=True, text=True, timeout=10, check=True
            )
        except (OSError, subprocess.SubprocessError):
            return None
        return done.stdout.strip()

    changed = ask("status", "--porcelain", "--untracked-files=no")
    # A new file there is read or imported as the others are; elsewhere it is a note or a result.
    added = ask("status", "--porcelain", "--untracked-files=all", "--", "auvbench", "conf")
    dirty = None if changed is None or added is None else bool(changed or added)
    return {"commit": ask("rev-parse", "HEAD"), "dirty": dirty}


def host(threads: int = 1) -> dict[str, Any]:
    """Name, processor and cores of this machine, and the threads that step a run's environments there."""
    return {"name": platform.node(), "cpu": _processor(), "cores": os.cpu_count(), "threads": threads}


def _processor(information: Path = Path("/proc/cpuinfo")) -> str:
    """The processor's name; many virtual machines give one without a number ("AMD EPYC"), which gets family and model:
    machines of one name and several generations need not compute the same bits.
    """
    found: dict[str, str] = {}
    try:
        for line in information.read_text(encoding="utf-8").splitlines():
            key, _, value = line.partition(":")
            found.setdefault(key.strip(), value.strip())
    except OSError:
        pass
    name = found.get("model name") or platform.processor() or platform.machine()
    numbers = (found.get("cpu family"), found.get("model"))
    if all(numbers) and not any(character.isdigit() for character in name):
        return f"{name} (family {numbers[0]}, model {numbers[1]})"
    return name
