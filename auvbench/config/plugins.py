"""What installed packages bring along: agents, simulators and folders of configuration, found by their entry points.

A package declares them in its metadata (the Python packaging standard's entry points); nothing else is ever loaded, no
path and no code that a configuration or a run directory names. What there is, is read from the metadata alone; a
package is imported when something of it is chosen.
"""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

from auvbench.errors import ConfigError
from auvbench.untrusted.text import short

AGENTS, SIMULATORS, CONF = "auvbench.agents", "auvbench.simulators", "auvbench.conf"
"""The groups of entry points. `module:object` of an agent or a simulator; of the third, the dotted path of a folder."""

KEYS = {AGENTS: "algo.agent", SIMULATORS: "simulator.name"}
"""The key of a configuration that names one of a group."""


@dataclass(frozen=True, slots=True)
class Declared:
    """An entry point, and the package whose it is."""

    group: str
    name: str
    value: str
    package: str
    version: str

    @property
    def release(self) -> str:
        """The package as a requirement, `auvbench-example==1.0`: part of a run's configuration, and so of its identity."""
        return f"{self.package}=={self.version}"


@cache
def declared(group: str) -> tuple[Declared, ...]:
    """All entry points of a group, by name and package; nothing is imported."""
    found = set()
    for point in metadata.entry_points(group=group):
        package = point.dist.name if point.dist is not None else "?"
        version = point.dist.version if point.dist is not None else "?"
        found.add(Declared(group, point.name, point.value, package, version))
    return tuple(sorted(found, key=lambda one: (one.name, one.package, one.value)))


def find(group: str, name: str, own: Iterable[str] = ()) -> Declared | None:
    """The entry point of this name; None where there is none.

    Args:
        group: `AGENTS` or `SIMULATORS`.
        name: its name.
        own: the names that auvbench has itself.

    Raises:
        ConfigError: several packages declare it, or auvbench has one of that name itself.
    """
    found = [one for one in declared(group) if one.name == name]
    if not found:
        return None
    packages = sorted({one.package for one in found})
    key = KEYS[group]
    if name in own:
        raise ConfigError(
            f"{key}={short(name)}: auvbench has one of that name, and {_and(packages)} declares another; uninstall it: "
            f"pip uninstall {packages[0]}"
        )
    if len(found) > 1:
        several = f"{_and(packages)} declare" if len(packages) > 1 else f"{packages[0]} declares"
        raise ConfigError(
            f"{key}={short(name)}: {several} {'one each' if len(packages) > 1 else 'it twice'}, and a name must stand "
            f"for one; uninstall one of them: pip uninstall {packages[-1]}"
        )
    return found[0]


def missing(group: str, name: str, release: str) -> ConfigError:
    """The error of a configuration whose package is not installed, or in another version."""
    here = find(group, name)
    now = "is not installed" if here is None else f"{here.release} is installed"
    return ConfigError(
        f"{KEYS[group]}={short(name)}: comes with {short(release)}, and {now}; pip install '{short(release)}'"
    )


@cache
def load(one: Declared) -> Any:
    """Imports what an entry point names.

    Raises:
        ConfigError: it cannot be imported, or is not there.
    """
    module, _, name = one.value.partition(":")
    try:
        found = importlib.import_module(module.strip())
        for part in filter(None, name.split("[")[0].strip().split(".")):
            found = getattr(found, part)
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # all that a package may do when it is imported, an exit included
        raise ConfigError(
            f"{KEYS[one.group]}={one.name}: {one.value} of {one.release} cannot be imported: {describe_error(error)}"
        ) from error
    return found


def describe_error(error: BaseException) -> str:
    """An exception of foreign code in one line."""
    text = next(iter(str(error).splitlines()), "")
    return short(f"{type(error).__name__}: {text}" if text else type(error).__name__, 200)


@dataclass(frozen=True, slots=True)
class Folder:
    """A folder of YAML files for Hydra's search path."""

    path: Path
    release: str


@cache
def folders() -> tuple[Folder, ...]:
    """The folders that `auvbench.conf` entry points name, found without importing their packages.

    Raises:
        ConfigError: a folder is not there.
    """
    found = []
    for one in declared(CONF):
        top, *below = one.value.partition(":")[0].strip().split(".")
        try:
            spec = importlib.util.find_spec(top) if re.fullmatch(r"\w+", top) else None
        except (ImportError, ValueError):
            spec = None
        places = [Path(place, *below) for place in (spec.submodule_search_locations or ())] if spec else []
        path = next((place for place in places if place.is_dir()), None)
        if path is None:
            raise ConfigError(
                f"auvbench.conf: {one.value} of {one.release} is no folder of an installed package; "
                f"pip uninstall {one.package}, or install one that has it"
            )
        found.append(Folder(path, one.release))
    return tuple(found)


def _and(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def forget() -> None:
    """Looks at what is installed anew: for tests, and for programs that install packages as they run."""
    for cached in (declared, load, folders):
        cached.cache_clear()
