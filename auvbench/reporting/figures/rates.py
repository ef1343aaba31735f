"""Success under the conditions of a protocol, agent by agent, read once for all figures of a report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from auvbench.analysis.conditions import of_evaluations
from auvbench.analysis.records import Agent, Condition, Evaluation
from auvbench.reporting.figures.scene import Scene, evaluation
from auvbench.statistics.estimate import Estimate

Curve = Mapping[str, Estimate]
"""success rate in percent with its interval, by condition"""


def conditions(scene: Scene, agent: Agent, protocol: str) -> tuple[Condition, ...]:
    """What an agent did under the conditions of a protocol, of the seeds that met the same scenarios as the first."""
    key = agent.label, protocol
    if key not in scene.conditions:
        scene.conditions[key] = _read(scene, agent, protocol)
    return scene.conditions[key]


def rates(scene: Scene, agent: Agent, protocol: str) -> Curve:
    """Success of an agent by condition; empty where it was not tested by the protocol."""
    found = conditions(scene, agent, protocol)
    return {c.name: _percent(c.success[agent.label]) for c in found if agent.label in c.success}


def by_agent(scene: Scene, protocol: str, most: int) -> dict[str, Curve]:
    """By label, of the best agents that were tested by the protocol, at most `most` of them."""
    found: dict[str, Curve] = {}
    for agent in scene.agents:
        if len(found) < most and (curve := rates(scene, agent, protocol)):
            found[agent.label] = curve
    return found


def names(curves: Mapping[str, Curve]) -> Sequence[str]:
    """The conditions, in the order of the protocol."""
    return list(dict.fromkeys(name for curve in curves.values() for name in curve))


def _read(scene: Scene, agent: Agent, protocol: str) -> tuple[Condition, ...]:
    found: list[Evaluation] = []
    for run in agent.runs:
        here = evaluation(scene, run, protocol)
        if here is not None and here.fingerprint == (found[0] if found else here).fingerprint:
            found.append(here)
    if not found:
        return ()
    named = [str(condition["name"]) for condition in found[0].summary["conditions"]]
    return of_evaluations({agent.label: found}, named, scene.ranking.confidence)


def _percent(e: Estimate) -> Estimate:
    return Estimate(100 * e.value, 100 * e.low, 100 * e.high, e.confidence, e.covers)
