"""Ctrl-C in `auvbench evaluate`, as a terminal sends it: to every process of the command."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from auvbench.cli import main
from tests.waiting import LIMIT, until


@pytest.fixture
def runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Path:
    monkeypatch.chdir(tmp_path)
    assert main(["train", "-m", "algo=pid", "seed=range(0,8)"]) == 0
    capsys.readouterr()
    return tmp_path / "outputs"


def count_tested(runs: Path) -> int:
    return len(list(runs.glob("*/*/evaluations/robustness/summary.json")))


def importing(process: subprocess.Popen[str]) -> bool:
    """Whether the fork server has started, which imports for seconds."""
    children = psutil.Process(process.pid).children()
    return any("forkserver" in " ".join(child.cmdline()) for child in children)


@pytest.mark.slow
@pytest.mark.parametrize("when", ["workers start", "a run is tested"])
def test_it_says_what_is_kept_and_ends_at_once(runs: Path, when: str) -> None:
    command = [
        sys.executable,
        "-m",
        "auvbench",
        "evaluate",
        "outputs",
        "protocol=robustness",
        "protocol.episodes=5",
        "--workers",
        "2",
    ]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True
    )
    until(lambda: importing(process) if when == "workers start" else count_tested(runs), when)
    os.killpg(process.pid, signal.SIGINT)
    said = process.communicate(timeout=LIMIT)[0]
    assert process.returncode == 130, said
    assert "Traceback" not in said
    kept = re.fullmatch(
        r"auvbench: interrupted: (\d+) of 8 runs are tested and saved.*", said.splitlines()[-1]
    )
    assert kept is not None, said
    # A worker may have put its last result in place between our last look and its end.
    assert int(kept[1]) <= count_tested(runs) <= int(kept[1]) + 2
    assert count_tested(runs) < 8, "it went on to the end"
    assert len(list(runs.glob("*/*/evaluations/robustness"))) == count_tested(runs)
