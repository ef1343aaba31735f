"""Figures over what a study searched: which keys mattered, each by itself, and all at once."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from auvbench.reporting.figures import style
from auvbench.reporting.figures.scene import Drawing
from auvbench.reporting.tuning import looks
from auvbench.tuning.outcome import Outcome, Trial
from auvbench.tuning.space import Dimension, share_of

PLACES = mpl.colormaps["viridis"].resampled(256)
"""dark is best"""


def importances(found: Outcome) -> Drawing | None:
    """How much each key tells the best trials from the others."""
    if not found.importances:
        return None
    shares = sorted(found.importances.items(), key=lambda item: item[1])
    figure = style.canvas(5.4, 0.9 + 0.28 * len(shares))
    ax = figure.subplots()
    ax.barh(
        [_short(key) for key, _ in shares], [100 * share for _, share in shares], color="#0072B2", height=0.62
    )
    for place, (_, share) in enumerate(shares):
        ax.text(100 * share, place, f" {100 * share:.0f}", va="center", fontsize=8)
    ax.set_xlabel("share of the importance, %")
    ax.grid(axis="y", visible=False)
    ax.set_xlim(0, 112 * max(share for _, share in shares) or 1)
    return Drawing(
        figure,
        "What mattered",
        "PED-ANOVA: how far the best trials' values of a key are from all trials' values, as a share over the keys. "
        f"From {len(looks.shown_of(found))} trials; of few, the order of the small shares means nothing.",
    )


def parallel(found: Outcome) -> Drawing | None:
    """All trials over all keys at once."""
    shown = looks.shown_of(found)
    dimensions = found.plan.dimensions
    if len(shown) < 3 or len(dimensions) < 2:
        return None
    figure = style.canvas(max(8.2, 1.1 * len(dimensions) + 1.0), 3.9)
    ax = figure.subplots()
    norm = Normalize(0, len(shown) - 1)
    for rank in range(len(shown) - 1, -1, -1):
        values = [share_of(d, shown[rank].params[d.key]) + _jitter(d, shown[rank].number) for d in dimensions]
        best = rank == 0
        ax.plot(
            range(len(dimensions)),
            values,
            color=looks.BEST if best else PLACES(norm(rank)),
            linewidth=2.4 if best else 0.9,
            alpha=1.0 if best else 0.75 - 0.5 * rank / len(shown),
            zorder=5 if best else 2,
        )
    for place, dimension in enumerate(dimensions):
        ax.axvline(place, color="#9aa5ab", linewidth=0.8, zorder=1)
        for share, text in _ticks(dimension):
            ax.text(
                place + 0.04,
                share,
                text,
                fontsize=7,
                va="center",
                zorder=6,
                bbox={"facecolor": "white", "alpha": 0.75, "edgecolor": "none", "pad": 0.6},
            )
    ax.set_xticks(range(len(dimensions)), [_wrapped(d.key) for d in dimensions], fontsize=8)
    ax.set_yticks([])
    ax.spines["left"].set_visible(False)
    ax.grid(visible=False)
    ax.set_xlim(-0.15, len(dimensions) - 0.55)
    bar = figure.colorbar(ScalarMappable(norm, PLACES), ax=ax, pad=0.01, fraction=0.03)
    bar.set_ticks([0, len(shown) - 1], labels=["2nd", f"{len(shown)}th"])
    bar.ax.invert_yaxis()
    bar.set_label("place in the study")
    return Drawing(
        figure,
        "All trials over all keys",
        "Each line is a trial; the thick one is the best. Choices are spread a little, so that lines do not hide each other.",
    )


def slices(found: Outcome) -> Drawing | None:
    """Each key by itself."""
    shown = looks.shown_of(found)
    if len(shown) < 3:
        return None
    measure, key = looks.telling(found)
    scale, label = looks.scaled(measure)
    dimensions = sorted(found.plan.dimensions, key=lambda d: -found.importances.get(d.key, 0.0))
    columns = min(3 if len(dimensions) <= 6 else 4, len(dimensions))
    rows = math.ceil(len(dimensions) / columns)
    figure = style.canvas(2.75 * columns if columns < 4 else 9.4, 2.1 * rows + 0.45)
    axes = figure.subplots(rows, columns, squeeze=False, sharey=True)
    bounds = looks.bounded([scale * trial.result[key] for trial in shown], measure)
    if bounds is not None:
        axes[0][0].set_ylim(*bounds)
    for ax, dimension in zip(axes.flat, dimensions, strict=False):
        _slice(ax, found, shown, dimension, lambda trial: looks.kept(scale * trial.result[key], bounds))
    for ax in axes.flat[len(dimensions) :]:
        ax.set_visible(False)
    for row in axes:
        row[0].set_ylabel(label)
    looks.rung_legend(
        figure, found, Line2D([], [], color=looks.BEST, marker="*", markersize=10, linestyle="", label="best")
    )
    return Drawing(
        figure,
        "Each key by itself",
        f"All trials over each searched key, the most important first; {looks.direction(measure)}. What another key did "
        f"at the same time is in the parallel coordinates.{looks.EDGE if bounds else ''}",
    )


def _slice(
    ax: Axes, found: Outcome, shown: Sequence[Trial], dimension: Dimension, height: Callable[[Trial], float]
) -> None:
    for rung, (colour, marker) in enumerate(looks.rung_look(found)):
        own = [trial for trial in shown if trial.rung == rung]
        ax.plot(
            [_place(dimension, trial) for trial in own],
            [height(trial) for trial in own],
            linestyle="",
            marker=marker,
            color=colour,
            markersize=4,
            alpha=0.75,
        )
    best = shown[0]
    ax.plot(
        _place(dimension, best),
        height(best),
        marker="*",
        color=looks.BEST,
        markersize=11,
        zorder=5,
        markeredgecolor="white",
        linestyle="",
    )
    if dimension.kind == "choice":
        ax.set_xticks(range(len(dimension.choices)), list(dimension.choices), fontsize=8)
        ax.set_xlim(-0.5, len(dimension.choices) - 0.5)
    else:
        low, high = dimension.low, dimension.high
        if dimension.log:
            ax.set_xscale("log")
            beyond = (high / low) ** 0.04
            ax.set_xlim(low / beyond, high * beyond)
            ticks = _round_ticks(low, high)
            ax.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
            ax.minorticks_off()
        else:
            beyond = 0.04 * (high - low)
            ax.set_xlim(low - beyond, high + beyond)
            ax.xaxis.set_major_locator(MaxNLocator(4))
    ax.set_title(_short(dimension.key))


def _round_ticks(low: float, high: float) -> list[float]:
    """Powers of ten within a logarithmic range; with their doubles and fives where there are few."""
    exponents = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    for steps in ((1,), (1, 3), (1, 2, 5), (1, 1.5, 2, 3, 5, 7)):
        ticks = [step * 10.0**exponent for exponent in exponents for step in steps]
        within = [tick for tick in ticks if low * 0.999 <= tick <= high * 1.001]
        if len(within) >= 3:
            break
    return within if len(within) <= 4 else within[:: math.ceil(len(within) / 4)]


def _place(dimension: Dimension, trial: Trial) -> float:
    value = trial.params[dimension.key]
    if dimension.kind == "choice":
        return dimension.choices.index(str(value)) + 3 * _jitter(dimension, trial.number)
    return float(value)


def _jitter(dimension: Dimension, number: int) -> float:
    """A little of its own for each trial of a choice, the same in every drawing."""
    if dimension.kind != "choice":
        return 0.0
    return 0.08 * (math.modf(number * 0.6180339887)[0] - 0.5)


def _ticks(dimension: Dimension) -> list[tuple[float, str]]:
    if dimension.kind == "choice":
        return [(share_of(dimension, choice), choice) for choice in dimension.choices]
    shares = np.linspace(0, 1, 3)
    low, high = dimension.low, dimension.high
    if dimension.log:
        values = np.exp(math.log(low) + shares * (math.log(high) - math.log(low)))
    else:
        values = low + shares * (high - low)
    return [(float(share), f"{value:.3g}") for share, value in zip(shares, values, strict=True)]


def _short(key: str) -> str:
    return key.partition(".")[2]


def _wrapped(key: str) -> str:
    """In two lines where it is long."""
    words = _short(key).split("_")
    if len(_short(key)) < 10 or len(words) == 1:
        return _short(key)
    middle = math.ceil(len(words) / 2)
    return "_".join(words[:middle]) + "_\n" + "_".join(words[middle:])
