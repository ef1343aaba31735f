"""Lines over training seeds, with their range."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from auvbench.analysis.records import Agent
from auvbench.reporting.figures.scene import FloatArray
from auvbench.reporting.figures.style import Look

ROBUST = 4
"""seeds from which the interquartile mean leaves any out"""

Curve = tuple[FloatArray, FloatArray]
"""x (n,) and y by seed (seeds, n), NaN where a seed has no value"""


def middle(y: FloatArray) -> FloatArray:
    """Return the interquartile mean (n,) over the seeds that have a value (seeds, n); of fewer than four the mean.

    Of n values floor(n/4) are cut at either end (Agarwal et al. 2021, NeurIPS).
    """
    ordered = np.sort(y, axis=0)  # NaN last
    count = np.isfinite(y).sum(axis=0)
    place = np.arange(len(y))[:, None]
    kept = (place >= count // 4) & (place < count - count // 4)
    total, number = np.where(kept, ordered, 0.0).sum(axis=0), kept.sum(axis=0)
    return np.asarray(np.divide(total, number, out=np.full(y.shape[1], np.nan), where=number > 0))


def band(ax: Axes, look: Look, curve: Curve, *, dots: bool = False) -> None:
    """Draw an agent's line over its seeds, their range as a band and, where asked for, a dot per seed."""
    x, y = curve
    there = np.isfinite(y).any(axis=0)
    if not there.any():
        return
    x, y = x[there], y[:, there]
    if len(y) > 1:
        ax.fill_between(
            x, np.nanmin(y, axis=0), np.nanmax(y, axis=0), color=look.colour, alpha=0.15, linewidth=0
        )
    if dots:
        for row in y:
            ax.plot(x, row, ".", color=look.colour, markersize=3.2, alpha=0.55, markeredgewidth=0)
    ax.plot(x, middle(y), color=look.colour, linestyle=look.linestyle)


def lines_sentence(agents: Sequence[Agent], *, dots: bool = False) -> str:
    """Return the sentence of a caption on lines, bands and dots."""
    most = max(len(agent.runs) for agent in agents)
    if most < 2:
        return " One training seed per agent."
    lines = "interquartile mean over training seeds" if most >= ROBUST else "mean over training seeds"
    few = any(len(agent.runs) < ROBUST for agent in agents)
    lines += " (the mean of fewer than four)" if most >= ROBUST and few else ""
    return f" Lines: {lines}; bands: their range{'; dots: the seeds' if dots else ''}."
