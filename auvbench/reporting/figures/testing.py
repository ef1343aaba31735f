"""Draw the figures of the test: success over a grid, under conditions and over time, and steps against deviation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.image import AxesImage
from numpy.typing import NDArray

from auvbench.analysis.conditions import UNDISTURBED, in_words, split
from auvbench.analysis.formatting import listed, rounded
from auvbench.analysis.labels import part
from auvbench.analysis.records import Row
from auvbench.reporting.figures import style
from auvbench.reporting.figures.scene import (
    MANY,
    Drawing,
    Scene,
    band,
    lines_sentence,
    shown,
)
from auvbench.statistics.intervals import Estimate, FloatArray

PROTOCOLS = ("robustness", "suite", "transfer", "frequency_sweep")
"""protocols whose conditions the figure shows side by side"""
MOST_AGENTS = 40
MOST_CELLS = 150
"""largest number of cells in a figure of K and frequency; values that were sampled at random give larger grids"""

MOST_LABELS = 12
"""largest number of agents in colour"""


Curve = Mapping[str, Estimate]
"""success rate with its interval, by condition"""


def success_over_grid(scene: Scene) -> Drawing | None:
    """Draw success over K and step frequency, one panel per algorithm.

    Return None if no algorithm has several agents with K and frequency, or if the grid has more than `MOST_CELLS`.
    """
    rows = [r for r in scene.ranking.rows if {"reward.k", "step.frequency"} <= r.key.keys()]
    algos: dict[str, list[Row]] = {}
    for row in rows:
        algos.setdefault(str(row.key.get("algo", "")), []).append(row)
    algos = {name: members for name, members in sorted(algos.items()) if len(members) > 1}
    members = [row for group in algos.values() for row in group]
    ks = sorted({float(row.key["reward.k"]) for row in members})
    fs = sorted({float(row.key["step.frequency"]) for row in members}, reverse=True)
    if not algos or len(ks) * len(fs) > MOST_CELLS:
        return None
    columns = min(3, len(algos))
    lines = -(-len(algos) // columns)
    width = max(1.0, 0.62 * len(ks)) + 0.9
    figure = style.canvas(max(4.2, columns * width + 1.0), max(2.2, lines * (0.5 * len(fs) + 0.9)))
    grid = figure.subplots(lines, columns, squeeze=False)
    for ax in grid.flat[len(algos) :]:
        ax.set_visible(False)
    lowest = min(90.0, 10 * np.floor(10 * min(row.estimates["success_rate"].value for row in members)))
    for ax, (name, group) in zip(grid.flat, algos.items(), strict=False):
        values = np.full((len(fs), len(ks)), np.nan)
        texts = np.full(values.shape, "", dtype=object)
        for row in group:
            where = fs.index(float(row.key["step.frequency"])), ks.index(float(row.key["reward.k"]))
            values[where] = 100 * row.estimates["success_rate"].value
            texts[where] = rounded(row.estimates["success_rate"], 100)[0]  # text as in the table
        image = _heat(ax, values, lowest, texts)
        ax.set_title(part("algo", name) if name else "all", loc="left")
        ax.set_xticks(range(len(ks)), [f"{k:g}" for k in ks])
        ax.set_yticks(range(len(fs)), [f"{f:g}" for f in fs])
        ax.set_xlabel("K")
    for ax in grid[:, 0]:
        ax.set_ylabel("step frequency (Hz)")
    figure.colorbar(image, ax=grid, label="test success (%)", shrink=0.8)
    caption = (
        "Test success over reward coefficient K and training step frequency. A cell with a cross has no evaluated "
        "run. Intervals are in the table."
    )
    return Drawing(figure, "Success over K and step frequency", caption)


def success_over_conditions(scene: Scene) -> Drawing | None:
    """Draw success of every agent under each condition of `PROTOCOLS`; return None for fewer than two conditions."""
    values: dict[str, dict[str, float]] = {}
    conditions: list[str] = []
    used = []
    for protocol in PROTOCOLS:
        lines = curves(scene, protocol)
        used += [protocol] if lines else []
        names = list(dict.fromkeys(name for curve in lines.values() for name in curve))
        # If all agents have the same vehicle, the condition with this vehicle equals the undisturbed condition: leave it out.
        own = {str(a.runs[0].config.get("vehicle.name")) for a in scene.agents if a.label in lines}
        duplicates = {f"vehicle={vehicle}" for vehicle in own if len(own) == 1 and UNDISTURBED in names}
        new = [name for name in names if name not in duplicates and name not in conditions]
        conditions += new
        for label, curve in lines.items():
            success = {name: 100 * curve[name].value for name in new if name in curve}
            values[label] = values.get(label, {}) | success
    tested = [agent for agent in scene.agents if agent.label in values][:MOST_AGENTS]
    if not tested or len(conditions) < 2:
        return None
    cells = np.array([[values[a.label].get(name, np.nan) for name in conditions] for a in tested])
    texts = np.array([_whole(value) for value in cells.flat], dtype=object).reshape(cells.shape)
    figure = style.canvas(2.4 + 0.34 * len(conditions), 1.5 + 0.23 * len(tested))
    ax = figure.subplots()
    image = _heat(ax, cells, 0, texts)
    factors = [split(name)[0] for name in conditions]
    for i in range(1, len(factors)):
        if factors[i] != factors[i - 1]:
            ax.axvline(i - 0.5, color="white", linewidth=4)
    words = [" ".join(in_words(name)).strip().removeprefix("vehicle ") for name in conditions]
    ax.set_xticks(range(len(words)), words, rotation=45, ha="right", rotation_mode="anchor")
    ax.set_yticks(range(len(tested)), [agent.label for agent in tested])
    figure.colorbar(image, ax=ax, label="test success (%)", shrink=0.8)
    few = len(tested) < len(scene.agents)
    caption = (
        f"Test success of the same policies under each condition of {listed(used)}, agents in the order of the ranking; 100 is "
        "every episode. These tests may have fewer trainings and episodes than the main table. Intervals are in conditions.csv."
        + (" A cross: not tested." if np.isnan(cells).any() else "")
        + (
            f" Shown: {len(tested)} of {len(scene.agents)} agents, the best-ranked that were tested."
            if few
            else ""
        )
    )
    return Drawing(figure, "Success under each condition", caption)


def curves(scene: Scene, protocol: str) -> dict[str, Curve]:
    """Return the success of the best-ranked tested agents by label and condition."""
    rates: dict[str, Curve] = {}
    for agent in scene.agents:
        if len(rates) == MOST_AGENTS:
            break
        tested = scene.tested(agent, protocol)
        if curve := {c.name: c.success[agent.label] for c in tested if agent.label in c.success}:
            rates[agent.label] = curve
    return rates


def _whole(percent: float) -> str:
    """Return a percentage as a whole number; 100 is only for success in every episode, and 0 only for no success.

    >>> _whole(99.97), _whole(100.0), _whole(0.2), _whole(54.5)
    ('99', '100', '1', '54')
    """
    return f"{percent if percent in (0.0, 100.0) else min(max(percent, 1.0), 99.0):.0f}"


def _heat(ax: Axes, values: FloatArray, low: float, texts: NDArray[np.object_]) -> AxesImage:
    """Draw a grid of cells coloured by their values, from `low` to 100; write `texts` into the cells, and a cross for NaN."""
    image = ax.imshow(values, cmap="cividis", vmin=low, vmax=100, aspect="auto")
    ax.grid(visible=False)
    ax.spines[:].set_visible(False)
    ax.tick_params(length=0)
    for (i, j), value in np.ndenumerate(values):
        finite = bool(np.isfinite(value))
        colour = ("white" if (value - low) / (100 - low) < 0.5 else "black") if finite else "#a0a0a0"
        text = str(texts[i, j]) if finite else "✕"
        ax.text(j, i, text, ha="center", va="center", color=colour, size=7.5 if finite else None)
    return image


def steps_deviation(scene: Scene) -> Drawing | None:
    """Draw mean steps against mean deviation, one point per agent (original study, figure 3.5)."""
    rows = {row.label: row for row in scene.ranking.rows}
    figure = style.canvas(6.4, 4.6)
    ax = figure.subplots()
    named = scene.top(MOST_LABELS)
    pairs = {
        a.label: [rows[a.label].estimates.get(m) for m in ("mean_steps", "mean_deviation_mean_m")]
        for a in scene.agents
    }
    points = {label: (x, y) for label, (x, y) in pairs.items() if x is not None and y is not None}
    if not points:
        return None
    unnamed = [points[a.label] for a in scene.agents if a not in named and a.label in points]
    if unnamed:
        _crosses(ax, unnamed, color="#b0b0b0", marker=".", markersize=6)
    for agent in reversed(named):
        if agent.label in points:
            look = scene.looks[agent.label]
            _crosses(ax, [points[agent.label]], color=look.colour, marker=look.marker, markersize=7)
    ax.set_xlabel("mean steps per episode")
    ax.set_ylabel("mean deviation from the straight line (m)")
    style.legend(figure, scene.looks_of(named), lines=False)
    percent = f"{100 * scene.ranking.confidence:g} %"
    remark = f" In grey: the other {len(unnamed)} agents." if unnamed else ""
    caption = (
        f"Mean steps against mean deviation from the straight line, one point per agent, with {percent} "
        f"intervals; lower left is better.{remark}"
    )
    return Drawing(figure, "Test: steps against deviation", caption)


def _crosses(ax: Axes, points: Sequence[tuple[Estimate, Estimate]], **style_: Any) -> None:
    """Draw points as crosses whose arms are the intervals in x and y."""
    x, y = zip(*points, strict=True)
    centre = [[e.value for e in line] for line in (x, y)]
    bars = [
        np.nan_to_num([[max(0.0, e.value - e.low) for e in line], [max(0.0, e.high - e.value) for e in line]])
        for line in (x, y)
    ]
    ax.errorbar(
        centre[0], centre[1], xerr=bars[0], yerr=bars[1], linestyle="", elinewidth=1, capsize=2, **style_
    )


def success_over_time(scene: Scene) -> Drawing | None:
    """Draw the share of test episodes that have reached the goal, over simulated time."""
    chosen = scene.top(MANY)
    arrivals = [a.metrics["duration_s"][a.outcome == 0] for a in chosen]
    if not any(times.size for times in arrivals):
        return None
    # All curves are constant after the last arrival.
    longest = 1.05 * max(float(times.max()) for times in arrivals if times.size)
    t = np.linspace(0, longest, 240)
    figure = style.canvas(6.4, 4.2)
    ax = figure.subplots()
    for agent in chosen:
        times = np.where(agent.outcome == 0, agent.metrics["duration_s"], np.inf)
        share = 100 * np.array([np.searchsorted(np.sort(row), t, side="right") / row.size for row in times])
        band(ax, scene.looks[agent.label], (t, share))
    ax.set_xlabel("simulated time since the start (s)")
    ax.set_ylabel("goal reached (%)")
    ax.set_ylim(0, 101)
    ax.set_xlim(0, longest)
    style.legend(figure, scene.looks_of(chosen), markers=False)
    caption = (
        "Share of the test episodes that have ended in success by a simulated time. The line of a faster agent is further left; "
        "the end of a line is the success rate." + lines_sentence(chosen) + shown(chosen, scene.agents)
    )
    return Drawing(figure, "Test: success over simulated time", caption)
