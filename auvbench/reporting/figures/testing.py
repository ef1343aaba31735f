"""Figures of the test: steps against deviation, success over time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from auvbench.reporting.figures import style
from auvbench.reporting.figures.scene import (
    MANY,
    Drawing,
    Scene,
    band,
    lines_sentence,
    shown,
)
from auvbench.statistics.intervals import Estimate

MOST_LABELS = 12
"""most agents in colour"""


def steps_deviation(scene: Scene) -> Drawing | None:
    """Draw mean steps against mean deviation, a point per agent (original study, figure 3.5)."""
    rows = {row.label: row for row in scene.ranking.rows}
    figure = style.canvas(6.4, 4.6)
    ax = figure.subplots()
    named = scene.top(MOST_LABELS)
    pairs = {
        a.label: [rows[a.label].estimates.get(m) for m in ("mean_steps", "mean_deviation_mean_m")]
        for a in scene.agents
    }
    known = {label: (x, y) for label, (x, y) in pairs.items() if x is not None and y is not None}
    if not known:
        return None
    rest = [known[a.label] for a in scene.agents if a not in named and a.label in known]
    if rest:
        _crosses(ax, rest, color="#b0b0b0", marker=".", markersize=6)
    for agent in reversed(named):
        if agent.label in known:
            look = scene.looks[agent.label]
            _crosses(ax, [known[agent.label]], color=look.colour, marker=look.marker, markersize=7)
    ax.set_xlabel("mean steps per episode")
    ax.set_ylabel("mean deviation from the straight line (m)")
    style.legend(figure, scene.looks_of(named), lines=False)
    percent = f"{100 * scene.ranking.confidence:g} %"
    others = f" In grey: the other {len(rest)} agents." if rest else ""
    caption = (
        f"Mean steps against mean deviation from the straight line, one point per agent, with {percent} "
        f"intervals; lower left is better.{others}"
    )
    return Drawing(figure, "Test: steps against deviation", caption)


def _crosses(ax: Axes, points: Sequence[tuple[Estimate, Estimate]], **style_: Any) -> None:
    """Draw points with their intervals in x and y."""
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
    """Draw the share of the test episodes that have reached the goal over simulated time."""
    chosen = scene.top(MANY)
    arrivals = [a.metrics["duration_s"][a.outcome == 0] for a in chosen]
    if not any(times.size for times in arrivals):
        return None
    longest = 1.05 * max(float(times.max()) for times in arrivals if times.size)  # after it, nothing happens
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
        "Share of the test episodes that have ended in success by a simulated time: the faster, the further left; "
        "the end of a line is the success rate." + lines_sentence(chosen) + shown(chosen, scene.agents)
    )
    return Drawing(figure, "Test: success over simulated time", caption)
