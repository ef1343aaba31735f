"""Digests: what a file held when a manifest or a summary vouched for it, checked wherever it is read.

A manifest and a summary carry a `files` table (path below them -> bytes and SHA-256) and a `seal`, the SHA-256 of
all their other entries. So a flipped bit in a file, in its digest or in a number beside it is noticed. Those that
were written before digests were kept have neither, and nothing can be said of them.

This tells accidents from results. Whoever wants to deceive can write digests that fit.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from auvbench.errors import RunError
from auvbench.runs.atomic_io import sha256
from auvbench.untrusted import archives, path_safety, reading

SEAL = "seal"
FILES = "files"

Entry = dict[str, Any]
"""{"bytes": length, "sha256": digest} of a file"""


def entry(data: bytes) -> Entry:
    """What is written down of a file that holds `data`."""
    return {"bytes": len(data), "sha256": sha256(data)}


def entry_of(path: Path) -> Entry:
    """`entry` of a file on disk, read in pieces.

    Raises:
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
        return {"bytes": file.tell(), "sha256": digest}


def sealed(value: Mapping[str, Any]) -> dict[str, Any]:
    """The same with its seal as the last entry."""
    bare = {key: item for key, item in value.items() if key != SEAL}
    return {**bare, SEAL: _seal(bare)}


def broken_seal(value: Mapping[str, Any]) -> str:
    """Why a manifest or summary is not what was written, in words; empty where it is, or was never sealed."""
    if SEAL not in value:
        # One flipped bit can take away the name of one of the two, not of both.
        return f"its {SEAL} is missing" if FILES in value else ""
    bare = {key: item for key, item in value.items() if key != SEAL}
    return "" if value[SEAL] == _seal(bare) else f"it was changed since it was written (its {SEAL} differs)"


def difference(data: bytes, expected: Any) -> str:
    """How the content of a file differs from its entry, in words; empty where it does not."""
    if not isinstance(expected, Mapping) or not isinstance(expected.get("sha256"), str):
        return "has no digest that could be checked"
    if len(data) != expected.get("bytes"):
        return f"has {len(data):,} bytes instead of {expected.get('bytes')}"
    return "" if sha256(data) == expected["sha256"] else "differs from its digest: it was changed or damaged"


def table(holder: Mapping[str, Any]) -> dict[str, Any] | None:
    """The files that a manifest or summary vouches for; None where it was written before digests were kept."""
    files = holder.get(FILES)
    return dict(files) if isinstance(files, Mapping) else None


def digests(holder: Mapping[str, Any], prefix: str) -> dict[str, Any] | None:
    """The SHA-256 of the files whose names begin so; None where it was written before digests were kept."""
    files = table(holder)
    if files is None:
        return None
    chosen = {name: item for name, item in files.items() if name.startswith(prefix)}
    return {n: item.get("sha256") if isinstance(item, Mapping) else None for n, item in chosen.items()}


def check(holder: Mapping[str, Any], name: str, data: bytes, where: Path) -> None:
    """Checks the content of one file against the manifest or summary that vouches for it.

    Args:
        holder: the manifest or summary; one without digests vouches for nothing, and nothing is checked.
        name: of the file, as the table has it.
        data: what it holds.
        where: the file, for the message.

    Raises:
        RunError: it is not what was written.
    """
    files = table(holder)
    if files is None:
        return
    if wrong := difference(data, files.get(name)):
        raise RunError(f"{where}: {wrong}")


def lacking(folder: Path, holder: Mapping[str, Any], prefix: str = "", *, deep: bool = True) -> str:
    """Which file that is vouched for is not there as it was written, and why; empty where all are.

    Args:
        folder: what the names in the table are relative to.
        holder: the manifest or summary.
        prefix: only files whose names begin so.
        deep: read and compare the content; without it, only the size.
    """
    for name, expected in (table(holder) or {}).items():
        if not name.startswith(prefix):
            continue
        try:
            path = path_safety.child(folder, name)
            if deep:
                wrong = difference(reading.content(path, archives.FILE), expected)
            else:
                size = path.stat().st_size
                same = isinstance(expected, Mapping) and size == expected.get("bytes")
                wrong = "" if same else f"has {size:,} bytes, not those that were written"
        except FileNotFoundError:
            wrong = "is missing"
        except (OSError, ValueError) as error:
            wrong = f"cannot be read: {getattr(error, 'strerror', None) or error}"
        if wrong:
            return f"{name} {wrong}"
    return ""


def _seal(bare: Mapping[str, Any]) -> str:
    return sha256(json.dumps(bare, sort_keys=True, separators=(",", ":")).encode())
