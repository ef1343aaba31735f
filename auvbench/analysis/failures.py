"""Where an agent's failures lie, for each agent by itself: near the surface, near the floor, far away.

Never over all agents at once: who steers into the surface and who sinks to the floor would be added up, and the sum
depends on who else is in the table.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from auvbench.analysis.formatting import counted, difference, listed
from auvbench.analysis.measures import measure
from auvbench.analysis.model import NO_POLICY, Agent, Finding
from auvbench.record import OUTCOMES
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
MOST = 6
"""agents that a sentence names"""


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
    """How the agents fail and where, in the order of the table.

    Args:
        agents: of one table, with the same scenarios.
        confidence: of all statements of where failures lie together.
    """
    tested = [agent for agent in agents if (agent.outcome != NO_POLICY).any()]
    if not tested:
        return []
    counts = {agent.label: _counts(agent) for agent in tested}
    if not any(c[1:].any() for c in counts.values()):
        episodes = int(sum(c.sum() for c in counts.values()))
        return [Finding(f"No agent failed in any of the {episodes:,} test episodes.")]
    found = places(tested, confidence)
    adjusted = holm([place.p_value for place in found])
    told = [place for place, p in zip(found, adjusted, strict=True) if p < 1 - confidence]
    result = [_how(counts)]
    for where in dict.fromkeys(place.where for place in found):
        mine = [place for place in told if place.where == where]
        if mine:
            result.append(_where(mine, len(found)))
    rest = list(dict.fromkeys(place.label for place in found if place not in told))
    none = [label for label in rest if label not in {place.label for place in told}]
    if none and found:
        kinds = listed(list(dict.fromkeys(place.where for place in found)), word="or")
        result.append(
            Finding(
                f"Whether {_names(none)} fails more with a waypoint {kinds} is not resolved.",
                statistic=_family(len(found)),
            )
        )
    return result


def _counts(agent: Agent) -> NDArray[np.int64]:
    """Episodes by outcome, of the trainings that gave a policy."""
    return np.array([int((agent.outcome == code).sum()) for code in range(len(OUTCOMES))])


def _names(labels: Sequence[str]) -> str:
    return listed(labels, MOST, word="or") if len(labels) <= MOST + 1 else f"any of {len(labels)} agents"


def _how(counts: dict[str, NDArray[np.int64]]) -> Finding:
    """Of each agent what its failures are."""
    parts = []
    failing = {label: c for label, c in counts.items() if c[1:].any()}
    for label, (_, collisions, timeouts) in list(failing.items())[:MOST]:
        n = int(collisions + timeouts)
        if not collisions or not timeouts:
            kind = "collision" if collisions else "timeout"
            parts.append(f"{label}, {counted(n, kind)}")
        else:
            parts.append(
                f"{label}, {counted(int(collisions), 'collision')} and {counted(int(timeouts), 'timeout')}"
            )
    more = f"; and {len(failing) - MOST} more agents" if len(failing) > MOST else ""
    without = [label for label in counts if label not in failing]
    clean = f" {listed(without, MOST)} did not fail." if without else ""
    return Finding(
        f"How the agents failed: {'; '.join(parts)}{more}.{clean}",
        statistic="Episodes of all training seeds of an agent.",
    )


def _where(found: Sequence[Place], tests: int) -> Finding:
    m = measure("success_rate")  # for its unit: these are rates too
    parts = [
        f"{place.label} {100 * place.rates[0]:.1f} % against {100 * place.rates[1]:.1f} % ({difference(place.difference, m)})"
        for place in found[:MOST]
    ]
    more = f"; and {len(found) - MOST} more agents" if len(found) > MOST else ""
    place = found[0]
    text = f"Failures with a waypoint {place.where} against {place.elsewhere}: {'; '.join(parts)}{more}."
    return Finding(text, statistic=_family(tests))


def _family(tests: int) -> str:
    return (
        f"Each agent by itself, with {100 * TELLING[0]:g} to {100 * TELLING[1]:g} % success; scenarios by Welch's "
        f"test, training seeds besides; Holm over {counted(tests, 'such test')}."
    )


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
