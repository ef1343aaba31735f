"""A reduced version of the error rates in docs/claims-measured.md."""

import numpy as np
import pytest

from auvbench.analysis.study.verdict import OPEN
from benchmarks.statistics.claims import WORLDS, shares


@pytest.mark.slow
@pytest.mark.parametrize("world", WORLDS, ids=lambda w: w.truth)
def test_wrong_verdicts_are_as_rare_as_they_promise(world):
    """5 seeds, and what so few experiments may show by chance."""
    n = 40
    for asked, found in shares(world, 5, n, seed=1).items():
        promised = 0.05 if asked == "1" else 0.025
        for verdict in world.wrong[asked]:
            assert found[verdict] <= promised + 3.5 * np.sqrt(promised * (1 - promised) / n)
        if "no agent learned" in world.truth:
            assert found[OPEN] == 1.0


def test_the_worlds_ask_for_every_claim():
    asked = {name for world in WORLDS for name in world.wrong}
    assert {name[0] for name in asked} == set("1234567")
    assert {"3", "4", "7", "3a", "3b", "3c", "4a", "4b", "5a", "5b", "7a", "7b", "7c"} <= asked
