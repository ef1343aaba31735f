"""What has been found so far: a line per search, on the disk before the next one is begun."""

from __future__ import annotations

import base64
import json
import os
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from auvbench.evaluation.bounds.search import Found
from auvbench.runs.atomic_io import fsync_directory, make_folder, storage
from auvbench.untrusted import documents, reading

Key = tuple[str, int, int]
"""condition, pass (1 or 2), episode"""


class Journal:
    """A file that only grows; a line that a crash cut off is ignored and written over.

    Args:
        path: of the file; its folders are made.
        header: what the search is of. What belongs to another header is thrown away.

    Raises:
        TrainingError: the disk is full, read-only or failing.
    """

    def __init__(self, path: Path, header: Mapping[str, Any]) -> None:
        self.path = path
        with storage(f"cannot write {path}"):
            make_folder(path.parent)
            self.found, good = _read(path, header)
            self._file = path.open("r+b" if good else "wb")
            if good:
                self._file.truncate(good)
                self._file.seek(good)
            else:
                self._file.write(_line(dict(header)))
            self._flush()
            fsync_directory(path.parent)

    def add(self, key: Key, found: Found) -> None:
        """Keeps a result.

        Raises:
            TrainingError: the disk is full, read-only or failing.
        """
        condition, turn, episode = key
        entry = {
            "condition": condition,
            "pass": turn,
            "episode": episode,
            "start": found.start,
            "solved": found.solved,
            "failed": found.failed,
            "actuators": found.commands.shape[1],
            "commands": base64.b85encode(zlib.compress(found.commands.tobytes())).decode("ascii"),
        }
        with storage(f"cannot write {self.path}"):
            self._file.write(_line(entry))
            self._flush()
        self.found[key] = found

    def close(self) -> None:
        self._file.close()

    def remove(self) -> None:
        """It is not needed any more."""
        self.close()
        self.path.unlink(missing_ok=True)

    def _flush(self) -> None:
        self._file.flush()
        os.fsync(self._file.fileno())


def _line(entry: Mapping[str, Any]) -> bytes:
    return json.dumps(entry, sort_keys=True).encode() + b"\n"


def _read(path: Path, header: Mapping[str, Any]) -> tuple[dict[Key, Found], int]:
    """What a journal of this header holds, and the bytes that its whole lines take; nothing and 0 where it is of another."""
    try:
        data = reading.content(path, reading.DATA)
    except FileNotFoundError:
        return {}, 0
    except ValueError:
        return {}, 0
    lines = data.split(b"\n")
    if lines[0] + b"\n" != _line(header):
        return {}, 0
    found: dict[Key, Found] = {}
    good = len(lines[0]) + 1
    for line in lines[1:-1]:
        try:
            key, entry = _entry(documents.json_value(line))
        except (ValueError, KeyError, TypeError, zlib.error):
            break
        found[key] = entry
        good += len(line) + 1
    return found, good


LONGEST = 100_000_000
"""bytes of commands of one scenario"""


def _entry(value: Mapping[str, Any]) -> tuple[Key, Found]:
    packed = zlib.decompressobj().decompress(base64.b85decode(value["commands"]), LONGEST)
    commands = np.frombuffer(packed, dtype=np.int8).reshape(-1, int(value["actuators"]))
    key = (str(value["condition"]), int(value["pass"]), int(value["episode"]))
    return key, Found(
        len(commands), commands, str(value["start"]), int(value["solved"]), int(value["failed"])
    )
