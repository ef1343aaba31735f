"""Nothing is written or deleted outside a run's own folder: a run that holds a link out of it is refused.

Whoever unpacks a run from a stranger has folders and files that may be links to anything: `checkpoints` to a
folder of photographs, in which cleaning up would delete, `train/log.txt` to a shell's start-up file, to which
lines would be appended. Where the run's folder itself lies, and through which links one gets there, is the
user's own affair.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path

from auvbench.errors import RunError

APPENDED = "train"
"""the folder of files that grow in place; all others are replaced by renaming, which leaves a second name alone"""


def check(run: Path | str) -> None:
    """Looks at everything in a run's folder; a folder that is not there is fine.

    Raises:
        RunError: a link, a pipe or a device is in it, or a growing file has another name elsewhere.
    """
    for place in _foreign(str(run)):
        raise RunError(place)


def check_output(folder: Path | str, names: tuple[str, ...] = ()) -> None:
    """That a folder of results is not a link, nor what is to be written into it under `names`.

    Raises:
        RunError: one of them is a link.
    """
    for path in (Path(folder), *(Path(folder) / name for name in names)):
        if path.is_symlink():
            raise RunError(_link(str(path)))


def is_below(name: object) -> bool:
    """Whether a name out of a file leads to a place below the folder that it is relative to."""
    if not isinstance(name, str) or not name or "\0" in name:
        return False
    parts = Path(name).parts
    return not Path(name).is_absolute() and ".." not in parts


def _link(path: str) -> str:
    return (
        f"{path}: a symbolic link where auvbench would write; it writes to no place that a folder leads it to: "
        "remove the link, or put the files themselves there"
    )


def _foreign(folder: str) -> list[str]:
    """The first thing that does not belong into a run, in words."""
    waiting = [folder]
    while waiting:
        here = waiting.pop()
        try:
            entries = sorted(os.scandir(here), key=lambda entry: entry.name)
        except (FileNotFoundError, NotADirectoryError):
            continue
        for entry in entries:
            if entry.is_symlink():
                return [_link(entry.path)]
            if entry.is_dir(follow_symlinks=False):
                waiting.append(entry.path)
                continue
            if not entry.is_file(follow_symlinks=False):
                if not os.path.lexists(entry.path):  # a lock's temporary name, gone meanwhile
                    continue
                return [f"{entry.path}: neither a file nor a folder; a run holds nothing else: remove it"]
            if os.path.basename(here) == APPENDED and _has_another_name(entry):
                return [
                    f"{entry.path}: the file has a second name elsewhere (a hard link), which would grow with it; "
                    f"make it a copy: cp {entry.path} COPY && mv COPY {entry.path}"
                ]
    return []


def _has_another_name(entry: os.DirEntry[str]) -> bool:
    try:
        status = entry.stat(follow_symlinks=False)
    except FileNotFoundError:
        return False
    return stat.S_ISREG(status.st_mode) and status.st_nlink > 1
