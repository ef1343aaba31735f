"""SIGKILL at random instants: the runs of three learners end with the same bits.

`make soak` kills all learners, and each of them more often.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


CASES = ["ppo-8", "sac-1", "recurrent_ppo-8"]
"""on-policy, off-policy, recurrent"""
KILLS = 7


@pytest.mark.slow
def test_twenty_kills_do_not_change_a_bit(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "tests.soak.campaign", "--kills", str(KILLS), "--folder", str(tmp_path)]
    done = subprocess.run(
        [*command, "--cases", *CASES],
        cwd=ROOT,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    tallies = [json.loads(line) for line in done.stdout.splitlines()]
    assert [tally["case"] for tally in tallies] == CASES, done.stderr
    assert {tally["case"]: tally["differences"] for tally in tallies} == {case: [] for case in CASES}
    assert sum(tally["kills"] for tally in tallies) >= 20
    assert sum(tally["resumed"] for tally in tallies) >= 5
    assert done.returncode == 0, done.stderr
