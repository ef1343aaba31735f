"""The main figure: each agent's difference from the baseline, with its interval and verdict."""

from __future__ import annotations

import math
import textwrap
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from auvbench.analysis.formatting import name, size, unit_of_difference
from auvbench.analysis.measures import measure
from auvbench.analysis.primary import AHEAD, BEHIND, EQUIVALENT, OPEN
from auvbench.analysis.records import Against, Primary
from auvbench.reporting.figures import style
from auvbench.reporting.figures.scene import Drawing, Scene


class Look(NamedTuple):
    """How a verdict is drawn: colour and shape both tell it."""

    colour: str
    marker: str
    filled: bool = True


LOOKS = {
    AHEAD: Look("#009E73", "^"),
    EQUIVALENT: Look("#0072B2", "s"),
    BEHIND: Look("#D55E00", "v"),
    OPEN: Look("#6b6b6b", "o", filled=False),
}
"""colours of Okabe and Ito (2008)"""

AXIS, LETTER, LINE = 2.6, 0.075, 0.19
"""inches of the axis, and of a letter and a line of an agent's name"""
LETTERS = 72
"""of a line"""
COMMON = 0.85
"""share of the agents whose intervals the axis holds whole; the others are cut and marked by an arrow"""


def difference_from_baseline(scene: Scene) -> Drawing | None:
    """Draw a line per agent, best first; None where nothing is compared."""
    primary = scene.ranking.primary
    if primary is None:
        return None
    m = measure(primary.measure)
    rows = [primary.of(row.label) or row.label for row in scene.ranking.rows]
    labels = [row.agent if isinstance(row, Against) else f"{row} (baseline)" for row in rows]
    labels = [textwrap.fill(label, LETTERS, break_long_words=False) for label in labels]
    width = AXIS + LETTER * max(len(line) for label in labels for line in label.split("\n"))
    heights = np.array([1 + label.count("\n") for label in labels])
    places = np.cumsum(heights) - (heights + 1) / 2  # middles of rows, in lines
    figure = style.canvas(max(4.55, width), 0.9 + LINE * heights.sum())
    ax = figure.subplots()
    low, high = _axis(primary, m.scale)
    if math.isfinite(primary.margin):
        ax.axvspan(
            -m.scale * primary.margin, m.scale * primary.margin, color="#0072B2", alpha=0.1, linewidth=0
        )
    ax.axvline(0, color="#444444", linewidth=0.9)
    for y, row in zip(places, rows, strict=True):
        if isinstance(row, Against):
            _line(ax, row, y, m.scale, (low, high))
        else:
            ax.plot(0, y, marker="|", color="#222222", markersize=9, markeredgewidth=2)
    ax.set_yticks(places, labels)
    ax.set_ylim(heights.sum() - 0.4, -0.6)
    ax.set_xlim(low, high)
    ax.grid(axis="y", visible=False)
    better = "right" if m.higher_is_better else "left"
    ax.set_xlabel(f"{name(m)}: difference ({unit_of_difference(m).strip()})\n{better} is better")
    handles = [
        Line2D([], [], color=look.colour, marker=look.marker, markerfacecolor=_face(look), label=verdict)
        for verdict, look in LOOKS.items()
        if primary.having(verdict)
    ]
    figure.legend(handles=handles, loc="outside upper right", ncols=len(handles), handlelength=2.2)
    within = (
        f" Blue: within the margin of {size(primary.margin, m)}." if math.isfinite(primary.margin) else ""
    )
    caption = (
        f"Differences in {name(m)} from {primary.baseline} with intervals that hold together with "
        f"{100 * primary.confidence:g} %.{within} An arrow: the interval goes on."
    )
    return Drawing(figure, f"Difference from {primary.baseline}", caption)


def _face(look: Look) -> str:
    return look.colour if look.filled else "white"


def _line(ax: Axes, against: Against, y: float, scale: float, ends: tuple[float, float]) -> None:
    look = LOOKS[against.verdict]
    value, low, high = (
        scale * x for x in (against.difference.value, against.difference.low, against.difference.high)
    )
    left, right = max(low, ends[0]), min(high, ends[1])
    inset = 0.012 * (ends[1] - ends[0])
    if math.isfinite(low) and right > left:
        ax.plot([left, right], [y, y], color=look.colour, linewidth=1.8, solid_capstyle="butt")
    for beyond, at, arrow in (
        (min(low, value) < ends[0], ends[0] + inset, "<"),
        (max(high, value) > ends[1], ends[1] - inset, ">"),
    ):
        if beyond:
            ax.plot(at, y, marker=arrow, color=look.colour, markersize=5)
    if ends[0] <= value <= ends[1]:
        ax.plot(value, y, marker=look.marker, color=look.colour, markerfacecolor=_face(look), markersize=5.5)


def _axis(primary: Primary, scale: float) -> tuple[float, float]:
    """Return the ends of the axis: round zero and the margin, without the few widest intervals."""
    ends = np.array([[c.difference.low, c.difference.value, c.difference.high] for c in primary.comparisons])
    ends *= scale
    reach = np.nanmax(np.abs(ends), axis=1)
    reach = reach[np.isfinite(reach)]
    room = 1.5 * scale * primary.margin if math.isfinite(primary.margin) else 0.0
    most = max(float(np.quantile(reach, COMMON, method="lower")) if reach.size else 0.0, room) or 1.0
    low, high = np.nanmin(ends, initial=-room), np.nanmax(ends, initial=room)
    low, high = max(float(low), -most), min(float(high), most)
    edge = 0.04 * (high - low)
    return low - edge, high + edge
