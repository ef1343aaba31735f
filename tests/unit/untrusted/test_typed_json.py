"""What a declared type admits, and what the message of a refusal names."""

from __future__ import annotations

import doctest
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest

from auvbench.untrusted import typed_json
from auvbench.untrusted.typed_json import Count, Prose, Range, Share


@dataclass(frozen=True)
class Entry:
    bytes: Count
    sha256: str


@dataclass(frozen=True)
class Whole:
    state: Literal["pending", "complete"]
    files: dict[str, Entry]
    rate: Share | None = None
    command: Prose | None = None
    marks: tuple[Entry, ...] = ()
    rungs: list[Annotated[int, Range(1, 8)]] = field(default_factory=list)
    is_shipped: bool = False
    rest: Any = None


GOOD: dict[str, Any] = {"state": "pending", "files": {"a/b": {"bytes": 3, "sha256": "00"}}}


def test_the_examples_in_the_documentation() -> None:
    assert doctest.testmod(typed_json).failed == 0


def test_what_is_right_comes_back_typed() -> None:
    more = {"rate": 1, "command": "a\nb", "marks": [{"bytes": 0, "sha256": ""}], "rungs": [1, 8], "new": [2]}
    found = typed_json.convert({**GOOD, **more}, Whole)
    assert found == Whole(
        "pending", {"a/b": Entry(3, "00")}, 1, Prose("a\nb"), marks=(Entry(0, ""),), rungs=[1, 8]
    )


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"state": "gone"}, ("state", "'gone'", "pending, complete")),
        ({"state": ["pending"]}, ("state",)),
        ({"files": []}, ("files", "[]")),
        ({"files": {"a": {"bytes": -1, "sha256": "00"}}}, ("files.a.bytes", "-1", ">= 0")),
        ({"files": {"a": {"bytes": True, "sha256": "00"}}}, ("files.a.bytes", "True")),
        ({"files": {"a": {"bytes": 1.5, "sha256": "00"}}}, ("files.a.bytes", "1.5")),
        ({"files": {"a": {"bytes": 1}}}, ("files.a.sha256", "missing")),
        ({"files": {"a\x1b[2J": {"bytes": 1, "sha256": ""}}}, ("files", r"\x1b")),
        ({"files": {"a": {"bytes": 1, "sha256": "a\nb"}}}, ("files.a.sha256", r"\n")),
        ({"rate": 1.01}, ("rate", "[0, 1]")),
        ({"rate": "nan"}, ("rate", "'nan'", "number")),
        ({"rate": 10**400}, ("rate",)),
        ({"rate": {}}, ("rate", "{}")),
        ({"command": 3}, ("command", "text")),
        ({"marks": {"0": 1}}, ("marks", "list")),
        ({"rungs": [1, 9]}, ("rungs[1]", "9", "[1, 8]")),
        ({"is_shipped": 1}, ("is_shipped", "true or false")),
    ],
)
def test_what_is_wrong_is_named(change: dict[str, Any], named: tuple[str, ...]) -> None:
    with pytest.raises(ValueError, match=r".") as caught:
        typed_json.convert({**GOOD, **change}, Whole)
    for part in named:
        assert part in str(caught.value)
    assert str(caught.value).isprintable()


@pytest.mark.parametrize(
    "data", [b"[]", b"", b"[" * 100_000, b'{"state": NaN}', b"\xff\xfe", b'{"state": 1e999}']
)
def test_a_file_that_is_none_is_refused(data: bytes, tmp_path: Path) -> None:
    (tmp_path / "x.json").write_bytes(data)
    with pytest.raises(ValueError, match=r"."):
        typed_json.read(tmp_path / "x.json", Whole)
