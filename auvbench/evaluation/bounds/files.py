"""Read and write the bounds of a protocol's scenarios, in the package and next to experiments.

    <folder>/<protocol>-<vehicle>/bounds.jsonl   a line per condition and episode
                                 /summary.json   fingerprint, versions, digest of the lines
    <folder>/.<protocol>-<vehicle>/*.json        a file with one line per finished search, until all searches are finished

Each line contains the commands that reach the goal, so that they can be replayed.
"""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from importlib import metadata, resources
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from auvbench.errors import RunError
from auvbench.runs import integrity
from auvbench.untrusted import reading, typed_json
from auvbench.untrusted.text import short
from auvbench.untrusted.typed_json import Count, Name, Prose, Range

Commands = NDArray[np.int16]
"""commands (T, n_u), as multiples of 1/32512 of an actuator's range"""

SCHEMA_VERSION = 3
LINES = "bounds.jsonl"
FOLDER = "bounds"
"""Folder of computed bounds, next to the experiments; `shipped` returns the folder in this package"""
LONGEST = 100_000_000
"""largest size of the commands of one scenario, bytes"""


@dataclass(frozen=True, slots=True)
class Solution:
    """Solution of a search: commands that reach the goal."""

    commands: Commands
    """Commands (steps, n_u) that reach the goal in the simulator"""
    start: str
    """Starting point of the search: name of a controller, or 'straight' for a straight line"""

    @property
    def steps(self) -> int:
        return len(self.commands)


@dataclass(frozen=True, slots=True)
class Bound:
    """Bounds of one scenario: a line of bounds.jsonl."""

    condition: Name
    frequency_hz: Annotated[float, Range(1e-9)]
    episode: Count
    steps: Annotated[int, Range(1)]
    """smallest number of steps that the search found: an upper bound of the optimum"""
    least_steps: Annotated[int, Range(1)]
    """number of steps that every trajectory needs: a lower bound of the optimum"""
    start: Name
    """Starting point of the search, as in `Solution`"""
    commands: Prose
    """commands (steps, n_u), packed as text"""

    def solution(self) -> Solution:
        """Return the solution with the unpacked commands.

        Raises:
            RunError: the commands are damaged.
        """
        try:
            return Solution(_unpacked(self.commands, self.steps), self.start)
        except ValueError as error:
            raise RunError(f"bound of {self.condition}, episode {self.episode}: {short(error)}") from error


@dataclass(frozen=True, slots=True)
class Summary:
    """Content of summary.json in a folder of bounds."""

    protocol: Name
    vehicle: Name
    fingerprint: Name
    fingerprint_parts: dict[str, str]
    """digests of scenarios and outcomes, as in an evaluation's summary"""
    left_out: list[str]
    """one line for each condition without bounds, with the reason"""


@dataclass(frozen=True, slots=True)
class Limits:
    """Bounds of one protocol and vehicle."""

    about: Summary
    bounds: tuple[Bound, ...]

    def conditions(self) -> list[str]:
        return list(dict.fromkeys(bound.condition for bound in self.bounds))

    def condition(self, name: str) -> list[Bound]:
        """Return the bounds of one condition in the order of the episodes; empty if the condition has no bounds."""
        return [bound for bound in self.bounds if bound.condition == name]


def packed(commands: Commands) -> Prose:
    """Return commands (T, n_u) as text."""
    return Prose(base64.b85encode(zlib.compress(commands.astype("<i2").tobytes(), 9)).decode("ascii"))


def _unpacked(text: str, steps: int) -> Commands:
    try:
        data = zlib.decompressobj().decompress(base64.b85decode(text), LONGEST)
    except zlib.error as error:
        raise ValueError(f"commands are damaged ({error})") from error
    return np.frombuffer(data, dtype="<i2").reshape(steps, -1)


def shipped() -> Path:
    """Return the folder of the bounds in the package."""
    return Path(str(resources.files("auvbench.evaluation.bounds"))) / "shipped"


def folder_of(root: Path, protocol: str, vehicle: str) -> Path:
    return root / f"{protocol}-{vehicle}"


def write(folder: Path, limits: Limits) -> None:
    """Write summary and bounds.

    Raises:
        TrainingError: the disk is full, read-only or failing.
    """
    lines = b"".join(line_of(bound) for bound in limits.bounds)
    summary = {
        "schema_version": SCHEMA_VERSION,
        **asdict(limits.about),
        "versions": {name: metadata.version(name) for name in ("auvbench", "casadi", "numpy")},
    }
    integrity.replace_sealed(folder, "summary.json", summary, {LINES: lines})


def read(folder: Path) -> Limits | None:
    """Return the bounds in a folder, checked against their digest; None if the folder is missing.

    Raises:
        RunError: a file is damaged, missing or of a different version.
    """
    try:
        summary = integrity.read_sealed(folder / "summary.json", SCHEMA_VERSION)
        about = typed_json.convert(summary, Summary)
    except (FileNotFoundError, NotADirectoryError):
        return None
    except (OSError, ValueError) as error:
        raise RunError(f"{folder}/summary.json: {short(error)}") from error
    try:
        data = reading.content(folder / LINES)
        if wrong := integrity.difference(summary, LINES, data):
            raise ValueError(wrong)
        bounds = tuple(typed_json.convert(reading.json_value(line), Bound) for line in data.splitlines())
        for bound in bounds:
            if bound.least_steps > bound.steps:
                raise ValueError(f"episode {bound.episode}: the lower bound exceeds the upper one")
    except (OSError, ValueError) as error:
        raise RunError(f"{folder / LINES}: {short(error)}") from error
    return Limits(about, bounds)


def find(
    protocol: str, vehicle: str, fingerprint: str, roots: Sequence[Path]
) -> tuple[Limits | None, list[str]]:
    """Return the bounds of the scenarios of a protocol and vehicle.

    Args:
        protocol: name of the protocol.
        vehicle: name of the vehicle.
        fingerprint: fingerprint of the scenarios and their physics; bounds with another fingerprint are not
            used.
        roots: folders of bounds to search before the folder in the package.

    Returns:
        Bounds or None, and one line for each folder that could not be used.
    """
    refused = []
    for root in dict.fromkeys((*roots, shipped())):
        folder = folder_of(root, protocol, vehicle)
        try:
            limits = read(folder)
        except RunError as error:
            refused.append(str(error))
            continue
        if limits is None:
            continue
        about = limits.about
        if (about.fingerprint, about.protocol, about.vehicle) == (fingerprint, protocol, vehicle):
            return limits, refused
        refused.append(
            f"{folder}: has bounds of other scenarios ({short(about.fingerprint, 20)}, not {fingerprint})"
        )
    return None, refused


def is_name(text: str) -> bool:
    """Return whether the name of a protocol or vehicle is a valid folder name."""
    return bool(text) and Path(text).name == text and not text.startswith(".")


def line_of(bound: Bound) -> bytes:
    """Return a bound as a line of JSON."""
    return json.dumps(asdict(bound)).encode() + b"\n"


def read_finished(path: Path) -> Bound | None:
    """Return the bound in the file of a finished search; None if the file is missing or damaged."""
    try:
        bound = typed_json.convert(reading.json_value(reading.content(path)), Bound)
        bound.solution()
    except (OSError, ValueError, RunError):
        return None
    return bound
