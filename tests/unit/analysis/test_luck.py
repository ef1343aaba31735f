"""Two seeds that agree beside two that do not: the report says where luck may make an interval narrow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from auvbench.analysis.measures import measure
from auvbench.analysis.model import Agent
from auvbench.analysis.ranking import rank
from auvbench.reporting.tables.notes import notes, remarks
from tests.unit.analysis.agents import agent


def with_failures(label: str, failures: list[int], episodes: int = 500) -> Agent:
    """Seeds that fail so many of the test episodes, on scenarios of their own."""
    made = agent(label=label, seeds=len(failures), episodes=episodes)
    outcome = np.zeros((len(failures), episodes), np.int8)
    for row, n in enumerate(failures):
        outcome[row, 40 * row : 40 * row + n] = 2
    return replace(made, outcome=outcome)


def test_seeds_that_agree_beside_seeds_that_do_not() -> None:
    ranking = rank([with_failures("SAC", [7, 7]), with_failures("PPO", [0, 100])])
    by_label = {row.label: row.estimates["success_rate"] for row in ranking.rows}
    widths = {label: e.high - e.low for label, e in by_label.items()}
    assert widths["PPO"] > 4 * widths["SAC"]  # what a reader would take for merit
    assert ranking.agreement.startswith(
        "Few seeds: those of SAC (98.6 and 98.6 %) agree as one policy does with itself in another test, those of "
        "PPO (100.0 and 80.0 %) do not."
    )
    assert ranking.agreement in notes(ranking)
    assert ranking.agreement in remarks(ranking)


@pytest.mark.parametrize(
    "failures",
    [
        ([7, 7], [9, 8]),  # all agree
        ([0, 100], [30, 90]),  # none does
        ([7, 7, 7, 7, 7], [0, 20, 40, 60, 100]),  # seeds enough
        ([7], [50]),
    ],
)
def test_nothing_is_said_where_no_interval_misleads(failures: tuple[list[int], ...]) -> None:
    agents = [with_failures(str(i), f) for i, f in enumerate(failures)]
    assert rank(agents).agreement == ""


def test_the_measure_that_ranks_is_the_one_that_is_judged() -> None:
    agents = [with_failures("SAC", [7, 7]), with_failures("PPO", [0, 100])]
    steps = {"SAC": [200.0, 200.0], "PPO": [201.0, 200.0]}
    rng = np.random.default_rng(1)
    noise = rng.normal(0, 1, 500)
    agents = [
        replace(a, metrics={**a.metrics, "energy_J": np.array([s + noise for s in steps[a.label]])})
        for a in agents
    ]
    assert measure("mean_energy_J")
    assert "SAC (200" in rank(agents, rank_by="mean_energy_J").agreement
