"""The answers there are to a question, as files: for messages and completion, which must not wait for Hydra."""

from __future__ import annotations

from importlib import resources
from pathlib import Path


def names(group: str) -> list[str]:
    """The names that `group=NAME` takes: files of the package and of `./conf` of the working directory.

    >>> "thesis" in names("protocol")
    True
    """
    found: set[str] = set()
    for folder in (resources.files("auvbench.conf") / group, Path("conf") / group):
        if folder.is_dir():
            found |= {
                entry.name.removesuffix(".yaml") for entry in folder.iterdir() if entry.name.endswith(".yaml")
            }
    return sorted(found)
