"""Success under disturbances: one panel per factor of the robustness protocol."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes

from auvbench.reporting.figures import style
from auvbench.reporting.figures.scene import MANY, Drawing, FloatArray, Scene, seeds_sentence, shown, summary
from auvbench.reporting.model import Agent

PROTOCOL = "robustness"
UNDISTURBED = "nominal"
NOMINAL_VALUES = {"current": 0.0, "delay": 0.0, "noise": 1.0, "mass": 1.0, "drag": 1.0}
"""where the undisturbed condition lies on a factor's axis; elsewhere it is a word before the others"""
UNITS = {"current": "m/s", "delay": "s", "noise": "times", "mass": "times", "drag": "times"}
OTHER = "other conditions"
"""title of the panel of conditions without a level"""

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
    columns = 4 if len(factors) in (4, 7, 8) else min(3, len(factors))
    lines = -(-len(factors) // columns)
    figure = style.canvas(max(4.6, 2.9 * columns), 2.7 * lines + 0.5)
    grid = figure.subplots(lines, columns, squeeze=False, sharey=True)
    for i, ax in enumerate(grid.flat):
        ax.set_visible(i < len(factors))
    for ax, (factor, conditions) in zip(grid.flat, factors.items(), strict=False):
        for agent in chosen:
            _curve(ax, scene, agent, rates[agent.label], factor, conditions)
        _axis(ax, factor, conditions)
    for ax in grid[:, 0]:
        ax.set_ylabel("success (%)")
    style.legend(figure, scene.looks_of(chosen))
    caption = (
        "Test success under disturbances, one factor at a time, beside the undisturbed condition (protocol robustness)."
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
            if not {"name", "success_rate"} <= condition.keys():
                continue
            rates.setdefault(str(condition["name"]), []).append(100 * float(condition["success_rate"]))
    return rates


def _factors(rates: Mapping[str, Curve]) -> dict[str, list[str]]:
    """Conditions by factor, in the order of the protocol: 'current=0.5' belongs to current.

    The undisturbed condition, where there is one, stands first in each: it is everybody's reference.
    """
    factors: dict[str, list[str]] = {}
    conditions = dict.fromkeys(name for curve in rates.values() for name in curve)
    for condition in conditions:
        if condition != UNDISTURBED:
            name, _, value = condition.partition("=")
            factors.setdefault(name if value else OTHER, []).append(condition)
    if UNDISTURBED in conditions:
        factors = {name: [UNDISTURBED, *members] for name, members in factors.items()}
    return factors or {OTHER: list(conditions)}


def _curve(
    ax: Axes, scene: Scene, agent: Agent, curve: Curve, factor: str, conditions: Sequence[str]
) -> None:
    x = _positions(factor, conditions)
    there = [i for i in np.argsort(x) if conditions[i] in curve]
    if not there:
        return
    y = [np.array(curve[conditions[i]]) for i in there]
    look = scene.looks[agent.label]
    line = "" if factor == OTHER else look.linestyle  # a line would say that there is something in between
    ax.plot(
        x[there], [v.mean() for v in y], color=look.colour, marker=look.marker, linestyle=line, markersize=4
    )
    if max(map(len, y)) > 1:
        low, high = np.array([v.min() for v in y]), np.array([v.max() for v in y])
        if factor == OTHER:
            ax.vlines(x[there], low, high, color=look.colour, linewidth=1)
        else:
            ax.fill_between(x[there], low, high, color=look.colour, alpha=0.13, linewidth=0)


def _positions(factor: str, conditions: Sequence[str]) -> FloatArray:
    """Places on the factor's axis: numbers where all levels are numbers, else the order of the protocol."""
    texts = [condition.partition("=")[2] for condition in conditions]
    numbers = [
        NOMINAL_VALUES.get(factor) if condition == UNDISTURBED else _number(text)
        for condition, text in zip(conditions, texts, strict=True)
    ]
    if any(number is None for number in numbers):
        return np.arange(len(conditions), dtype=np.float64)
    return np.array(numbers, dtype=np.float64)


def _axis(ax: Axes, factor: str, conditions: Sequence[str]) -> None:
    """Title and ticks of a factor's panel."""
    unit = UNITS.get(factor)
    ax.set_title(factor + (f" ({unit})" if unit else ""), loc="left")
    x = _positions(factor, conditions)
    numeric = factor in NOMINAL_VALUES or UNDISTURBED not in conditions
    words = [condition.partition("=")[2] or condition for condition in conditions]
    if numeric:
        words = [
            f"{value:g}" if _number(word) is not None or word == UNDISTURBED else word
            for value, word in zip(x, words, strict=True)
        ]
    order = np.argsort(x)
    ax.set_xticks(x[order], [words[i] for i in order])
    ax.set_xmargin(0.3 if factor == OTHER else 0.08)
    ax.set_ylim(-2, 102)


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None
