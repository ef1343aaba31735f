"""Paths that another person may have chosen: names out of files, and links inside folders that auvbench writes.

A folder from a stranger may hold links: `checkpoints` to a folder of photographs, in which cleaning up would delete,
or `train/log.txt` to a shell's start-up file, which would grow. A file in it may name `../../.bashrc`. So each name
out of a file passes `child`, and a run is searched for links before anything is written into it. Links above the
folder that the user typed are the user's own.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path

from auvbench.errors import RunError
from auvbench.untrusted.text import short

GROWING = "train"
"""the folder of files that grow in place; every other file is replaced by renaming, which spares a second name"""

LONGEST = 255
"""bytes of a name that a file system takes"""


def child(folder: Path | str, name: object) -> Path:
    """Return the path below `folder` that a file names.

    Args:
        folder: a folder that the user named.
        name: plain names joined by "/", as the file has it; any type.

    Raises:
        ValueError: a part is empty, hidden in another folder ("..", "/"), not printable or too long, or a link lies
            on the way.

    >>> child("run", "train/episodes.csv").as_posix()
    'run/train/episodes.csv'
    """
    path = Path(folder)
    for part in name.split("/") if isinstance(name, str) else [""]:
        if not is_plain(part):
            raise ValueError(f"{short(repr(name), 60)} is no name of a file below {path.name or 'it'}")
        path /= part
        if path.is_symlink():
            raise ValueError(_link(path))
    return path


def is_plain(name: str) -> bool:
    """Return whether a name is that of one file or folder, and nothing on a terminal but its characters."""
    return (
        name not in ("", ".", "..")
        and "/" not in name
        and name.isprintable()
        and len(name.encode()) <= LONGEST
    )


def refuse_links(run: Path | str) -> None:
    """Search a run's folder for what leads out of it; a folder that does not exist is fine.

    Raises:
        RunError: a link, a pipe or a device lies in it, or a growing file has a second name.
    """
    waiting = [str(run)]  # a stack: a folder may be nested deeper than Python recurses
    while waiting:
        try:
            entries = sorted(os.scandir(waiting.pop()), key=lambda entry: entry.name)
        except (FileNotFoundError, NotADirectoryError):
            continue
        for entry in entries:
            if entry.is_symlink():
                raise RunError(_link(entry.path))
            try:
                status = entry.stat(follow_symlinks=False)
            except FileNotFoundError:  # a lock's temporary file
                continue
            if stat.S_ISDIR(status.st_mode):
                waiting.append(entry.path)
            elif not stat.S_ISREG(status.st_mode):
                raise RunError(f"{entry.path}: neither a file nor a folder; remove it")
            elif status.st_nlink > 1 and Path(entry.path).parent.name == GROWING:
                raise RunError(
                    f"{entry.path}: the file has a second name (a hard link), which would grow with it; "
                    f"make it a copy: cp {entry.path} COPY && mv COPY {entry.path}"
                )


def check_output(folder: Path | str, names: tuple[str, ...] = ()) -> None:
    """Refuse a folder of results that is a link, or holds a link under one of `names`.

    Raises:
        RunError: one of them is a link.
    """
    for path in (Path(folder), *(Path(folder) / name for name in names)):
        if path.is_symlink():
            raise RunError(_link(path))


def _link(path: Path | str) -> str:
    return f"{path}: a symbolic link, which auvbench does not follow; replace it by what it leads to"
