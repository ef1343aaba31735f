"""Record the provenance of a run's numbers: versions, commit, machine."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

from auvbench import integrations

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
    """Return the versions of Python, of the packages that affect the result, and of the external simulators and autopilots
    that this process uses.
    """
    # Look only at modules that are already loaded, so that this function imports no client of a simulator.
    loaded = [module for module in map(sys.modules.get, integrations.USED) if module is not None]
    return _packages() | {name: version for module in loaded for name, version in module.used().items()}


@cache
def _packages() -> dict[str, str]:
    packages = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            packages[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            packages[package] = "not installed"
    return packages


@cache
def git() -> dict[str, Any]:
    """Return the commit of the checkout that auvbench runs from, and whether the checkout was changed; both None outside a
    checkout.
    """
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
    # auvbench reads or imports a new file in these folders, so this file is a change of the checkout. A new file elsewhere is
    # only a note or a result.
    added = ask("status", "--porcelain", "--untracked-files=all", "--", "auvbench", "conf")
    dirty = None if changed is None or added is None else bool(changed or added)
    return {"commit": ask("rev-parse", "HEAD"), "dirty": dirty}


def host(threads: int = 1) -> dict[str, Any]:
    """Return name, processor and number of cores of this machine, and the number of threads that step a run's environments."""
    return {"name": platform.node(), "cpu": _processor(), "cores": os.cpu_count(), "threads": threads}


def _processor(information: Path = Path("/proc/cpuinfo")) -> str:
    """Return the processor's name.

    Many virtual machines give a name without a number ("AMD EPYC"). Family and model are then added: processors with the
    same name but of different generations need not compute the same bits.
    """
    fields: dict[str, str] = {}
    try:
        for line in information.read_text(encoding="utf-8").splitlines():
            key, _, value = line.partition(":")
            fields.setdefault(key.strip(), value.strip())
    except OSError:
        pass
    name = fields.get("model name") or platform.processor() or platform.machine()
    numbers = (fields.get("cpu family"), fields.get("model"))
    if all(numbers) and not any(character.isdigit() for character in name):
        return f"{name} (family {numbers[0]}, model {numbers[1]})"
    return name
