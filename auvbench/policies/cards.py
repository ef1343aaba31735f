"""The card of a policy's file: JSON next to the ONNX file that says what its numbers mean (docs/policies-as-files.md)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from auvbench.errors import RunError
from auvbench.untrusted import reading, typed_json
from auvbench.untrusted.text import short

FORMAT = "auvbench-policy"
SCHEMA_VERSION = 1
"""of the card"""

LARGEST = 1 << 20
"""bytes of a card"""

MOST = 1000
"""observations or actions"""


class PolicyError(RunError):
    """A policy's file or card cannot be used, or the policy answers what is no action."""


@dataclass(frozen=True, slots=True)
class Named:
    """A vehicle, an observed number or an actuator."""

    name: str


@dataclass(frozen=True, slots=True)
class _File:
    sha256: str


@dataclass(frozen=True, slots=True)
class _Task:
    position_frame: Literal["world", "body"]
    """of the position error that the policy observes"""


@dataclass(frozen=True, slots=True, eq=False)
class Card:
    """The entries of a card that are read."""

    name: str
    vehicle: Named
    frequency_hz: Annotated[float, typed_json.Range(1e-3, 1000)]
    task: _Task
    observation: tuple[Named, ...]
    action: tuple[Named, ...]
    file: _File
    document: dict[str, Any] = field(default_factory=dict)
    """the whole card"""

    @property
    def observed(self) -> tuple[str, ...]:
        """Names of the observed numbers, in their order."""
        return tuple(item.name for item in self.observation)

    @property
    def actuators(self) -> tuple[str, ...]:
        """Names of the actuators, in their order."""
        return tuple(item.name for item in self.action)


def card_path(path: Path | str) -> Path:
    """Return where the card of an ONNX file lies: under the same stem.

    >>> card_path("policies/ppo.onnx").name
    'ppo.json'
    """
    return Path(path).with_suffix(".json")


def read_card(path: Path | str) -> Card:
    """Read a card by itself.

    Raises:
        PolicyError: it is missing, or no card.
    """
    card = parse_card(content(Path(path), LARGEST), str(path))
    if card is None:
        raise PolicyError(f'{path}: is no card of a policy ("format" is not "{FORMAT}")')
    return card


def parse_card(data: bytes, where: str) -> Card | None:
    """Return the card in some bytes; None if the JSON is of something else.

    Raises:
        PolicyError: it is no JSON, of another schema version, or an entry is missing or impossible.
    """
    try:
        document = reading.json_value(data)
    except ValueError as error:
        raise PolicyError(f"{where}: is no JSON: {short(error)}") from error
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        return None
    version = document.get("schema_version")
    if version != SCHEMA_VERSION:
        raise PolicyError(
            f"{where}: schema_version {short(version, 40)}, but this auvbench reads {SCHEMA_VERSION}"
        )
    try:
        found = replace(typed_json.convert(document, Card), document=document)
    except ValueError as error:
        raise PolicyError(f"{where}: {error}") from error
    for key, items in (("observation", found.observation), ("action", found.action)):
        if not 0 < len(items) <= MOST:
            raise PolicyError(f"{where}: {key} has {len(items)} entries, must have 1 to {MOST}")
    return found


def content(path: Path, limit: int) -> bytes:
    """Return a file's bytes, at most `limit` of them.

    Raises:
        PolicyError: it cannot be read.
    """
    try:
        return reading.content(path, limit)
    except FileNotFoundError as error:
        raise PolicyError(f"{path}: no such file") from error
    except (OSError, ValueError) as error:
        raise PolicyError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from error
