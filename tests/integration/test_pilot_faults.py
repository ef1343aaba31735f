"""A hundred faults of a pilot in flight: no vehicle stays armed or under thrust. `make soak` makes thousands."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests import dds

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
@dds.needs_ros
def test_no_fault_of_a_hundred_leaves_a_vehicle_armed():
    done = subprocess.run(
        [sys.executable, "-m", "tests.soak.pilot", "--trials", "100", "--jobs", "6"],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    counts = json.loads(done.stdout)
    assert not counts["armed"], f"{json.dumps(counts['armed'], indent=1)}\n{done.stderr}"
    assert (counts["trials"], counts["ros2"]) == (100, 5)
    assert counts["flown"] > 10
    assert counts["by the supervisor"] > 0
