"""JSON and YAML without an end, and files that are none."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from auvbench.untrusted import reading
from tests.waiting import LIMIT

LAUGHS = "a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]\n" for n in range(1, 12)
)


DASHES = "- " * 100_000
DEEP = {
    "brackets": b"[" * 100_000,
    "closed": b"a: " + b"[" * 100_000 + b"]" * 100_000,
    "dashes": b"- " * 100_000 + b"x",
    "braces": b"{a: " * 100_000,
    "indented": b"\n".join(b" " * n + b"a:" for n in range(1500)),
    "questions": b"? " * 100_000,
    "after CR": b"x:\r" + DASHES.encode(),
    "after NEL": f"x:\x85{DASHES}".encode(),
    "after U+2028": f"x:\u2028{DASHES}".encode(),
    "UTF-16": f"x:\n{DASHES}".encode("utf-16"),
    "BOM": b"\xef\xbb\xbf" + DASHES.encode(),
    "BOM and CR": b"\xef\xbb\xbfx:\r" + DASHES.encode(),
}


@pytest.mark.parametrize("data", DEEP.values(), ids=DEEP)
def test_deep_yaml_is_refused(data: bytes) -> None:
    # In a process of its own: PyYAML's C loader would end this one.
    code = "from auvbench.untrusted import reading as d\ntry: d.yaml_value(open(0,'rb').read())\nexcept ValueError as e: print(e)"
    done = subprocess.run(
        [sys.executable, "-c", code], input=data, capture_output=True, timeout=LIMIT, check=True
    )
    assert b"nested" in done.stdout


@pytest.mark.parametrize("data", [b"[" * 100_000, b'{"a":' * 100_000, b"[" * 500 + b"]" * 500])
def test_deep_json_is_refused(data: bytes) -> None:
    with pytest.raises(ValueError, match="nested"):
        reading.json_value(data)


@pytest.mark.parametrize("data", [b'{"a": NaN}', b"[-Infinity]", b"[1e999]", b"[36893488147419103232]"])
def test_numbers_that_are_none(data: bytes) -> None:
    with pytest.raises(ValueError, match=r"not JSON|too large"):
        reading.json_value(data)


def test_aliases_that_stand_for_billions_are_refused() -> None:
    with pytest.raises(ValueError, match="is inside"):
        reading.yaml_value(LAUGHS.encode())


def test_an_alias_below_an_anchor_is_refused() -> None:
    """It may stand for itself, or for billions of values."""
    for data in (b"a: &x {b: *x}", b"a: &x [1]\nb: &y [[*x], 2]"):
        with pytest.raises(ValueError, match="is inside"):
            reading.yaml_value(data)


def test_aliases_of_a_long_list_are_counted() -> None:
    data = b"a: &x [" + b"1, " * 5000 + b"]\n" + b"".join(b"k%d: *x\n" % n for n in range(200))
    with pytest.raises(ValueError, match="stand for more"):
        reading.yaml_value(data)


@pytest.mark.parametrize("tag", [b"!!bool maybe", b"!!timestamp x", b"!!python/object:os.system x", b"!x 1"])
def test_a_tag_is_refused(tag: bytes) -> None:
    with pytest.raises(ValueError, match="tag"):
        reading.yaml_value(b"a: " + tag)


def test_a_few_aliases_are_fine() -> None:
    assert reading.yaml_value(b"a: &x [1, 2]\nb: *x") == {"a": [1, 2], "b": [1, 2]}


@pytest.mark.parametrize(
    "data", [b"a: [1, {b: c}]", b"a:\n- 1\n- - 2\n  - b: null\n", b"x: '*'", b"\"a\": 'b'", b""]
)
def test_what_is_right_is_what_the_safe_loader_says(data: bytes) -> None:
    assert reading.yaml_value(data) == yaml.safe_load(data)


def test_a_pipe_a_folder_and_a_device_are_no_files(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    for path, kind in ((pipe, "a pipe"), (Path("/dev/zero"), "or a device")):
        with pytest.raises(ValueError, match=kind):
            reading.content(path)
    with pytest.raises(IsADirectoryError):
        reading.content(tmp_path)


def test_a_file_of_any_length_is_not_read(tmp_path: Path) -> None:
    long = tmp_path / "long"
    with long.open("wb") as file:
        file.truncate(1 << 40)  # a hole
    with pytest.raises(ValueError, match="more than 16 MiB"):
        reading.content(long)
