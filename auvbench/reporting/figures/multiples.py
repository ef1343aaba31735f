"""Small multiples: a panel per agent, the others' lines in grey behind its own, where one panel would be a thicket."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from auvbench.analysis.records import Agent
from auvbench.reporting.figures.scene import FloatArray, Scene

FEW = 4
"""agents whose lines and bands one panel holds"""
MOST = 12
"""agents with a panel of their own"""
GREY = "#c4c9cc"
ROBUST = 4
"""seeds from which cutting a quarter at either end cuts anything"""

Curve = tuple[FloatArray, FloatArray]
"""x (n,) and y by seed (seeds, n), NaN where a seed has no value"""


def columns_of(n: int) -> int:
    """Columns of a grid of n panels whose last row is not nearly empty."""
    return n if n <= 3 else 2 if n == 4 else 3 if n in (5, 6, 9) else 4


def middle(y: FloatArray) -> FloatArray:
    """(n,) Interquartile mean over the seeds that have a value (seeds, n); of fewer than four the mean.

    Of n values floor(n/4) are cut at either end (Agarwal et al. 2021, NeurIPS).
    """
    ordered = np.sort(y, axis=0)  # NaN last
    count = np.isfinite(y).sum(axis=0)
    cut = count // 4
    place = np.arange(len(y))[:, None]
    kept = (place >= cut) & (place < count - cut)
    total = np.where(kept, ordered, 0.0).sum(axis=0)
    kept_of = kept.sum(axis=0)
    return np.asarray(np.divide(total, kept_of, out=np.full(y.shape[1], np.nan), where=kept_of > 0))


def band(
    ax: Axes, scene: Scene, agent: Agent, curve: Curve, *, dots: bool = False, alone: bool = False
) -> None:
    """The agent's line over its seeds, their range as a band and, where asked for, the seeds themselves as dots.

    A line that stands alone in its panel is solid.
    """
    x, y = curve
    there = np.isfinite(y).any(axis=0)
    if not there.any():
        return
    x, y = x[there], y[:, there]
    look = scene.looks[agent.label]
    if len(y) > 1:
        low, high = np.nanmin(y, axis=0), np.nanmax(y, axis=0)
        ax.fill_between(x, low, high, color=look.colour, alpha=0.15, linewidth=0)
    if dots:
        for row in y:
            ax.plot(x, row, ".", color=look.colour, markersize=3.2, alpha=0.55, markeredgewidth=0)
    style = "-" if alone else look.linestyle
    ax.plot(x, middle(y), color=look.colour, linestyle=style, label=agent.label)


def behind(ax: Axes, curves: Sequence[Curve]) -> None:
    """The other agents' lines, in grey."""
    for x, y in curves:
        ax.plot(x, middle(y), color=GREY, linewidth=0.9, zorder=1)


def lines_sentence(agents: Sequence[Agent], *, dots: bool = False) -> str:
    """What lines, bands and dots are, given the seeds there are."""
    most = max(len(agent.runs) for agent in agents)
    if most < 2:
        return " One training seed per agent."
    lines = "interquartile mean over training seeds" if most >= ROBUST else "mean over training seeds"
    few = any(len(agent.runs) < ROBUST for agent in agents)
    lines += " (the mean of fewer than four)" if most >= ROBUST and few else ""
    return f" Lines: {lines}; bands: their range{'; dots: the seeds' if dots else ''}."


def grey_sentence(n: int) -> str:
    """What the grey lines are, in a figure of n panels."""
    return " In grey behind each agent: the others." if n > FEW else ""
