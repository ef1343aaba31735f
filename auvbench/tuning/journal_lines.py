"""The lines of a study's journal: which are whole, what a kill left of the last, which are damaged."""

from __future__ import annotations

import json
from pathlib import Path

from auvbench.errors import RunError
from auvbench.runs.atomic_io import storage
from auvbench.untrusted import documents, reading

LARGEST = 1 << 28
"""bytes of a journal that is read"""


def read(path: Path) -> tuple[int, bytes]:
    """How many whole lines a journal has, and what a kill left of one at its end.

    Raises:
        RunError: a line that is not the last is damaged, or the file cannot be read.
    """
    try:
        data = reading.content(path, LARGEST)
    except FileNotFoundError:
        return 0, b""
    except (OSError, ValueError) as error:
        raise RunError(f"{path}: cannot be read: {error}") from error
    from optuna.storages.journal._storage import JournalOperation

    lines = data.split(b"\n")
    torn = lines.pop()
    for number, line in enumerate(lines, 1):
        if why := _wrong(line):
            if number == len(lines) and not torn:
                return number - 1, line + b"\n"
            raise RunError(
                f"{path} line {number} of {len(lines) + bool(torn)} is damaged ({why}), and what came after it builds on it: "
                f"restore the file from a copy, or begin its decisions anew (mv {path} ELSEWHERE): runs that are whole are "
                "not trained again"
            )
        if (kind := json.loads(line)["op_code"]) not in list(JournalOperation):
            raise RunError(
                f"{path} line {number}: an event of kind {kind}, which this auvbench does not know; use the auvbench that "
                "wrote it, or give the study another name"
            )
    return len(lines), torn


def _wrong(line: bytes) -> str:
    try:
        event = documents.json_value(line)
    except ValueError as error:
        return str(error).splitlines()[0] or "no JSON"
    if not isinstance(event, dict) or type(event.get("op_code")) is not int:
        return "no event of a journal"
    return ""


def take_out(path: Path, torn: bytes) -> str:
    """Cuts off a line that is not whole, keeps it beside, and says so."""
    beside = path.with_name(f"{path.name}.torn")
    with storage(f"cannot write {path}"):
        with open(beside, "ab") as kept:
            kept.write(torn.rstrip(b"\n") + b"\n")
        with open(path, "r+b") as file:
            file.truncate(path.stat().st_size - len(torn))
    return f"{path}: its last line was cut short, by a kill perhaps; it is in {beside.name} now, and the study goes on before it"
