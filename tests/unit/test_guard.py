"""What nobody foresaw is one line, whatever the output goes to."""

from __future__ import annotations

import errno
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from auvbench import cli, registry
from auvbench.commands import runs as runs_command
from auvbench.untrusted.text import message
from tests.waiting import LIMIT

FULL = Path("/dev/full")


def auvbench(
    *arguments: str, stdout: int | None = subprocess.PIPE, **environment: str
) -> tuple[int, str, str]:
    done = subprocess.run(
        [sys.executable, "-m", "auvbench", *arguments],
        stdout=stdout,
        stderr=subprocess.PIPE,
        env={**os.environ, **environment},
        timeout=LIMIT,
        check=False,
    )
    return done.returncode, (done.stdout or b"").decode(), done.stderr.decode()


@pytest.mark.skipif(not FULL.exists(), reason="no /dev/full here")
@pytest.mark.parametrize("arguments", [["--help"], ["vehicles"], ["completion", "bash"]])
def test_a_full_device_takes_one_line(arguments: list[str]) -> None:
    with FULL.open("w") as full:
        code, _, error = auvbench(*arguments, stdout=full.fileno())
    assert (code, error.count("\n")) == (1, 1)
    assert "the disk is full" in error


@pytest.mark.skipif(not FULL.exists(), reason="no /dev/full here")
def test_a_message_that_nobody_can_read_changes_no_exit_code() -> None:
    with FULL.open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "auvbench", "frobnicate"],
            stdout=full,
            stderr=full,
            timeout=LIMIT,
            check=False,
        )
    assert done.returncode == 2


@pytest.mark.slow
def test_letters_that_the_terminal_lacks_are_no_error() -> None:
    code, output, error = auvbench("vehicles", "bluerov2", PYTHONIOENCODING="ascii")
    assert (code, error) == (0, "")
    assert "BlueROV2" in output


def test_a_sheet_is_the_same_bytes_whatever_the_terminal_speaks() -> None:
    plain = auvbench("vehicles", "bluerov2", "--sheet")
    assert auvbench("vehicles", "bluerov2", "--sheet", PYTHONIOENCODING="ascii") == plain
    assert plain[0] == 0


@pytest.mark.parametrize("command", ["train", "simulate", "runs", "vehicles", "report", "evaluate"])
def test_every_command_tells_the_version(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main([command, "--version"]) == 0
    assert capsys.readouterr().out.startswith("auvbench ")


def test_a_defect_is_saved_and_named(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def defective(_: object) -> int:
        raise LookupError("the \x1b[31mcat\nis out")

    monkeypatch.setattr(runs_command, "main", defective)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    assert cli.main(["runs", "a path"]) == 70
    error = capsys.readouterr().err
    (saved,) = (tmp_path / "auvbench").iterdir()
    assert error.count("\n") == 1
    assert "\x1b" not in error
    assert str(saved) in error
    text = saved.read_text()
    assert "command: auvbench runs 'a path'" in text
    assert "Traceback" in text
    assert "python: " in text


def test_a_defect_that_no_folder_takes_is_still_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def defective(_: object) -> int:
        raise LookupError

    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(runs_command, "main", defective)
    monkeypatch.setattr(Path, "mkdir", full)
    assert cli.main(["runs"]) == 70
    assert "no details could be saved" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("raised", "code", "said"),
    [
        (OSError(errno.ENOSPC, "No space left on device"), 1, "the disk is full"),
        (OSError(errno.EROFS, "Read-only file system", "x"), 1, "read-only"),
        (OSError(errno.ENAMETOOLONG, "File name too long", "x" * 999), 2, "File name too long"),
        (MemoryError(), 1, "out of memory"),
    ],
)
def test_what_the_machine_lacks_is_one_line(
    raised: Exception,
    code: int,
    said: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def failing(_: object) -> int:
        raise raised

    monkeypatch.setattr(runs_command, "main", failing)
    assert cli.main(["runs"]) == code
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert said in error
    assert len(error) < 400


@pytest.mark.parametrize(
    "arguments",
    [
        ["resume", "--frobnicate", "x"],
        ["resume", "x", "--workers", "many"],
        ["replay"],
        ["replay", "x", "--episode", "one"],
        ["vehicles", "--jsn"],
        ["vehicles", "a", "b"],
        ["runs", "--jso"],
        ["report"],
    ],
)
def test_a_wrong_flag_is_one_line(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(arguments) == 2
    captured = capsys.readouterr()
    assert (captured.out, captured.err.count("\n")) == ("", 1)
    assert captured.err.startswith("auvbench: ")


def test_a_long_value_is_cut_and_the_hint_after_it_is_kept() -> None:
    line = message(f"{'x' * 9000}: no such key; did you mean 'reward.k'?")
    assert len(line) < 300
    assert line.endswith("did you mean 'reward.k'?")


CLOSED = """
import os, sys
for number in {closed}:
    os.close(number)
os.execv(sys.executable, [sys.executable, "-m", "auvbench", *sys.argv[1:]])
"""


def closed(numbers: tuple[int, ...], *arguments: str) -> subprocess.CompletedProcess[bytes]:
    """Run auvbench as a shell with `>&-` does."""
    return subprocess.run(
        [sys.executable, "-c", CLOSED.format(closed=numbers), *arguments],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        timeout=LIMIT,
        check=False,
    )


@pytest.mark.slow
@pytest.mark.parametrize("numbers", [(1,), (2,), (0, 1, 2)])
def test_closed_streams_change_no_run(numbers: tuple[int, ...], tmp_path: Path) -> None:
    grid = ["train", "-m", "algo=random", "seed=0,1", f"output={tmp_path}"]
    done = closed(numbers, *grid)
    assert (done.returncode, b"Traceback" in done.stdout + done.stderr) == (0, False)
    manifests = list(tmp_path.glob("*/*/manifest.json"))
    assert [json.loads(path.read_text())["state"] for path in manifests] == ["complete"] * 2


def test_a_mistake_has_its_exit_code_without_streams() -> None:
    assert closed((1, 2), "frobnicate").returncode == 2


@pytest.mark.slow
@pytest.mark.parametrize("arguments", [["train", "--help"], ["train", "--cfg", "job"]])
def test_a_reader_that_leaves_is_no_error(arguments: list[str]) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    code, _, error = auvbench(*arguments, stdout=writing, PYTHONUNBUFFERED="1")
    os.close(writing)
    assert (code, error) == (0, "")


def test_a_removed_working_directory_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "gone"
    folder.mkdir()
    monkeypatch.chdir(folder)
    folder.rmdir()
    for command in (["runs"], ["train"], ["vehicles"]):
        assert cli.main(command) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1
        assert "the working directory is gone" in error
    assert cli.main(["--help"]) == 0


@pytest.mark.parametrize(
    "arguments",
    [
        ["train", "seed={}"],
        ["train", "-m", "seed=1,{}"],
        ["tune", "algo.gamma=range(0,{})"],
        ["evaluate", "x", "--workers", "{}"],
        ["replay", "x", "--episode", "{}"],
        ["train", "experiment=big"],
    ],
)
def test_a_number_without_end_is_one_line(
    arguments: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    digits = "9" * 5000
    preset = tmp_path / "conf" / "experiment" / "big.yaml"
    preset.parent.mkdir(parents=True)
    preset.write_text(f"# @package _global_\nseed: {digits}\n")
    assert cli.main([word.format(digits) for word in arguments]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "set_int_max_str_digits" not in error
    assert "number" in error


def test_the_error_of_a_package_names_its_traceback(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def foreign(_: object) -> int:
        with registry.telling("algo=theirs of theirs==1", "act fails"):
            raise LookupError("no such thruster")

    monkeypatch.setattr(runs_command, "main", foreign)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    assert cli.main(["runs"]) == 1
    error = capsys.readouterr().err
    (saved,) = (tmp_path / "auvbench").iterdir()
    assert error.endswith(f"no such thruster; traceback: {saved}\n")
    assert "in foreign" in saved.read_text()
