"""Agents, tasks, rewards and folders of configuration that installed packages declare as entry points.

Nothing else is ever loaded: no path and no code that a configuration or a run directory names. Names come from the
metadata alone; a package is imported when something of it is chosen.
"""

from __future__ import annotations

import importlib
import importlib.util
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib import metadata, resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from auvbench.errors import AgentError, AuvbenchError, ConfigError, PluginImportError
from auvbench.untrusted.text import first_line, short

AGENTS, TASKS, REWARDS = "auvbench.agents", "auvbench.tasks", "auvbench.rewards"
"""The groups of entry points `module:object`: of an agent, a `TaskSpec`, a `RewardSpec`."""
CONF = "auvbench.conf"
"""The group of entry points that are the dotted path of a folder."""

KEYS = {AGENTS: "algo.agent", TASKS: "task.name", REWARDS: "reward.name"}
"""The key of a configuration that names an entry point of a group"""


@dataclass(frozen=True, slots=True, order=True)
class Declared:
    """An entry point with its package."""

    group: str
    name: str
    package: str
    value: str
    version: str

    @property
    def release(self) -> str:
        """The package as a requirement, `auvbench-example==1.0`: part of a run's configuration and identity."""
        return f"{self.package}=={self.version}"

    def error(self, reason: str) -> ConfigError:
        """Return an error that names key, entry point and package."""
        return ConfigError(f"{KEYS[self.group]}={self.name}: {self.value} of {self.release} {reason}")


@cache
def _entry_points() -> Any:  # one type in Python 3.11, another in 3.12
    """Return those of all groups: each call of the library reads the files of every installed package anew."""
    return metadata.entry_points()


@cache
def declared(group: str) -> tuple[Declared, ...]:
    """Return all entry points of a group, by name and package; nothing is imported."""
    return tuple(
        sorted({
            Declared(group, point.name, point.dist.name, point.value, point.dist.version)
            for point in _entry_points().select(group=group)
            if point.dist is not None
        })
    )  # fmt: skip


def find(group: str, name: str, own: Iterable[str] = ()) -> Declared | None:
    """Return the entry point of this name, or None.

    Args:
        group: one of `KEYS`.
        name: its name.
        own: the names that auvbench itself has.

    Raises:
        ConfigError: several packages declare it, or auvbench has the name itself.
    """
    found = [one for one in declared(group) if one.name == name]
    holders = [*(["auvbench"] if name in own else []), *(one.package for one in found)]
    if found and len(holders) > 1:
        raise ConfigError(
            f"{KEYS[group]}={short(name)}: {' and '.join(holders)} have one of that name each; uninstall one: pip uninstall "
            f"{holders[-1]}"
        )
    return found[0] if found else None


def missing(group: str, name: str, release: str) -> ConfigError:
    """Return the error of a configuration whose package is not installed in its version."""
    here = find(group, name)
    now = "is not installed" if here is None else f"{here.release} is installed"
    return ConfigError(
        f"{KEYS[group]}={short(name)}: comes with {short(release)}, and {now}; pip install '{short(release)}'"
    )


@cache
def load(one: Declared) -> Any:
    """Import the object of an entry point.

    Raises:
        ConfigError: it cannot be imported, or does not exist.
    """
    try:
        return metadata.EntryPoint(one.name, one.value, one.group).load()
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # all that a package may do when it is imported, an exit included
        raise PluginImportError(str(one.error(f"cannot be imported: {describe_error(error)}"))) from error


def resolve(target: str) -> Any:
    """Return the object that "module:name" of a registry, or of what an entry point names, stands for."""
    module, _, name = target.partition(":")
    return getattr(importlib.import_module(module), name)


def describe_error(error: BaseException) -> str:
    """Return an exception of foreign code in one line."""
    kind = type(error).__name__
    return short(f"{kind}: {first_line(error)}" if str(error) else kind)


@contextmanager
def telling(who: str, what: str) -> Iterator[None]:
    """Turn an exception of foreign code into an `AgentError` that names the plug-in and the call."""
    try:
        yield
    except AuvbenchError:
        raise
    except Exception as error:
        raise AgentError(f"{who}: {what}: {describe_error(error)}") from error


@cache
def folders() -> tuple[tuple[str, Path], ...]:
    """Return release and path of the folders of `auvbench.conf` entry points; no package is imported.

    Raises:
        ConfigError: a folder does not exist.
    """
    found = []
    for one in declared(CONF):
        top, *below = one.value.split(".")
        spec = importlib.util.find_spec(top) if re.fullmatch(r"\w+", top) else None
        places = [Path(place, *below) for place in (spec.submodule_search_locations or ())] if spec else []
        path = next((place for place in places if place.is_dir()), None)
        if path is None:
            raise ConfigError(
                f"auvbench.conf: {one.value} of {one.release} is no folder of an installed package; "
                f"pip uninstall {one.package}, or install one that has it"
            )
        found.append((one.release, path))
    return tuple(found)


def option_folders(group: str) -> list[Traversable]:
    """Return the folders with the options of a group; a file in a later folder wins.

    Raises:
        ConfigError: the folder of an installed package does not exist.
    """
    installed = [path / group for _, path in reversed(folders())]
    return [*installed, resources.files("auvbench.conf") / group, Path("conf") / group]


def options(group: str) -> list[str]:
    """Return the names that `group=NAME` takes, without waiting for Hydra.

    >>> "thesis" in options("protocol")
    True
    """
    entries = [entry for folder in option_folders(group) if folder.is_dir() for entry in folder.iterdir()]
    return sorted({e.name.removesuffix(".yaml") for e in entries if e.name.endswith(".yaml")})


def misnamed(group: str, name: str) -> Path | None:
    """Return the user's file of an option that ends in .yml, which no command reads; None without one."""
    path = Path("conf") / group / f"{name.removesuffix('.yml').removesuffix('.yml.yaml')}.yml"
    return path if re.fullmatch(r"[\w.-]{1,100}", name) and path.is_file() else None


def forget() -> None:
    """Clear what is cached; `installed.forget` clears the registries too."""
    for cached in (_entry_points, declared, load, folders):
        cached.cache_clear()
