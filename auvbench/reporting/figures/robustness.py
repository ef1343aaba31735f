"""Success under disturbances: one panel per factor of the robustness protocol."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes

from auvbench.reporting.figures import style
from auvbench.reporting.figures.scene import MANY, Drawing, Scene, seeds_sentence, shown, summary
from auvbench.reporting.model import Agent

PROTOCOL = "robustness"
LEVELS = "level"
"""title of the panel of conditions that are words: calm, moderate, severe"""

Curve = Mapping[str, list[float]]
"""success rates of the seeds, by condition"""


def curves(scene: Scene) -> Drawing | None:
    """Success over the level of each factor; None without evaluations by the robustness protocol."""
    rates: dict[str, Curve] = {}
    for agent in scene.agents:
        if len(rates) < MANY and (found := _rates(agent)):
            rates[agent.label] = found
    chosen = [agent for agent in scene.agents if agent.label in rates]
    if not chosen:
        return None
    factors = _factors(rates)
    columns = min(3, len(factors))
    lines = -(-len(factors) // columns)
    figure = style.canvas(max(4.6, 3.2 * columns), 2.7 * lines + 0.5)
    grid = figure.subplots(lines, columns, squeeze=False, sharey=True)
    for i, ax in enumerate(grid.flat):
        ax.set_visible(i < len(factors))
    for ax, (factor, conditions) in zip(grid.flat, factors.items(), strict=False):
        for agent in chosen:
            _curve(ax, scene, agent, rates[agent.label], factor, conditions)
        ax.set_title(factor.replace("_", " "), loc="left")
        ax.set_ylim(-2, 102)
    for ax in grid[:, 0]:
        ax.set_ylabel("success (%)")
    style.legend(figure, scene.looks_of(chosen))
    caption = (
        "Test success under disturbances, one factor at a time (protocol robustness)."
        + seeds_sentence(chosen)
        + shown(chosen, scene.agents)
    )
    return Drawing(figure, "Robustness", caption)


def _rates(agent: Agent) -> Curve:
    """Success rates by condition, of the seeds that met the same scenarios as the first."""
    rates: dict[str, list[float]] = {}
    fingerprint = None
    for run in agent.runs:
        found = summary(run, PROTOCOL)
        if found is None or fingerprint not in (None, found.get("fingerprint")):
            continue
        fingerprint = found.get("fingerprint")
        for condition in found.get("conditions", ()):
            rates.setdefault(str(condition["name"]), []).append(100 * float(condition["success_rate"]))
    return rates


def _factors(rates: Mapping[str, Curve]) -> dict[str, list[str]]:
    """Conditions by factor, in the order of the protocol: 'current=0.5' belongs to current, 'calm' to level."""
    factors: dict[str, list[str]] = {}
    for condition in dict.fromkeys(name for curve in rates.values() for name in curve):
        name, _, value = condition.partition("=")
        factors.setdefault(name if value else LEVELS, []).append(condition)
    return factors


def _curve(
    ax: Axes, scene: Scene, agent: Agent, curve: Curve, factor: str, conditions: Sequence[str]
) -> None:
    there = [c for c in conditions if c in curve]
    if not there:
        return
    texts = [c.partition("=")[2] or c for c in there]
    numbers = [_number(text) for text in texts]
    numeric = all(number is not None for number in numbers)
    x = np.array(numbers if numeric else [conditions.index(c) for c in there], dtype=np.float64)
    order = np.argsort(x)
    y = [np.array(curve[there[i]]) for i in order]
    look = scene.looks[agent.label]
    ax.plot(
        x[order],
        [v.mean() for v in y],
        color=look.colour,
        marker=look.marker,
        linestyle=look.linestyle,
        markersize=4,
    )
    if max(map(len, y)) > 1:
        low, high = [v.min() for v in y], [v.max() for v in y]
        ax.fill_between(x[order], low, high, color=look.colour, alpha=0.13, linewidth=0)
    if not numeric or len(x) <= 6:
        ax.set_xticks(x[order], [texts[i] for i in order])


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None
