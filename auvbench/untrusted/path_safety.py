"""Check paths that another person may have chosen: names in files, and links inside folders that auvbench
writes.

A folder from another person may contain links. If `checkpoints` leads to a folder of photographs, a clean-up
would delete them; if `train/log.txt` leads to a shell's start-up file, a training would append to it. A file in
the folder may name `../../.bashrc`. So `child` checks each name from a file, and a run is searched for links
before anything is written into it. Links in the path to the folder are not checked, since the user typed that path.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path

from auvbench.errors import RunError
from auvbench.untrusted.text import short

GROWING = "train"
"""Folder with files to which auvbench appends. Appending would also change the content under a second hard link to the file,
so `refuse_links` rejects such a link. Other files are replaced by renaming, which leaves a second hard link unchanged.
"""

LONGEST = 255
"""largest length of a file name in bytes"""


def child(folder: Path | str, name: object) -> Path:
    """Return the path below `folder` for a name that was read from a file.

    Args:
        folder: folder that the user named.
        name: value read from the file; only a text of plain names joined by "/" is valid.

    Raises:
        ValueError: a part of the name is empty, leads elsewhere ("..", "/"), is not printable or is too long, or
            the path contains a link.

    >>> child("run", "train/episodes.csv").as_posix()
    'run/train/episodes.csv'
    """
    path = Path(folder)
    for part in name.split("/") if isinstance(name, str) else [""]:
        if not is_plain(part):
            raise ValueError(
                f"{short(repr(name), 60)} is not a valid name of a file below {path.name or 'it'}"
            )
        path /= part
        if path.is_symlink():
            raise ValueError(_link(path))
    return path


def is_plain(name: str) -> bool:
    """Return whether a text names one file or folder, with only printable characters."""
    return (
        name not in ("", ".", "..")
        and "/" not in name
        and name.isprintable()
        and len(name.encode()) <= LONGEST
    )


def refuse_links(run: Path | str) -> None:
    """Check that nothing in a run's folder leads out of the folder; a missing folder passes the check.

    Raises:
        RunError: the folder contains a link, a pipe or a device, or a file in `GROWING` has a second hard link.
    """
    waiting = [str(run)]  # a stack, because folders may be nested deeper than Python's recursion limit
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
            except FileNotFoundError:  # a temporary file that another process has removed
                continue
            if stat.S_ISDIR(status.st_mode):
                waiting.append(entry.path)
            elif not stat.S_ISREG(status.st_mode):
                raise RunError(f"{entry.path}: is neither a file nor a folder; remove it")
            elif status.st_nlink > 1 and Path(entry.path).parent.name == GROWING:
                raise RunError(
                    f"{entry.path}: is a hard link: a resumed run appends to this file, so the file under its second name would change too; "
                    f"make it a copy: cp {entry.path} COPY && mv COPY {entry.path}"
                )


def check_output(folder: Path | str, names: tuple[str, ...] = ()) -> None:
    """Raise RunError if a folder of results is a link, or contains a link under one of `names`.

    Raises:
        RunError: a link was found.
    """
    for path in (Path(folder), *(Path(folder) / name for name in names)):
        if path.is_symlink():
            raise RunError(_link(path))


def _link(path: Path | str) -> str:
    return f"{path}: is a symbolic link, which auvbench does not follow; replace it by its target"
