"""The journal: a kill loses no operation, an edited, removed or moved line is found, and no link is followed."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from auvbench.errors import RunError
from auvbench.runs import lock
from auvbench.tuning.folder import CONTROLLER, Journal


def written(path: Path, count: int = 6) -> list[dict[str, object]]:
    """Write a journal of `count` operations; return them."""
    logs = [{"op_code": 8, "trial_id": i, "user_attr": {"result 10": [0.1 * i, None]}} for i in range(count)]
    journal = Journal(path)
    for log in logs:
        journal.append_logs([log])
    return logs


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    path = tmp_path / "journal.log"
    logs = written(path)
    assert Journal(path).read_logs(0) == logs
    assert Journal(path).read_logs(4) == logs[4:]


@pytest.mark.slow
def test_a_kill_after_any_byte_loses_no_whole_line(tmp_path: Path) -> None:
    path = tmp_path / "journal.log"
    logs = written(path)
    data = path.read_bytes()
    for cut in range(len(data) + 1):
        path.write_bytes(data[:cut])
        whole = data[:cut].count(b"\n")
        assert Journal(path).read_logs(0) == logs[:whole]
        assert path.stat().st_size == cut
        Journal(path).append_logs([logs[0]])
        assert Journal(path).read_logs(0) == [*logs[:whole], logs[0]]


def test_an_incomplete_line_goes_nowhere_else(tmp_path: Path) -> None:
    """A stranger's study: the incomplete line is shell code, and the file that used to keep it a link."""
    profile = tmp_path / "profile"
    profile.write_text("export A=1\n")
    study = tmp_path / "study"
    study.mkdir()
    logs = written(study / "journal.log")
    with open(study / "journal.log", "ab") as file:
        file.write(b"touch /tmp/owned #")
    (study / "journal.log.torn").symlink_to(profile)
    assert Journal(study / "journal.log").read_logs(0) == logs
    assert profile.read_text() == "export A=1\n"


@pytest.mark.parametrize("exists", [True, False])
def test_a_journal_that_is_a_link_is_refused_and_not_written(tmp_path: Path, exists: bool) -> None:
    target, path = tmp_path / "target", tmp_path / "journal.log"
    if exists:
        target.write_bytes(b"")
    path.symlink_to(target)
    with pytest.raises(RunError, match="symbolic link"):
        Journal(path)
    path.unlink()
    journal = Journal(path)
    path.symlink_to(target)  # after the check
    with pytest.raises(Exception, match=r"journal\.log"):
        journal.append_logs([{"op_code": 0}])
    assert not target.exists() or target.read_bytes() == b""


def edited(lines: list[bytes]) -> list[bytes]:
    log = json.loads(lines[2])
    log["user_attr"]["result 10"][0] = 0.9
    return [*lines[:2], json.dumps(log, separators=(",", ":")).encode(), *lines[3:]]


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (edited, 3),
        (lambda lines: lines[:2] + lines[3:], 3),
        (lambda lines: [lines[1], lines[0], *lines[2:]], 1),
        (lambda lines: lines[:4] + lines[3:], 5),
        (lambda lines: [*lines[:1], b"not JSON", *lines[2:]], 2),
        (lambda lines: [*lines[:1], b"[1]", *lines[2:]], 2),
        (lambda lines: [*lines[:1], b"\xff\xfe", *lines[2:]], 2),
        (lambda lines: [*lines[:1], b"[" * 100_000, *lines[2:]], 2),
    ],
)
def test_a_changed_line_is_named_and_nothing_is_touched(tmp_path: Path, change, line: int) -> None:
    path = tmp_path / "journal.log"
    written(path)
    path.write_bytes(b"\n".join([*change(path.read_bytes().splitlines()), b""]))
    before = path.read_bytes()
    with pytest.raises(RunError, match=f"line {line} is damaged") as caught:
        Journal(path)
    assert "\n" not in str(caught.value)
    assert path.read_bytes() == before


def test_a_process_that_lost_the_study_writes_no_more(tmp_path: Path) -> None:
    path = tmp_path / "journal.log"
    logs = written(path)
    journal = Journal(path)
    place = tmp_path / CONTROLLER
    place.mkdir()
    with lock.acquire(place):
        (place / lock.FOLDER / lock.HOLDER).unlink()
        before = path.read_bytes()
        with pytest.raises(lock.LockLostError):
            journal.append_logs(logs)
        assert path.read_bytes() == before


def test_a_pipe_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "journal.log")
    with pytest.raises(RunError, match="pipe"):
        Journal(tmp_path / "journal.log")
