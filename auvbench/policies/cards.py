"""The card of a policy's file: JSON beside the ONNX file that says what its numbers mean.

Cards may come from anybody: they are bounded and looked at before anything is believed. What one holds is in
docs/policies-as-files.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from auvbench.errors import RunError
from auvbench.untrusted import documents, reading
from auvbench.untrusted.text import plain, short

FORMAT = "auvbench-policy"
SCHEMA_VERSION = 1
"""of the card"""

LONGEST_NAME = 200
"""characters of a name on a card"""

MOST = 1000
"""observations or actions"""


class PolicyError(RunError):
    """A policy's file or card cannot be used, or the policy answers what is no action."""


@dataclass(frozen=True, slots=True, eq=False)
class Card:
    """What is known of a policy beside its network."""

    name: str
    vehicle: str
    frequency: float
    """Hz of its actions"""
    position_frame: str
    """world | body: of the position error that it observes"""
    observation: tuple[str, ...]
    """names of what it observes, in order"""
    action: tuple[str, ...]
    """names of the actuators, in order"""
    sha256: str
    """of the ONNX file"""
    document: Mapping[str, Any]
    """the whole of it"""


def card_path(path: Path | str) -> Path:
    """Where the card of an ONNX file lies: under the same stem.

    >>> card_path("policies/ppo.onnx").name
    'ppo.json'
    """
    return Path(path).with_suffix(".json")


def read_card(path: Path | str) -> Card:
    """A card by itself.

    Raises:
        PolicyError: it is missing, or no card.
    """
    card = parse_card(content(Path(path), reading.DOCUMENT), str(path))
    if card is None:
        raise PolicyError(f'{path}: is no card of a policy ("format" is not "{FORMAT}")')
    return card


def parse_card(data: bytes, where: str) -> Card | None:
    """A card from its bytes; None where the JSON is of something else.

    Raises:
        PolicyError: it is no JSON, of another schema version, or an entry is missing or impossible.
    """
    try:
        document = documents.json_value(data)
    except ValueError as error:
        raise PolicyError(f"{where}: is no JSON: {short(error)}") from error
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        return None
    version = document.get("schema_version")
    if version != SCHEMA_VERSION:
        raise PolicyError(
            f"{where}: schema_version {short(version, 40)}, but this auvbench reads {SCHEMA_VERSION}"
        )
    return Card(
        name=_name(document, where, "name"),
        vehicle=_name(document, where, "vehicle", "name"),
        frequency=_frequency(document, where),
        position_frame=_frame(document, where),
        observation=_names(document, where, "observation"),
        action=_names(document, where, "action"),
        sha256=_name(document, where, "file", "sha256"),
        document=document,
    )


def content(path: Path, limit: int) -> bytes:
    """A file's bytes, at most `limit` of them.

    Raises:
        PolicyError: it cannot be read.
    """
    try:
        return reading.content(path, limit)
    except (OSError, ValueError) as error:
        raise PolicyError(f"{path}: {unread(error)}") from error


def unread(error: OSError | ValueError) -> str:
    """Why a file's bytes are not there, in words."""
    if isinstance(error, FileNotFoundError):
        return "no such file"
    return f"cannot be read: {getattr(error, 'strerror', None) or error}"


def _entry(document: Mapping[str, Any], where: str, *keys: str) -> Any:
    node: Any = document
    for key in keys:
        if not isinstance(node, Mapping) or key not in node:
            raise PolicyError(f"{where}: {'.'.join(keys)} is missing")
        node = node[key]
    return node


def _name(document: Mapping[str, Any], where: str, *keys: str) -> str:
    value = _entry(document, where, *keys)
    if not is_name(value):
        raise PolicyError(f"{where}: {'.'.join(keys)} is {short(repr(value), 40)}, which is no name")
    return str(value)


def is_name(value: Any) -> bool:
    """Whether it is a text of one line that can be shown."""
    return isinstance(value, str) and 0 < len(value) <= LONGEST_NAME and plain(value) == value


def _frequency(document: Mapping[str, Any], where: str) -> float:
    value = _entry(document, where, "frequency_hz")
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value <= 1000:
        raise PolicyError(
            f"{where}: frequency_hz is {short(repr(value), 40)}; must be above 0 and at most 1000"
        )
    return float(value)


def _frame(document: Mapping[str, Any], where: str) -> str:
    value = _entry(document, where, "task", "position_frame")
    if value not in ("world", "body"):
        raise PolicyError(f"{where}: task.position_frame is {short(repr(value), 40)}; valid: body, world")
    return str(value)


def _names(document: Mapping[str, Any], where: str, key: str) -> tuple[str, ...]:
    items = _entry(document, where, key)
    if not isinstance(items, list) or not 0 < len(items) <= MOST:
        raise PolicyError(f"{where}: {key} is no list of what the network takes or gives")
    return tuple(
        _name({"entry": item}, f"{where}: {key}[{i}]", "entry", "name") for i, item in enumerate(items)
    )
