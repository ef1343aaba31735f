"""SIGKILL at random instants, at least 20 per family of algorithms: the runs end with the same bits.

`make soak` does the same for longer.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cases", "kills"),
    [
        (["ppo-1", "ppo-8"], 10),
        (["sac-1", "sac-8", "ddpg-1", "ddpg-8", "td3-1", "td3-8"], 4),
        (["tqc-8", "crossq-8", "trpo-8", "recurrent_ppo-8", "ppo_residual-8", "sac_residual-8"], 4),
    ],
    ids=["on-policy", "off-policy", "further"],
)
def test_twenty_kills_do_not_change_a_bit(cases: list[str], kills: int, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "tests.soak.campaign", "--kills", str(kills), "--folder", str(tmp_path)]
    done = subprocess.run(
        [*command, "--cases", *cases],
        cwd=ROOT,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    tallies = [json.loads(line) for line in done.stdout.splitlines()]
    assert [tally["case"] for tally in tallies] == cases, done.stderr
    assert {tally["case"]: tally["differences"] for tally in tallies} == {case: [] for case in cases}
    assert sum(tally["kills"] for tally in tallies) >= 20
    assert sum(tally["resumed"] for tally in tallies) >= 5
    assert done.returncode == 0, done.stderr
