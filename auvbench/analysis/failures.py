"""Where an agent's failures lie, for each agent by itself: near the surface, near the floor, far away.

Never over all agents at once: who steers into the surface and who sinks to the floor would be added up, and the sum
depends on who else is in the table.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from auvbench.analysis.formatting import counted, difference
from auvbench.analysis.measures import measure
from auvbench.analysis.records import NO_POLICY, Agent, Finding
from auvbench.statistics import holm
from auvbench.statistics.estimate import Estimate
from auvbench.statistics.intervals import FloatArray
from auvbench.statistics.spread import Spread

NEAR_THE_LIMIT = 5.0
"""m; a waypoint so close to the surface or the floor counts as near it"""
ENOUGH_SCENARIOS = 10
"""of either kind, before anything is said of where failures lie"""
TELLING = (0.05, 0.999)
"""success rates between which there are failures and successes enough to compare"""


@dataclass(frozen=True, slots=True)
class Place:
    """Failure rate of one agent in one kind of scenarios less that in others."""

    label: str
    where: str
    elsewhere: str
    rates: tuple[float, float]
    difference: Estimate
    p_value: float


def failures(agents: Sequence[Agent], confidence: float) -> list[Finding]:
    """Return for each kind of scenario the agent that fails most more in it than elsewhere, where that is resolved.

    Args:
        agents: of one table, with the same scenarios.
        confidence: of all findings together (Holm).
    """
    found = places([agent for agent in agents if (agent.outcome != NO_POLICY).any()], confidence)
    adjusted = holm([place.p_value for place in found])
    told = [place for place, p in zip(found, adjusted, strict=True) if p < 1 - confidence]
    result = []
    for where in dict.fromkeys(place.where for place in told):
        mine = [place for place in told if place.where == where]
        most = max(mine, key=lambda place: abs(place.difference.value))
        ids = next(tuple(run.id for run in agent.runs) for agent in agents if agent.label == most.label)
        others = f"; resolved for {counted(len(mine) - 1, 'more agent')}" if len(mine) > 1 else ""
        text = (
            f"{most.label} fails with {100 * most.rates[0]:.1f} % of the waypoints {where}, and with "
            f"{100 * most.rates[1]:.1f} % of those {most.elsewhere} "
            f"({difference(most.difference, measure('success_rate'))}){others}."
        )
        basis = f"Holm over {counted(len(found), 'such test')}"
        labels = tuple(place.label for place in mine)
        result.append(Finding("failures_by_place", text, labels, most.difference, basis, ids))
    return result


def places(agents: Sequence[Agent], confidence: float) -> list[Place]:
    """Every agent's failures near the surface, near the floor and far away, as far as there are scenarios enough."""
    found = []
    for agent in agents:
        kept = (agent.outcome != NO_POLICY).all(axis=1)
        failed = 1 - agent.success[kept]
        if not kept.any() or not TELLING[0] <= 1 - failed.mean() <= TELLING[1]:
            continue
        for where, elsewhere, kind, among in _kinds(agent):
            if min(int((kind & among).sum()), int((~kind & among).sum())) < ENOUGH_SCENARIOS:
                continue
            if (
                place := _compare(agent.label, where, elsewhere, failed[:, among], kind[among], confidence)
            ) is not None:
                found.append(place)
    return found


Kind = tuple[str, str, NDArray[np.bool_], NDArray[np.bool_]]
"""names of the one and the other kind of scenarios, which (E,) are of the one, and which (E,) are of either"""


def _kinds(agent: Agent) -> list[Kind]:
    kinds: list[Kind] = []
    config = agent.runs[0].config
    if (z := agent.metrics.get("waypoint_z_m")) is not None:
        depth = np.nanmax(z, axis=0)
        low, high = float(config.get("task.depth_low", -60.0)), float(config.get("task.depth_high", -1.0))
        surface, floor = high - depth < NEAR_THE_LIMIT, depth - low < NEAR_THE_LIMIT
        between = "in between"
        kinds.append(
            (
                f"less than {NEAR_THE_LIMIT:g} m below the upper depth limit",
                between,
                surface,
                ~floor | surface,
            )
        )
        kinds.append(
            (f"less than {NEAR_THE_LIMIT:g} m above the lower depth limit", between, floor, ~surface | floor)
        )
    if (initial := agent.metrics.get("initial_distance_m")) is not None:
        distance = np.nanmax(initial, axis=0)
        near, far = np.quantile(distance, [1 / 3, 2 / 3])
        kinds.append(
            (
                f"farther than {far:.0f} m",
                f"nearer than {near:.0f} m",
                distance >= far,
                (distance <= near) | (distance >= far),
            )
        )
    return kinds


def _compare(
    label: str, where: str, elsewhere: str, failed: FloatArray, kind: NDArray[np.bool_], confidence: float
) -> Place | None:
    """Failure rates (S, E) in two kinds of scenarios: Welch's variance over scenarios plus that between the seeds.

    The seeds' part is the variance of each seed's own difference over the number of seeds; what drawing episodes adds
    to it is counted twice, so that the interval errs on the long side. One seed: that policy, other scenarios.
    """
    one, other = failed[:, kind], failed[:, ~kind]
    rates = one.mean(axis=0), other.mean(axis=0)
    parts = np.array([rate.var(ddof=1) / len(rate) for rate in rates])
    if parts.sum() == 0:
        return None
    df = parts.sum() ** 2 / (parts**2 / [len(rate) - 1 for rate in rates]).sum()
    S = len(failed)
    seeds = float((one.mean(axis=1) - other.mean(axis=1)).var(ddof=1) / S) if S > 1 else 0.0
    spread = Spread(
        np.array([seeds]), np.array([S - 1.0 if S > 1 else np.inf]), np.array([parts.sum()]), np.array([df])
    )
    value = float(rates[0].mean() - rates[1].mean())
    half = float(spread.quantile(confidence)[0] * np.sqrt(seeds + parts.sum()))
    estimate = Estimate(value, max(value - half, -1.0), min(value + half, 1.0), confidence)
    p = float(spread.p_value(np.array([value]))[0])
    return Place(label, where, elsewhere, (float(rates[0].mean()), float(rates[1].mean())), estimate, p)
