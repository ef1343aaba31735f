"""The message for a path of runs that does not exist, with the path that was probably meant."""

from __future__ import annotations

import difflib
import os
from pathlib import Path

OUTPUTS = Path("outputs")
"""Folder of runs where none is chosen"""


def missing(path: Path) -> str:
    """Return one line: the path, and the closest one that exists.

    The id of a run, or the start of one, is proposed with its folder.
    """
    near = _run(path.name) or _sibling(path)
    return f"{path}: no such file or directory" + (f"; did you mean {near}?" if near else "")


def _run(name: str) -> Path | None:
    """Return the first run under `outputs` whose id is, or begins with, a name."""
    found = sorted(run.parent for run in OUTPUTS.glob("*/*/manifest.json")) if OUTPUTS.is_dir() else []
    ids = difflib.get_close_matches(name, [run.name for run in found], n=1, cutoff=0.8)
    return next((run for run in found if (name and run.name.startswith(name)) or run.name in ids), None)


def _sibling(path: Path) -> Path | None:
    try:
        names = [entry.name for entry in os.scandir(path.parent) if entry.is_dir()]
    except OSError:
        return None
    near = difflib.get_close_matches(path.name, names, n=1, cutoff=0.6)
    return path.with_name(near[0]) if near else None
