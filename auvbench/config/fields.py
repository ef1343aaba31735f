"""Define the fields of schemas (a field has a type and a valid range, but no default), and refuse contradicting values."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import field, is_dataclass
from typing import Any, get_args, get_type_hints

from auvbench.errors import ConfigError

INF = math.inf


def number(low: float = -INF, high: float = INF, *, open_low: bool = False) -> Any:
    """Return a field with the valid range [low, high], or (low, high] with `open_low`.

    Infinities and NaN are never valid.
    """
    return field(metadata={"low": low, "high": high, "open_low": open_low})


def choice(*names: str) -> Any:
    """Return a field that takes one of a few names."""
    return choice_of(lambda: names)


def choice_of(names: Callable[[], Collection[str]]) -> Any:
    """Return a field that takes a name of a registry; the registry is read when a value is checked."""
    return field(metadata={"choices": names})


def later(declared: Any, default: Any = None) -> Any:
    """Return a field that runs of earlier versions lack. These runs get the value `default`, which must not change their results."""
    return field(default=default, metadata=declared.metadata)


def name() -> Any:
    """Return a field for a name that is part of a path: letters, digits and . _ + -, beginning with a letter or digit."""
    return field(metadata={"name": True})


def show(value: Any) -> str:
    """Return a value in the form that messages show."""
    return f"{value:.12g}" if isinstance(value, float) else str(value)


def require(holds: bool, key: str, value: Any, what: str) -> None:
    """Raise ConfigError, `key=value: must ...`, unless `holds` is true."""
    if not holds:
        raise ConfigError(f"{key}={show(value)}: must {what}")


def below(low_key: str, low: float, high_key: str, high: float | None, *, strictly: bool = False) -> None:
    """Raise ConfigError unless `low` <= `high`, or `low` < `high` with `strictly`; `high=None` means no upper limit."""
    if high is None or (low < high if strictly else low <= high):
        return
    raise ConfigError(
        f"{low_key}={low:.12g}: must be {'below' if strictly else 'at most'} {high_key}={high:g}"
    )


def keys(kind: type, prefix: str = "") -> dict[str, Any]:
    """Return the dotted keys of a schema and of its nested schemas, with their types."""
    types = {}
    for key, hint in get_type_hints(kind).items():
        types[f"{prefix}{key}"] = hint
        for kind in (hint, *get_args(hint)):  # A nested schema may be null.
            if isinstance(kind, type) and is_dataclass(kind):
                types |= keys(kind, f"{prefix}{key}.")
    return types
