"""Results under the conditions of a protocol: curves over the levels of a factor, and Gazebo."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes

from auvbench.analysis.conditions import UNDISTURBED, UNITS, split
from auvbench.analysis.records import Agent
from auvbench.reporting.figures import style
from auvbench.reporting.figures.scene import MANY, Drawing, FloatArray, Scene, shown
from auvbench.statistics.estimate import Estimate

NOMINAL_VALUES = {"current": 0.0, "delay": 0.0, "noise": 1.0, "mass": 1.0, "drag": 1.0}
"""level of the undisturbed condition on a factor's axis; other factors show its name"""
OTHER = "other conditions"
"""title of the panel of conditions without a level"""
ROOM = 0.35
"""share of the distance between two levels over which the agents' points are spread"""

Curve = Mapping[str, Estimate]
"""success rate with its interval, by condition"""


def curves(scene: Scene, protocol: str, most: int = MANY) -> dict[str, Curve]:
    """Return success by label and condition, of at most `most` tested agents, the best-ranked first."""
    found: dict[str, Curve] = {}
    for agent in scene.agents:
        tested = {c.name: c.success for c in scene.tested(agent, protocol)} if len(found) < most else {}
        if curve := {name: of[agent.label] for name, of in tested.items() if agent.label in of}:
            found[agent.label] = curve
    return found


def names(found: Mapping[str, Curve]) -> list[str]:
    """Return the conditions in the order of the protocol."""
    return list(dict.fromkeys(name for curve in found.values() for name in curve))


def agents_sentence(chosen: Sequence[Agent], scene: Scene, most: int = MANY) -> str:
    """Return the sentence of a caption on agents that are not shown, or ''; `most` is how many there is room for."""
    if len(chosen) == most:
        return shown(chosen, scene.agents)
    few = len(chosen) < len(scene.agents)
    return f" Tested under these: {len(chosen)} of {len(scene.agents)} agents." if few else ""


def robustness(scene: Scene) -> Drawing | None:
    """Draw success over the level of each factor of the robustness protocol."""
    caption = "Test success under disturbances, one factor at a time, and undisturbed (protocol robustness)."
    return _panels(scene, "robustness", "Robustness", caption)


def frequency_sweep(scene: Scene) -> Drawing | None:
    """Draw success over the frequency of the test."""
    caption = (
        "Test success of the same policies at other frequencies (protocol frequency_sweep). Circled: the frequency of "
        "the training. The step limit is the same everywhere, so that a high frequency leaves less time."
    )
    return _panels(scene, "frequency_sweep", "Test frequency", caption)


def gazebo(scene: Scene) -> Drawing | None:
    """Draw how Gazebo changes each agent's PAR-1 steps."""
    found = [(agent, scene.tested(agent, "gazebo")) for agent in scene.agents]
    tested = [(agent, conditions) for agent, conditions in found if any(c.par1_change for c in conditions)]
    if not tested:
        return None
    conditions = [c.name for c in tested[0][1] if c.par1_change]
    figure = style.canvas(7.0, 1.4 + 0.3 * len(tested))
    ax = figure.subplots()
    ax.axvline(0.0, color="#444444", linewidth=0.9)
    for place, name in enumerate(conditions):
        colour, marker = style.COLOURS[place % len(style.COLOURS)], style.MARKERS[place % len(style.MARKERS)]
        offset = 0.5 * ((place + 0.5) / len(conditions) - 0.5)
        for y, (agent, results) in enumerate(tested):
            for change in (c.par1_change.get(agent.label) for c in results if c.name == name):
                if change is not None:
                    ax.hlines(y + offset, change.low, change.high, color=colour, linewidth=1.2)
                    ax.plot(change.value, y + offset, color=colour, marker=marker, markersize=4)
        ax.plot([], [], color=colour, marker=marker, linestyle="", label=name.partition("=")[2] or name)
    ax.grid(visible=False, axis="y")
    ax.set_yticks(range(len(tested)), [agent.label for agent, _ in tested])
    ax.set_ylim(len(tested) - 0.5, -0.5)
    ax.set_xlabel("change of PAR-1 steps against the embedded simulator")
    ax.legend(loc="best")
    caption = (
        "PAR-1 steps (a failure counts as the limit) of the same policies in Gazebo less those in the embedded simulator, paired by "
        "seed and scenario (protocol gazebo); left of the line an agent is sooner there."
        f"{_intervals(scene, [agent for agent, _ in tested])}."
    )
    return Drawing(figure, "In Gazebo", caption)


def _panels(scene: Scene, protocol: str, title: str, caption: str) -> Drawing | None:
    """Draw a panel per factor of the protocol and a curve per agent."""
    found = curves(scene, protocol)
    chosen = [agent for agent in scene.agents if agent.label in found]
    if not chosen:
        return None
    factors = _factors(names(found))
    columns = min(4, len(factors))
    lines = -(-len(factors) // columns)
    figure = style.canvas(max(6.4, 2.9 * columns), 2.7 * lines + 0.9)
    grid = figure.subplots(lines, columns, squeeze=False, sharey=True)
    for ax in grid.flat[len(factors) :]:
        ax.set_visible(False)
    for ax, (factor, conditions) in zip(grid.flat, factors.items(), strict=False):
        for place, agent in enumerate(chosen):
            side = (place + 0.5) / len(chosen) - 0.5
            _curve(ax, scene, agent, found[agent.label], factor, conditions, side)
        _axis(ax, factor, conditions)
    for ax in grid[:, 0]:
        ax.set_ylabel("success (%)")
    style.legend(figure, scene.looks_of(chosen))
    more = f"{_intervals(scene, chosen)}; agents stand side by side at each level."
    return Drawing(figure, title, caption + more + agents_sentence(chosen, scene))


def _intervals(scene: Scene, chosen: Sequence[Agent]) -> str:
    percent = f"{100 * scene.ranking.confidence:g} %"
    several = [len(agent.runs) > 1 for agent in chosen]
    over = "training seeds and test episodes" if all(several) else "test episodes"
    if any(several) and not all(several):
        over += ", and training seeds where there are several"
    return f" Bars: {percent} intervals over {over}"


def _factors(conditions: Sequence[str]) -> dict[str, list[str]]:
    """Return the conditions by factor in the order of the protocol; each factor begins with the undisturbed one."""
    factors: dict[str, list[str]] = {}
    for condition in conditions:
        if condition != UNDISTURBED:
            factor, level = split(condition)
            factors.setdefault(factor if level else OTHER, []).append(condition)
    if UNDISTURBED in conditions:
        factors = {name: [UNDISTURBED, *members] for name, members in factors.items()}
    return factors or {OTHER: list(conditions)}


def _curve(
    ax: Axes,
    scene: Scene,
    agent: Agent,
    curve: Curve,
    factor: str,
    conditions: Sequence[str],
    side: float,
) -> None:
    """Draw points with their intervals; `side` in (-0.5, 0.5) is the agent's place at each level."""
    x = _positions(factor, conditions)
    there = [i for i in np.argsort(x) if conditions[i] in curve]
    if not there:
        return
    gaps = np.diff(np.unique(x))
    at = x[there] + side * ROOM * (float(gaps.min()) if gaps.size else 1.0)
    points = np.array([[e.value, e.low, e.high] for e in (curve[conditions[i]] for i in there)]) * 100
    look = scene.looks[agent.label]
    line = "" if factor == OTHER else look.linestyle  # nothing lies between conditions without a level
    ax.vlines(at, points[:, 1], points[:, 2], color=look.colour, linewidth=1, alpha=0.6)
    ax.plot(
        at,
        points[:, 0],
        color=look.colour,
        marker=look.marker,
        linestyle=line,
        linewidth=1.2,
        markersize=4,
        label=agent.label,
    )
    if factor == "frequency" and agent in scene.learners():
        ring = x[there] == agent.runs[0].config.get("step.frequency")
        rings = ax.plot(at[ring], points[ring, 0], "o", markersize=11, color=look.colour, clip_on=False)
        rings[0].set_markerfacecolor("none")


def _positions(factor: str, conditions: Sequence[str]) -> FloatArray:
    """Return the places on the factor's axis: levels where all are numbers, else the order of the protocol."""
    try:
        return np.array(
            [NOMINAL_VALUES[factor] if c == UNDISTURBED else float(split(c)[1]) for c in conditions]
        )
    except (KeyError, ValueError):
        return np.arange(len(conditions), dtype=np.float64)


def _axis(ax: Axes, factor: str, conditions: Sequence[str]) -> None:
    unit = UNITS.get(factor)
    ax.set_title(factor + (f" ({unit})" if unit else ""), loc="left")
    x = _positions(factor, conditions)
    words = [split(condition)[1] or condition for condition in conditions]
    if factor in NOMINAL_VALUES:
        words = [
            f"{value:g}" if c == UNDISTURBED else w for value, c, w in zip(x, conditions, words, strict=True)
        ]
    order = np.argsort(x)
    ax.set_xticks(x[order], [words[i] for i in order])
    ax.set_xmargin(0.3 if factor == OTHER else 0.08)
    ax.set_ylim(-2, 102)
