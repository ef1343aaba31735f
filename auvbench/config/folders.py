"""Find the folders with configuration files: auvbench's `conf/`, folders of installed packages, and `./conf`."""

from __future__ import annotations

import importlib.util
import os
import re
from functools import cache
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path

from auvbench import registry
from auvbench.errors import ConfigError

State = tuple[tuple[str, int, int, int, int], ...]

GROUP = "auvbench.conf"
"""Group of entry points; the value of each entry point is the dotted path of a folder."""


@cache
def packages() -> tuple[tuple[str, Path], ...]:
    """Return the release and path of each folder that an `auvbench.conf` entry point names, without importing a package.

    Raises:
        ConfigError: a folder does not exist.
    """
    folders = []
    for point in registry.declared(GROUP, GROUP):
        top, *below = point.value.split(".")
        spec = importlib.util.find_spec(top) if re.fullmatch(r"\w+", top) else None
        places = [Path(place, *below) for place in (spec.submodule_search_locations or ())] if spec else []
        path = next((place for place in places if place.is_dir()), None)
        if path is None:
            raise ConfigError(
                f"auvbench.conf: {point.value} of {point.release} is not a folder of an installed package; "
                f"pip uninstall {point.package}, or install a version that has the folder"
            )
        folders.append((point.release, path))
    return tuple(folders)


def state(folder: Path) -> State:
    """Return path, inode, size and times of each file below a folder; if these are unchanged, so are the files' contents."""
    entries = []
    for place, _, names in os.walk(folder):
        for name in names:
            path = os.path.join(place, name)
            try:
                entry = os.stat(path)  # follows a link to its target
            except OSError:
                entries.append((path, 0, 0, 0, 0))
            else:
                entries.append((path, entry.st_ino, entry.st_size, entry.st_mtime_ns, entry.st_ctime_ns))
    return tuple(sorted(entries))


def of_group(group: str) -> list[Traversable]:
    """Return the folders with the files of a group; a file in a later folder replaces the same file in an earlier folder.

    Raises:
        ConfigError: the folder of an installed package does not exist.
    """
    installed = [path / group for _, path in reversed(packages())]
    return [*installed, resources.files("auvbench.conf") / group, Path("conf") / group]


def options(group: str) -> list[str]:
    """Return the valid names in `group=NAME`, without the slow import of Hydra.

    >>> "thesis" in options("protocol")
    True
    """
    entries = [entry for folder in of_group(group) if folder.is_dir() for entry in folder.iterdir()]
    return sorted({e.name.removesuffix(".yaml") for e in entries if e.name.endswith(".yaml")})


def misnamed(group: str, name: str) -> Path | None:
    """Return the user's file conf/GROUP/NAME.yml if it exists: no command reads a file that ends in .yml. Else return None."""
    path = Path("conf") / group / f"{name.removesuffix('.yml').removesuffix('.yml.yaml')}.yml"
    return path if re.fullmatch(r"[\w.-]{1,100}", name) and path.is_file() else None
