"""Read JSON of a declared type: manifests, summaries and journal lines that another person may have written.

    @dataclass(frozen=True, slots=True)
    class Mark:
        length: Count
        sha256: str

    mark = typed_json.read(path, Mark)

Types are dataclasses, `str`, `int`, `float`, `bool`, `Literal`, `T | None`, `list[T]`, `tuple[T, ...]`,
`dict[str, T]` and `Any`. A `str` is one line of printable text; `Prose` may have several lines. Unknown
entries are ignored, so that an older auvbench can read the files of a newer one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import cache
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, NewType, TypeVar, Union, get_args, get_origin, get_type_hints

from auvbench.untrusted import reading
from auvbench.untrusted.reading import json_value
from auvbench.untrusted.text import LONGEST, short

T = TypeVar("T")

LINE = 10_000
"""largest number of characters of a `str`; a command line has some hundred"""
PROSE = 1_000_000
"""largest number of characters of a `Prose`"""

Prose = NewType("Prose", str)


@dataclass(frozen=True, slots=True)
class Range:
    """Inclusive limits of a number, or of the length of a text."""

    low: float
    high: float = math.inf

    def __str__(self) -> str:
        return f"in [{self.low:g}, {self.high:g}]" if self.high < math.inf else f">= {self.low:g}"


Name = Annotated[str, Range(1, LONGEST)]
Count = Annotated[int, Range(0)]
Share = Annotated[float, Range(0, 1)]
Seconds = Annotated[float, Range(0, 1e12)]


def read(path: Path | str, schema: type[T], limit: int = reading.DOCUMENT) -> T:
    """Return the content of a JSON file as `schema`.

    Raises:
        OSError: the file is missing or cannot be read.
        ValueError: the file is not a regular file, too long or not JSON, or an entry has a wrong type.
    """
    return convert(json_value(reading.content(path, limit)), schema)


def convert(value: object, schema: type[T]) -> T:
    """Convert a value of plain dictionaries and lists to `schema`.

    Raises:
        ValueError: an entry is wrong; the message names the entry, its value and the valid values.

    >>> convert({"a": [0, 1]}, dict[str, list[Count]])
    {'a': [0, 1]}
    >>> convert({"a": [0, -1]}, dict[str, list[Count]])
    Traceback (most recent call last):
    ValueError: a[1] is -1, must be a whole number >= 0
    """
    converted: T = _convert(schema, value, "")
    return converted


def _convert(kind: Any, value: Any, where: str) -> Any:
    origin, arguments = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType) and NoneType in arguments:
        (option,) = (argument for argument in arguments if argument is not NoneType)
        return None if value is None else _convert(option, value, where)
    if origin is Annotated:
        converted = _convert(arguments[0], value, where)
        size = len(converted) if isinstance(converted, str) else converted
        if not arguments[1].low <= size <= arguments[1].high:
            raise _wrong(kind, value, where)
        return converted
    if not _fits(kind, origin, arguments, value):
        raise _wrong(kind, value, where)
    if is_dataclass(kind):
        return _object(kind, value, where)
    if origin is dict:
        entries = {_convert(str, key, f"the name of {where}"): item for key, item in value.items()}
        return {key: _convert(arguments[1], item, _join(where, key)) for key, item in entries.items()}
    if origin in (list, tuple):
        return origin(_convert(arguments[0], item, f"{where}[{n}]") for n, item in enumerate(value))
    return value


def _fits(kind: Any, origin: Any, arguments: tuple[Any, ...], value: Any) -> bool:
    """Return whether a value has the type `kind`, without checking the entries of a list or an object."""
    if kind is Any:
        return True
    if kind is str:
        return isinstance(value, str) and len(value) <= LINE and value.isprintable()
    if kind is Prose:
        return isinstance(value, str) and len(value) <= PROSE
    if kind is float:
        return type(value) in (int, float) and -math.inf < value < math.inf
    if kind in (int, bool):
        return type(value) is kind
    if origin is Literal:
        return isinstance(value, str) and value in arguments
    return isinstance(value, list if origin in (list, tuple) else dict)


def _object(kind: Any, value: Mapping[str, Any], where: str) -> Any:
    entries = {}
    for name, hint, is_required in _entries(kind):
        if name in value:
            entries[name] = _convert(hint, value[name], _join(where, name))
        elif is_required:
            raise ValueError(f"{_join(where, name)} is missing")
    return kind(**entries)


@cache
def _entries(kind: Any) -> list[tuple[str, Any, bool]]:
    """Return the name and type of each entry of a dataclass, and whether the entry is required."""
    hints = get_type_hints(kind, include_extras=True)
    return [
        (field.name, hints[field.name], field.default is MISSING and field.default_factory is MISSING)
        for field in fields(kind)
    ]


def _join(where: str, name: str) -> str:
    return f"{where}.{short(name, 60)}" if where else short(name, 60)


def _wrong(kind: Any, value: object, where: str) -> ValueError:
    return ValueError(f"{where or 'it'} is {short(repr(value), 40)}, must be {_name(kind)}")


def _name(kind: Any) -> str:
    """Return the description of a valid value, for a message."""
    arguments = get_args(kind)
    if get_origin(kind) is Annotated:
        what = "one printable line of a length" if arguments[0] is str else _name(arguments[0])
        return f"{what} {arguments[1]}"
    if get_origin(kind) is Literal:
        return f"one of {', '.join(map(str, arguments))}"
    names = {str: f"one printable line of at most {LINE:,} characters", Prose: "text", int: "a whole number"}
    names |= {float: "a finite number", bool: "true or false"}
    return names.get(kind, "a list" if get_origin(kind) in (list, tuple) else "an object")
