"""The answers there are to a question, as files: for messages and completion, which must not wait for Hydra."""

from __future__ import annotations

from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path

from auvbench.config import plugins


def folders(group: str) -> list[Traversable]:
    """Where the answers of a question lie, each before those that win over it.

    Raises:
        ConfigError: the folder of an installed package is not there.
    """
    installed = [found.path / group for found in reversed(plugins.folders())]
    return [*installed, resources.files("auvbench.conf") / group, Path("conf") / group]


def names(group: str) -> list[str]:
    """The names that `group=NAME` takes: files of auvbench, of installed packages and of `./conf` of the working directory.

    >>> "thesis" in names("protocol")
    True
    """
    found: set[str] = set()
    for folder in folders(group):
        if folder.is_dir():
            found |= {
                entry.name.removesuffix(".yaml") for entry in folder.iterdir() if entry.name.endswith(".yaml")
            }
    return sorted(found)
