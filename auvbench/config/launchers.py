"""Define the schemas of the `launcher` group, and the spec of the launcher on this machine.

Importing this module imports no launcher.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from auvbench.config.schema import choice_of, number
from auvbench.config.schema import name as plain_name
from auvbench.registry import LAUNCHERS, Spec


@dataclass(kw_only=True)
class Launcher:
    """Keys of every launcher. A launcher decides where the runs of a grid are trained; it does not change their results."""

    name: str = choice_of(lambda: LAUNCHERS.own)


@dataclass(kw_only=True)
class Local(Launcher):
    """Keys of the launcher that trains runs in processes on this machine."""

    workers: int = number(0, 100_000)


@dataclass(kw_only=True)
class LauncherConfig(Launcher):
    """The `launcher` configuration of an installed package; a subclass adds its own keys."""

    name: str = plain_name()
    package: str


@dataclass(frozen=True, slots=True)
class LauncherSpec(Spec):
    """Description of one value of `launcher.name`, available without importing its code."""

    base: ClassVar[type] = LauncherConfig

    name: str
    """Value of `launcher.name`."""
    factory: str
    """`module:callable` that returns a `scheduling.loop.Backend`. Its arguments are the options (an instance of `schema`),
    the function that a worker calls with a run directory (as `module:function`), and whether any run learns.
    """
    schema: type = LauncherConfig
    """Keys of `launcher` with their types and ranges; in a package, derived from `LauncherConfig`."""


local = LauncherSpec("local", "auvbench.scheduling.local:make", Local)
