"""A disk that fails at the n-th write of a report, a replay or an evaluation: one line, and what was there stays."""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from auvbench import cli
from auvbench.cli import guarded
from auvbench.evaluation import evaluate
from auvbench.runs import atomic_io
from tests import configs, synthetic
from tests.unit.runs.test_damage import frozen

KINDS = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO, errno.EACCES)


class Disk:
    """Counts what would reach a disk, and fails from the n-th time on."""

    def __init__(self, fails_at: int, number: int) -> None:
        self.left = fails_at
        self.number = number
        self.failed = False

    def wrap(self, function: Callable[..., Any]) -> Callable[..., Any]:
        def checked(*arguments: Any, **named: Any) -> Any:
            self.left -= 1
            if self.left <= 0:
                self.failed = True
                raise OSError(self.number, os.strerror(self.number))
            return function(*arguments, **named)

        return checked


@pytest.fixture
def failing(monkeypatch: pytest.MonkeyPatch) -> Callable[[int, int], Disk]:
    def install(fails_at: int, number: int) -> Disk:
        disk = Disk(fails_at, number)
        monkeypatch.undo()
        monkeypatch.setattr(tempfile, "mkstemp", disk.wrap(tempfile.mkstemp))
        for name in ("replace", "fsync", "link"):
            monkeypatch.setattr(os, name, disk.wrap(getattr(os, name)))
        monkeypatch.setattr(Path, "mkdir", disk.wrap(Path.mkdir))
        monkeypatch.setattr(atomic_io, "write_durable", disk.wrap(atomic_io.write_durable))
        return disk

    return install


def judge(code: int, error: str, disk: Disk) -> None:
    assert code in ((0, 1, 2) if disk.failed else (0,)), error  # 0: it could be done without
    if code:
        assert all(line.startswith("auvbench: ") for line in error.splitlines())
        assert "defect" not in error
        reasons = (*map(os.strerror, KINDS), "disk", "read-only", "permission")
        assert any(reason in error for reason in reasons)


@pytest.mark.slow
@pytest.mark.parametrize("flags", [["--no-figures"], ["--format", "csv,tex"]])
def test_a_report(
    flags: list[str], failing: Callable[[int, int], Disk], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    experiment = tmp_path / "x"
    synthetic.write_experiment(experiment, algorithms=("pid", "random"), episodes=6)
    for n in range(1, 40):
        disk = failing(n, KINDS[n % len(KINDS)])
        out = [] if n % 2 else ["--out", str(tmp_path / f"out{n}")]
        code = cli.main(["report", str(experiment), *flags, *out])
        judge(code, capsys.readouterr().err, disk)
        if not disk.failed:
            break
    else:
        pytest.fail("forty writes were not enough")
    left = [path.name for path in (experiment / "report").iterdir() if path.name.startswith(".")]
    assert not [name for name in left if name.endswith(".tmp")]


@pytest.mark.slow
def test_an_evaluation_and_a_replay(
    failing: Callable[[int, int], Disk], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = frozen(tmp_path, "algo=random")
    protocol = configs.protocol("protocol.episodes=1")

    def evaluation() -> int:
        # Not by the command, which may test in a process of its own, where nothing would be counted.
        return guarded(lambda: evaluate.evaluate(run, protocol) is None, ["evaluate"])

    for command in (evaluation, lambda: cli.main(["replay", str(run.path)])):
        for n in range(1, 60, 2):
            # A lock that could not be released is that of this process, which lives on, unlike a command's.
            shutil.rmtree(run.path / "evaluations", ignore_errors=True)
            disk = failing(n, KINDS[n % len(KINDS)])
            code = command()
            judge(code, capsys.readouterr().err, disk)
            if not disk.failed:
                break
        else:
            pytest.fail("sixty writes were not enough")


def test_a_folder_that_takes_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A file where a folder should be, which stands root's way too."""
    experiment = tmp_path / "x"
    synthetic.write_experiment(experiment, algorithms=("pid", "random"), episodes=6)
    (experiment / "report").write_text("")
    assert cli.main(["report", str(experiment), "--no-figures"]) in (1, 2)
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "defect" not in error
