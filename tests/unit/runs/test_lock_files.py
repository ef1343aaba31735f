"""Files where a lock should be: made by a stranger, or damaged. No command hangs, ends with a traceback or loses a run."""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from auvbench import cli
from auvbench.runs import lock
from tests.unit.runs.test_damage import frozen


def fifo(file: Path) -> None:
    file.unlink()
    os.mkfifo(file)


def link(file: Path) -> None:
    file.unlink()
    file.symlink_to("/dev/zero")


def folder(file: Path) -> None:
    file.unlink()
    file.mkdir()


def superscript(file: Path) -> None:
    file.with_name("²").write_text("{}")


def terminal(file: Path) -> None:
    text = file.read_text()
    if text:
        data = {key: f"\x1b]0;owned\x07\r\n{value}" for key, value in json.loads(text).items()}
        file.write_text(json.dumps(data))


KINDS: dict[str, Callable[[Path], object]] = {
    "fifo": fifo,
    "link": link,
    "folder": folder,
    "superscript": superscript,
    "terminal": terminal,
    "not-utf-8": lambda file: file.write_bytes(b'{"host": "\xff\xfe"}'),
    "nested": lambda file: file.write_text("[" * 100_000),
    "list": lambda file: file.write_text("[]"),
    "empty": lambda file: file.write_text(""),
    "long": lambda file: file.write_text(json.dumps("a" * 10_000_000)),
}


@pytest.fixture(autouse=True)
def alarm() -> Iterator[None]:
    """A command that hangs is ended."""

    def hangs(*_: object) -> None:
        raise AssertionError("the command hangs")

    before = signal.signal(signal.SIGALRM, hangs)
    signal.alarm(100)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.fixture(scope="module")
def template(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("template") / "out"
    frozen(folder, "algo=random", "seed=1", state="running")
    frozen(folder, "algo=random", "seed=2", state="pending")
    return folder


@pytest.fixture(params=["alive", "killed"])
def run(template: Path, tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Path]:
    """One of two runs, whose holder lives or was killed."""
    shutil.copytree(template, tmp_path / "out")
    (run,) = tmp_path.glob("out/*/*-s1-*")
    with lock.acquire(run):
        files = {path: path.read_bytes() for path in run.glob("lock/*")}
        if request.param == "alive":
            yield run
    if request.param == "killed":
        for path, data in files.items():
            path.write_bytes(data)
        yield run


def states(root: Path, capsys: pytest.CaptureFixture[str]) -> list[str]:
    capsys.readouterr()
    code = cli.main(["runs", "--json", str(root / "out")])
    said = capsys.readouterr()
    assert code == 0, said.err
    assert "\x1b" not in said.out + said.err
    for row in json.loads(said.out):
        assert str(row["holder"]).isprintable()
    return [row["state"] for row in json.loads(said.out)]


@pytest.mark.parametrize("kind", KINDS)
def test_a_lock_file_of_another_kind(
    kind: str, run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for file in sorted(run.glob("lock/*")):
        KINDS[kind](file)
    first, second = states(tmp_path, capsys)
    assert first in ("running", "interrupted")
    assert second == "pending"
    assert cli.main(["evaluate", str(tmp_path / "out")]) == 2
    assert "nothing to evaluate" in capsys.readouterr().err


def test_one_flipped_bit(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    chance = random.Random(5)
    (file,) = (file for file in run.glob("lock/*") if file.stat().st_size)
    whole = file.read_bytes()
    for _ in range(40):
        damaged = bytearray(whole)
        damaged[chance.randrange(len(whole))] ^= 1 << chance.randrange(8)
        file.write_bytes(damaged)
        first, second = states(tmp_path, capsys)
        assert first in ("running", "interrupted")
        assert second == "pending"


@pytest.mark.parametrize("run", ["killed"], indirect=True)
def test_a_damaged_file_of_a_dead_holder_is_replaced(run: Path) -> None:
    (run / lock.FOLDER / lock.HOLDER).write_bytes(b"\x00" * 200)
    assert lock.living_holder(run) is None
    with lock.acquire(run) as held:
        assert lock.current(run) == held.holder
