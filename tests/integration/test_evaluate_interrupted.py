"""Ctrl-C in `auvbench evaluate`, as a terminal sends it: to every process of the command."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from auvbench.cli import main


@pytest.fixture
def runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Path:
    monkeypatch.chdir(tmp_path)
    assert main(["train", "-m", "algo=pid", "seed=range(0,8)"]) == 0
    capsys.readouterr()
    return tmp_path / "outputs"


@pytest.mark.parametrize("seconds", [1.5, 12.0])
def test_it_says_what_is_kept_and_ends_at_once(runs: Path, seconds: float) -> None:
    command = [sys.executable, "-m", "auvbench", "evaluate", "outputs", "protocol=robustness", "workers=2"]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True
    )
    time.sleep(seconds)
    os.killpg(process.pid, signal.SIGINT)
    begun = time.monotonic()
    code = process.wait(timeout=30)
    took = time.monotonic() - begun
    said = process.communicate()[0]
    # A shell says 130 of either. Python dies of the signal itself where it came in the midst of an exec(), of which
    # imports are full (dataclasses), even if somebody has dealt with the exception since.
    assert code in (130, -signal.SIGINT), said
    assert took < 5.0, "2 s on a machine that is not busy with other tests"
    assert "Traceback" not in said
    assert "interrupted" in said.splitlines()[-1]
    whole = list(runs.glob("*/*/evaluations/robustness/summary.json"))
    assert len(list(runs.glob("*/*/evaluations/robustness"))) == len(whole)
    told = re.search(r"(\d+) of 8 runs tested and kept", said.splitlines()[-1])
    if told is not None:  # else it had not yet looked at them
        # A worker may have put its last result in place between our last look and its end.
        assert int(told[1]) <= len(whole) <= int(told[1]) + 2
