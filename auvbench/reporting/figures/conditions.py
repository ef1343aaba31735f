"""Success under the conditions of a protocol: curves over the levels of a factor, points over vehicles."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from auvbench.analysis.conditions import UNDISTURBED, UNITS, split
from auvbench.analysis.records import Agent
from auvbench.reporting.figures import rates, style
from auvbench.reporting.figures.colours import COLOURS
from auvbench.reporting.figures.rates import Curve
from auvbench.reporting.figures.scene import MANY, Drawing, FloatArray, Scene, shown

NOMINAL_VALUES = {"current": 0.0, "delay": 0.0, "noise": 1.0, "mass": 1.0, "drag": 1.0}
"""where the undisturbed condition lies on a factor's axis; elsewhere it is a word before the others"""
OTHER = "other conditions"
"""title of the panel of conditions without a level"""

ROOM = 0.35
"""share of the distance between two levels that the agents' points are spread over, so that no bar covers another"""


def robustness(scene: Scene) -> Drawing | None:
    """Success over the level of each factor; None without evaluations by the robustness protocol."""
    caption = "Test success under disturbances, one factor at a time, with the undisturbed condition (protocol robustness)."
    return _curves(scene, "robustness", "Robustness", caption)


def frequency_sweep(scene: Scene) -> Drawing | None:
    """Success over the frequency of the test; None without evaluations by the frequency_sweep protocol."""
    caption = (
        "Test success of the same policies at other frequencies (protocol frequency_sweep). Circled: the frequency of "
        "the training. The step limit is the same everywhere, so that a high frequency leaves less time."
    )
    drawing = _curves(scene, "frequency_sweep", "Test frequency", caption)
    if drawing is not None:
        ax = drawing.canvas.axes[0]
        ax.set_title("")
        ax.set_xlabel("step frequency of the test (Hz)")
        _circle_training(ax, scene)
    return drawing


def transfer(scene: Scene) -> Drawing | None:
    """Success on each vehicle, a group of points per vehicle; None without evaluations by the transfer protocol."""
    found = rates.by_agent(scene, "transfer", MANY)
    chosen = [agent for agent in scene.agents if agent.label in found]
    own = vehicles(chosen)
    names = rates.names(found)
    # A run of one vehicle meets it twice: as the undisturbed condition, and among all vehicles.
    conditions = [name for name in names if UNDISTURBED not in names or {split(name)[1]} != own]
    if not chosen or len(conditions) < 2:
        return None
    figure = style.canvas(7.0, 1.3 + len(conditions) * (0.22 + 0.13 * len(chosen)))
    ax = figure.subplots()
    for place, agent in enumerate(chosen):
        look, curve = scene.looks[agent.label], found[agent.label]
        offset = 0.7 * ((place + 0.5) / len(chosen) - 0.5)
        for y, condition in enumerate(conditions):
            if here := curve.get(condition):
                ax.hlines(y + offset, here.low, here.high, color=look.colour, linewidth=1.2)
                ax.plot(here.value, y + offset, color=look.colour, marker=look.marker, markersize=5)
    for y in range(1, len(conditions)):
        ax.axhline(y - 0.5, color="#c8c8c8", linewidth=0.7)
    ax.grid(visible=False, axis="y")
    ax.tick_params(axis="y", length=0)
    trained = f"{own.pop()}\n(as trained)" if len(own) == 1 else "as trained"
    words = [split(c)[1] or (trained if c == UNDISTURBED else c) for c in conditions]
    ax.set_yticks(range(len(conditions)), words)
    ax.set_ylim(len(conditions) - 0.5, -0.5)
    ax.set_xlim(-2, 102)
    ax.set_xlabel("success (%)")
    style.legend(figure, scene.looks_of(chosen), lines=False)
    caption = (
        "Test success of the same policies on other vehicles with the same actuators (protocol transfer)."
        + _intervals(scene, chosen)
        + of_how_many(chosen, scene)
    )
    return Drawing(figure, "Transfer to other vehicles", caption)


def gazebo(scene: Scene) -> Drawing | None:
    """What Gazebo changes of PAR-1 steps, an agent per line; None without evaluations by the gazebo protocol."""
    found = [(agent, rates.conditions(scene, agent, "gazebo")) for agent in scene.agents]
    tested = [(agent, conditions) for agent, conditions in found if any(c.par1_change for c in conditions)]
    if not tested:
        return None
    names = [c.name for c in tested[0][1] if c.par1_change]
    figure = style.canvas(7.0, 1.4 + 0.3 * len(tested))
    ax = figure.subplots()
    ax.axvline(0.0, color="#444444", linewidth=0.9)
    for place, name in enumerate(names):
        colour, marker = COLOURS[place % len(COLOURS)], style.MARKERS[place % len(style.MARKERS)]
        offset = 0.5 * ((place + 0.5) / len(names) - 0.5)
        for y, (agent, conditions) in enumerate(tested):
            for change in (c.par1_change.get(agent.label) for c in conditions if c.name == name):
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
        + _intervals(scene, [agent for agent, _ in tested]).partition("; agents")[0]
        + "."
    )
    return Drawing(figure, "In Gazebo", caption)


def vehicles(agents: Sequence[Agent]) -> set[str]:
    """Names of the vehicles that the agents were trained on."""
    return {str(agent.runs[0].config.get("vehicle.name")) for agent in agents}


def _curves(scene: Scene, protocol: str, title: str, caption: str) -> Drawing | None:
    """A panel per factor of the protocol, a curve per agent; None where no agent was tested by it."""
    found = rates.by_agent(scene, protocol, MANY)
    chosen = [agent for agent in scene.agents if agent.label in found]
    if not chosen:
        return None
    factors = _factors(rates.names(found))
    columns = 4 if len(factors) in (4, 7, 8) else min(3, len(factors))
    lines = -(-len(factors) // columns)
    width, height = (6.4, 4.2) if len(factors) == 1 else (max(4.6, 2.9 * columns), 2.7 * lines + 0.5)
    figure = style.canvas(width, height)
    grid = figure.subplots(lines, columns, squeeze=False, sharey=True)
    for i, ax in enumerate(grid.flat):
        ax.set_visible(i < len(factors))
    for ax, (factor, conditions) in zip(grid.flat, factors.items(), strict=False):
        for place, agent in enumerate(chosen):
            side = (place + 0.5) / len(chosen) - 0.5
            _curve(ax, scene, agent, found[agent.label], factor, conditions, side)
        _axis(ax, factor, conditions)
    for ax in grid[:, 0]:
        ax.set_ylabel("success (%)")
    style.legend(figure, scene.looks_of(chosen))
    return Drawing(figure, title, caption + _intervals(scene, chosen) + of_how_many(chosen, scene))


def _intervals(scene: Scene, chosen: Sequence[Agent]) -> str:
    """What points and bars are."""
    percent = f"{100 * scene.ranking.confidence:g} %"
    over = "training seeds and test episodes" if all(len(a.runs) > 1 for a in chosen) else "test episodes"
    if over == "test episodes" and any(len(agent.runs) > 1 for agent in chosen):
        over += ", and training seeds where there are several"
    return f" Bars: {percent} intervals over {over}; agents stand side by side at each level."


def of_how_many(chosen: Sequence[Agent], scene: Scene, most: int = MANY) -> str:
    """'' or the sentence of a caption that says why not all agents are shown; `most` is how many there is room for."""
    if len(chosen) == most:
        return shown(chosen, scene.agents)
    few = len(chosen) < len(scene.agents)
    return f" Tested under these: {len(chosen)} of {len(scene.agents)} agents." if few else ""


def _factors(conditions: Sequence[str]) -> dict[str, list[str]]:
    """Conditions by factor, in the order of the protocol: 'current=0.5' belongs to current.

    The undisturbed condition, where there is one, stands first in each: it is everybody's reference.
    """
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
    """Points with their intervals; `side` in (-0.5, 0.5) is the agent's place among the others at each level."""
    x = _positions(factor, conditions)
    there = [i for i in np.argsort(x) if conditions[i] in curve]
    if not there:
        return
    gaps = np.diff(np.unique(x))
    at = x[there] + side * ROOM * (float(gaps.min()) if gaps.size else 1.0)
    found = [curve[conditions[i]] for i in there]
    look = scene.looks[agent.label]
    line = "" if factor == OTHER else look.linestyle  # a line would say that there is something in between
    ax.vlines(at, [e.low for e in found], [e.high for e in found], color=look.colour, linewidth=1, alpha=0.6)
    ax.plot(
        at,
        [e.value for e in found],
        color=look.colour,
        marker=look.marker,
        linestyle=line,
        linewidth=1.2,
        markersize=4,
        label=agent.label,
    )


def _circle_training(ax: Axes, scene: Scene) -> None:
    """A ring around each agent's point at the frequency that it was trained at; a controller has none."""
    frequency = {a.label: a.runs[0].config.get("step.frequency") for a in scene.learners()}
    levels = np.array(ax.get_xticks())
    for line in list(ax.lines):
        label = str(line.get_label())
        for x, y in zip(np.asarray(line.get_xdata()), np.asarray(line.get_ydata()), strict=True):
            if levels[np.abs(levels - x).argmin()] == frequency.get(label):
                colour = scene.looks[label].colour
                ring = ax.plot(x, y, "o", markersize=11, color=colour, clip_on=False)[0]
                ring.set_markerfacecolor("none")


def _positions(factor: str, conditions: Sequence[str]) -> FloatArray:
    """Places on the factor's axis: numbers where all levels are numbers, else the order of the protocol."""
    numbers = [
        NOMINAL_VALUES.get(factor) if condition == UNDISTURBED else _number(split(condition)[1])
        for condition in conditions
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
    words = [split(condition)[1] or condition for condition in conditions]
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
