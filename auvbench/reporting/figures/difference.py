"""Draw the main figure: each agent's difference from the baseline, with its interval and verdict."""

from __future__ import annotations

import math
import textwrap
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import NullLocator

from auvbench.analysis.formatting import name, size, unit_of_difference
from auvbench.analysis.measures import measure
from auvbench.analysis.primary import AHEAD, BEHIND, EQUIVALENT, OPEN
from auvbench.analysis.records import Against, Primary
from auvbench.reporting.figures import style
from auvbench.reporting.figures.scene import Drawing, Scene


class Look(NamedTuple):
    """Colour and marker of a verdict. The marker alone identifies the verdict, for readers who do not see colours."""

    colour: str
    marker: str
    filled: bool = True


LOOKS = {
    AHEAD: Look("#009E73", "^"),
    EQUIVALENT: Look("#0072B2", "s"),
    BEHIND: Look("#D55E00", "v"),
    OPEN: Look("#6b6b6b", "o", filled=False),
}
"""looks of the verdicts; colours from Okabe and Ito (2008)"""

AXIS, LETTER, LINE = 2.6, 0.075, 0.19
"""width of the axis, width of a letter, and height of a line of an agent's name, inches"""
LETTERS = 72
"""largest number of letters in a line of an agent's name"""
BAND = "#e4e4e4"
"""colour of the margin, different from the colours of the verdicts"""
NARROW = 0.04
"""Smallest share of a linear axis that the margin's band may take; if the share is smaller, the axis is logarithmic
beyond twice the margin
"""


def difference_from_baseline(scene: Scene) -> Drawing | None:
    """Draw one row per agent, best first, with its difference and interval; return None if no agent is compared."""
    primary = scene.ranking.primary
    if primary is None:
        return None
    m = measure(primary.measure)
    rows = [primary.of(row.label) or row.label for row in scene.ranking.rows]
    labels = [_label(row) if isinstance(row, Against) else f"{row} (baseline)" for row in rows]
    labels = [textwrap.fill(label, LETTERS, break_long_words=False) for label in labels]
    width = AXIS + LETTER * max(len(line) for label in labels for line in label.split("\n"))
    heights = np.array([1 + label.count("\n") for label in labels])
    places = np.cumsum(heights) - (heights + 1) / 2  # centre of each row, counted in text lines
    figure = style.canvas(max(4.55, width), 0.9 + LINE * heights.sum())
    ax = figure.subplots()
    margin = m.scale * primary.margin if math.isfinite(primary.margin) else 0.0
    low, high = _axis(primary, m.scale, margin)
    logarithmic = 0 < 2 * margin < NARROW * (high - low)
    if logarithmic:
        ax.set_xscale("symlog", linthresh=2 * margin, linscale=0.6)
        low, high = (end + math.copysign(0.3 * abs(end), end) for end in (low, high))
        ax.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
        ax.xaxis.set_minor_locator(NullLocator())
    if margin:
        ax.axvspan(-margin, margin, color=BAND, linewidth=0)
    ax.axvline(0, color="#444444", linewidth=0.9)
    for y, row in zip(places, rows, strict=True):
        if isinstance(row, Against):
            _line(ax, row, y, m.scale, (low, high))
        else:
            ax.plot(0, y, marker="|", color="#222222", markersize=9, markeredgewidth=2)
    ax.set_yticks(places, labels)
    ax.set_ylim(heights.sum() - 0.4, -0.6)
    ax.set_xlim(low, high)
    if logarithmic:  # remove the ticks near zero, because their labels would overlap
        ax.set_xticks([tick for tick in ax.get_xticks() if tick == 0 or abs(tick) >= 2 * margin])
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
    has_intervals = any(math.isfinite(c.difference.low) for c in primary.comparisons)
    covers = f"with intervals that hold together with {100 * primary.confidence:g} %"
    covers = covers if has_intervals else "of too few trainings for intervals"
    caption = f"Differences in {name(m)} from {primary.baseline} {covers}.{_of_learners(primary)}"
    if margin and not has_intervals:
        caption += f" Grey: the margin, ±{size(primary.margin, m)}."
    elif margin:
        caption += (
            f" Grey: the margin, ±{size(primary.margin, m)}. Equivalent: the interval lies within the margin. Ahead or behind: it "
            "excludes zero and reaches beyond the margin."
        )
    if logarithmic:
        caption += f" The axis is linear to {size(2 * primary.margin, m)} and logarithmic beyond."
    return Drawing(figure, f"Difference from {primary.baseline}", caption)


def _of_learners(primary: Primary) -> str:
    """Return the caption's sentences on the rows of learners and on verdicts from few trainings."""
    if not any(c.reliability for c in primary.comparisons):
        return ""
    text = " Learners: the typical training; on the right, the trainings that are not behind."
    if any(c.starred for c in primary.comparisons):
        text += " * From few trainings: the verdict assumes that trainings cluster around the typical one."
    return text


def _label(against: Against) -> str:
    """Return the agent's label, with a star if its verdict is from few trainings."""
    return f"{against.agent} *" if against.starred else against.agent


def _face(look: Look) -> str:
    return look.colour if look.filled else "white"


def _line(ax: Axes, against: Against, y: float, scale: float, ends: tuple[float, float]) -> None:
    look = LOOKS[against.verdict]
    difference = against.difference
    left, right = max(scale * difference.low, ends[0]), min(scale * difference.high, ends[1])
    if math.isfinite(difference.low) and right > left:
        ax.plot([left, right], [y, y], color=look.colour, linewidth=1.8, solid_capstyle="butt")
    ax.plot(
        scale * difference.value,
        y,
        marker=look.marker,
        color=look.colour,
        markerfacecolor=_face(look),
        markersize=5.5,
    )
    if own := against.own_reliability:
        ax.annotate(
            f"{own.count} of {own.trainings}",
            (1.0, y),
            (5, 0),
            xycoords=("axes fraction", "data"),
            textcoords="offset points",
            va="center",
            fontsize="small",
            annotation_clip=False,
        )


def _axis(primary: Primary, scale: float, margin: float) -> tuple[float, float]:
    """Return the limits of an axis that shows zero, the margin and each agent's difference with its interval."""
    ends = np.array([[c.difference.low, c.difference.value, c.difference.high] for c in primary.comparisons])
    ends = scale * ends[np.isfinite(ends)]
    low, high = np.min(ends, initial=-1.5 * margin), np.max(ends, initial=1.5 * margin)
    edge = 0.04 * (high - low) or 1.0
    return float(low - edge), float(high + edge)
