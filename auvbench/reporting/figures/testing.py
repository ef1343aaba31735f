"""Figures of the test: steps against deviation, success over time, places of failures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from auvbench.analysis.records import Agent
from auvbench.record import OUTCOMES
from auvbench.reporting.figures import style
from auvbench.reporting.figures.scene import (
    MANY,
    Drawing,
    FloatArray,
    Scene,
    shown,
)
from auvbench.reporting.figures.seeds import band, lines_sentence
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
    ax.set_ylabel("episodes that reached the goal (%)")
    ax.set_ylim(0, 101)
    ax.set_xlim(0, longest)
    style.legend(figure, scene.looks_of(chosen), markers=False)
    caption = (
        "Share of the test episodes that have ended in success by a simulated time: the faster, the further left; "
        "the end of a line is the success rate." + lines_sentence(chosen) + shown(chosen, scene.agents)
    )
    return Drawing(figure, "Test: success over simulated time", caption)


def failures(scene: Scene) -> Drawing | None:
    """Draw the waypoints of the test coloured by outcome, from above and from the side."""
    chosen = scene.top(4)
    if "waypoint_x_m" not in chosen[0].metrics:
        return None
    figure = style.canvas(max(4.4, 2.7 * len(chosen)), 6.4)
    grid = figure.subplots(2, len(chosen), squeeze=False, sharex=True, sharey="row")
    for column, agent in enumerate(chosen):
        x, y, z = (agent.metrics[f"waypoint_{axis}_m"].ravel() for axis in "xyz")
        _waypoints(grid[0, column], x, y, agent.outcome.ravel())
        _waypoints(grid[1, column], x, z, agent.outcome.ravel())
        failed = int((agent.outcome != 0).sum())
        style.title(grid[0, column], agent.label, f"{failed} of {agent.outcome.size} failed")
        grid[0, column].set_aspect("equal")
        grid[1, column].set_xlabel("x (m)")
    low, high = depth_limits(chosen[0])
    for ax in grid[1]:
        ax.axhline(high, color="#444444", linestyle="--", linewidth=0.9)
        ax.axhline(low, color="#444444", linestyle="--", linewidth=0.9)
        ax.plot(0, -20, marker="+", color="black", markersize=8)
    for ax in grid[0]:
        ax.plot(0, 0, marker="+", color="black", markersize=8)
    grid[0, 0].set_ylabel("y (m)")
    grid[1, 0].set_ylabel("z (m)")
    style.outcome_legend(figure)
    caption = (
        "The waypoint of every test episode, seeds together, from above (top) and from the "
        "side (bottom); dashed the depth limits, + the start." + shown(chosen, scene.agents)
    )
    return Drawing(figure, "Test: where failures lie", caption)


def _waypoints(ax: Axes, x: FloatArray, y: FloatArray, outcome: np.ndarray) -> None:
    large = 24 if (outcome != 0).sum() < 150 else 9
    for code, name in enumerate(OUTCOMES):  # successes first, beneath the failures
        here = outcome == code
        colour, marker = style.OUTCOME_LOOK[name]
        size, alpha = (5, 0.3) if code == 0 else (large, 0.9)
        ax.scatter(
            x[here], y[here], s=size, color=colour, marker=marker, alpha=alpha, linewidth=0, rasterized=True
        )


def depth_limits(agent: Agent) -> tuple[float, float]:
    """Return the lowest and the highest z of the task, m."""
    config = agent.runs[0].config
    return float(config.get("task.depth_low", -60.0)), float(config.get("task.depth_high", -1.0))
