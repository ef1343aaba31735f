"""Load Gazebo's Python bindings when a simulator is created."""

from __future__ import annotations

import os
import re
from functools import cache
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from auvbench.errors import ConfigError

INSTALL = (
    "on Ubuntu 24.04 with Gazebo's package repository: sudo apt install gz-harmonic python3-gz-sim8, then a virtual"
    " environment that sees it: python3 -m venv --system-site-packages .venv"
)
"""How to install the bindings (docs/gazebo.md has more)."""

_MODULES = (
    "gz.sim8",
    "gz.math7",
    "gz.transport13",
    "gz.common5",
    "gz.msgs10.boolean_pb2",
    "gz.msgs10.entity_factory_v_pb2",
    "gz.msgs10.entity_pb2",
    "gz.msgs10.physics_pb2",
    "gz.msgs10.world_control_pb2",
)


@cache
def load() -> SimpleNamespace:
    """Load the bindings and choose a partition for this process.

    The process has its own partition, so that services of concurrent runs stay apart. The user can set
    GZ_PARTITION to watch a run.

    Raises:
        ConfigError: see `modules`.
    """
    os.environ.setdefault("GZ_PARTITION", f"auvbench-{os.getpid()}")
    os.environ.setdefault("GZ_IP", "127.0.0.1")
    sim, math, transport, common, *messages = modules()
    common.set_verbosity(1)  # errors only: Gazebo logs developers' notes at every reset
    boolean, factories, entity, physics, control = messages
    return SimpleNamespace(
        sim=sim,
        math=math,
        transport=transport,
        boolean=boolean.Boolean,
        entity_factories=factories.EntityFactory_V,
        entity=entity.Entity,
        physics=physics.Physics,
        world_control=control.WorldControl,
    )


def modules() -> list[Any]:
    """Import the bindings without setting GZ_PARTITION, so that child processes choose their own partitions.

    Raises:
        ConfigError: the bindings are not installed; the message says how to install them.
    """
    try:
        return [import_module(name) for name in _MODULES]
    except ImportError as error:
        raise ConfigError(f"simulator=gazebo: {error}; {INSTALL}") from error


def missing() -> str | None:
    """Return why Gazebo cannot be used on this machine; None if Gazebo can be used."""
    try:
        load()
    except ConfigError as error:
        return str(error)
    return None


_LIBRARY = re.compile(r"lib(gz-sim8|gz-physics7|sdformat14|dart)\.so\.([0-9.]+)$")


def used() -> dict[str, str]:
    """Return the versions of Gazebo's libraries that are mapped into this process, by name, sorted."""
    libraries: dict[str, str] = {}
    try:
        lines = Path("/proc/self/maps").read_text(encoding="utf-8").splitlines()
    except OSError:  # not Linux
        return libraries
    for line in lines:
        # The kernel lists a library by its file, whose name has the full version, even if it was opened by a symbolic link.
        if match := _LIBRARY.search(line):
            libraries[match.group(1)] = match.group(2)
    return dict(sorted(libraries.items()))
