"""Figures of a study: its history, its rungs, what mattered, and where the good trials lie."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize, to_hex
from matplotlib.figure import Figure as Canvas
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from auvbench.analysis.measures import Measure
from auvbench.reporting.figures import style
from auvbench.reporting.figures.model import Figure
from auvbench.reporting.figures.scene import Drawing
from auvbench.tuning.outcome import Outcome, Trial
from auvbench.tuning.space import Dimension, share_of

BEST = "#D55E00"
PLACES = mpl.colormaps["viridis"].resampled(256)
"""dark is best"""
BLUES = mpl.colormaps["Blues"]


def draw(found: Outcome, out: Path) -> list[Figure]:
    """Draws what the study allows into `out`/figures, PNG and SVG."""
    figures = []
    for name, drawn in FIGURES.items():
        with style.styled():
            drawing = drawn(found)
            if drawing is None:
                for suffix in (".png", ".svg"):
                    (out / "figures" / name).with_suffix(suffix).unlink(missing_ok=True)
                continue
            png, svg = style.save(drawing.canvas, out / "figures" / name)
        figures.append(Figure(name, drawing.title, drawing.caption, png, svg))
    return figures


def _shown(found: Outcome) -> list[Trial]:
    """Trials with a result, best first."""
    return [trial for trial in found.trials if trial.rung >= 0]


def telling(found: Outcome) -> tuple[Measure, str]:
    """The measure that tells trials apart, and its key in their results: the second where the first mostly ties.

    Trials that came as far as the best are looked at, if it has company: among them the study is decided.
    """
    shown = _shown(found)
    highest = [trial for trial in shown if trial.rung == shown[0].rung]
    values = [trial.result["objective"] for trial in (highest if len(highest) > 1 else shown)]
    ties = sum(value == values[0] for value in values)
    if 2 * ties > len(values):
        return found.objective.then, "then"
    return found.objective.measure, "objective"


def _bounded(values: Sequence[float], measure: Measure) -> tuple[float, float] | None:
    """Ends of an axis that leaves out trials far on the bad side of the others; None where there are none."""
    inner, outer = np.quantile(values, [0.1, 0.9])
    room = 1.5 * float(outer - inner)
    least, most = min(values), max(values)
    if room <= 0:
        return None
    if measure.higher_is_better:
        low, high = max(least, float(inner) - room), most
    else:
        low, high = least, min(most, float(outer) + room)
    if (low, high) == (least, most):
        return None
    margin = 0.05 * (high - low)
    return low - margin, high + margin


EDGE = " Marks on the edge lie beyond it."


def _scaled(measure: Measure) -> tuple[float, str]:
    return (100.0, f"{measure.name}, %") if measure.rate else (1.0, measure.name)


def _rung_look(found: Outcome) -> list[tuple[str, str]]:
    """Colour and marker of each rung: the more steps, the darker."""
    n = len(found.budgets)
    colours = ["#0072B2"] if n == 1 else [to_hex(BLUES(0.42 + 0.55 * i / (n - 1))) for i in range(n)]
    return [(colours[i], style.MARKERS[i % len(style.MARKERS)]) for i in range(n)]


def _rung_legend(figure: Canvas, found: Outcome, *more: Line2D) -> None:
    if len(found.budgets) == 1 and not more:
        return
    handles = list(more)
    if len(found.budgets) > 1:
        handles += [
            Line2D([], [], color=colour, marker=marker, linestyle="", label=f"{budget:,} steps")
            for (colour, marker), budget in zip(_rung_look(found), found.budgets, strict=True)
        ]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))


def history(found: Outcome) -> Drawing | None:
    """Every trial in the order in which it was begun, and the best so far."""
    shown = sorted(_shown(found), key=lambda trial: trial.number)
    if len(shown) < 2:
        return None
    measure, key = telling(found)
    scale, label = _scaled(measure)
    figure = style.canvas(5.4, 3.4)
    ax = figure.subplots()
    looks = _rung_look(found)
    bounds = _bounded([scale * trial.result[key] for trial in shown], measure)
    if bounds is not None:
        ax.set_ylim(*bounds)
    for rung, (colour, marker) in enumerate(looks):
        own = [trial for trial in shown if trial.rung == rung]
        ax.plot(
            [trial.number for trial in own],
            [_kept(scale * trial.result[key], bounds) for trial in own],
            linestyle="",
            marker=marker,
            color=colour,
            markersize=4 if len(shown) > 40 else 5,
            clip_on=bounds is None,
        )
    numbers, values = _best_so_far(found, shown, key)
    ax.step(numbers, [scale * value for value in values], where="post", color=BEST, linewidth=1.3)
    ax.set_xlabel("trial")
    ax.set_ylabel(label)
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    _rung_legend(figure, found, Line2D([], [], color=BEST, label="best so far"))
    where = " at the last budget that it was given" if len(found.budgets) > 1 else ""
    return Drawing(
        figure,
        "Search history",
        f"Each mark is a trial{where}, on the validation scenarios that decide; {_direction(measure)}. "
        f"Best so far: of the trials with the largest budget yet.{EDGE if bounds else ''}",
    )


def _best_so_far(found: Outcome, shown: Sequence[Trial], key: str) -> tuple[list[int], list[float]]:
    """At each trial the value of the best among those begun by then, in the study's order."""
    place = {trial.number: rank for rank, trial in enumerate(found.trials)}
    numbers, values = [], []
    best: Trial | None = None
    for trial in shown:
        if best is None or place[trial.number] < place[best.number]:
            best = trial
        numbers.append(trial.number)
        values.append(float(best.result[key]))
    return numbers, values


def _direction(measure: Measure) -> str:
    return "higher is better" if measure.higher_is_better else "lower is better"


def climbing(found: Outcome) -> Drawing | None:
    """What every trial showed at each rung."""
    shown = _shown(found)
    if len(found.budgets) < 2 or not any(len(trial.results) > 1 for trial in shown):
        return None
    measure, key = telling(found)
    scale, label = _scaled(measure)
    figure = style.canvas(5.4, 3.4)
    ax = figure.subplots()
    for trial in reversed(shown):
        rungs = sorted(trial.results)
        best = trial is shown[0]
        ax.plot(
            [found.budgets[rung] for rung in rungs],
            [scale * trial.results[rung][key] for rung in rungs],
            color=BEST if best else "#7f8c94",
            alpha=1.0 if best else 0.45,
            linewidth=2.0 if best else 1.0,
            marker="o",
            markersize=4 if best else 3,
            zorder=3 if best else 2,
        )
    ax.set_xscale("log")
    ax.set_xticks(found.budgets, [f"{budget:,}" for budget in found.budgets])
    ax.minorticks_off()
    ax.set_xlabel("environment steps of training")
    ax.set_ylabel(label)
    return Drawing(
        figure,
        "Rungs",
        f"Each line is a trial from rung to rung, {_direction(measure)}; it goes on from its own last checkpoint. "
        "Coloured: the best.",
    )


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
        f"From {len(_shown(found))} trials; of few, the order of the small shares means nothing.",
    )


def parallel(found: Outcome) -> Drawing | None:
    """All trials over all keys at once."""
    shown = _shown(found)
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
            color=BEST if best else PLACES(norm(rank)),
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
    shown = _shown(found)
    if len(shown) < 3:
        return None
    measure, key = telling(found)
    scale, label = _scaled(measure)
    dimensions = sorted(found.plan.dimensions, key=lambda d: -found.importances.get(d.key, 0.0))
    columns = min(3 if len(dimensions) <= 6 else 4, len(dimensions))
    rows = math.ceil(len(dimensions) / columns)
    figure = style.canvas(2.75 * columns if columns < 4 else 9.4, 2.1 * rows + 0.45)
    axes = figure.subplots(rows, columns, squeeze=False, sharey=True)
    bounds = _bounded([scale * trial.result[key] for trial in shown], measure)
    if bounds is not None:
        axes[0][0].set_ylim(*bounds)
    for ax, dimension in zip(axes.flat, dimensions, strict=False):
        _slice(ax, found, shown, dimension, lambda trial: _kept(scale * trial.result[key], bounds))
    for ax in axes.flat[len(dimensions) :]:
        ax.set_visible(False)
    for row in axes:
        row[0].set_ylabel(label)
    _rung_legend(
        figure, found, Line2D([], [], color=BEST, marker="*", markersize=10, linestyle="", label="best")
    )
    return Drawing(
        figure,
        "Each key by itself",
        f"All trials over each searched key, the most important first; {_direction(measure)}. What another key did "
        f"at the same time is in the parallel coordinates.{EDGE if bounds else ''}",
    )


def _kept(value: float, bounds: tuple[float, float] | None) -> float:
    return value if bounds is None else min(max(value, bounds[0]), bounds[1])


def _slice(
    ax: Axes, found: Outcome, shown: Sequence[Trial], dimension: Dimension, height: Callable[[Trial], float]
) -> None:
    for rung, (colour, marker) in enumerate(_rung_look(found)):
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
        color=BEST,
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


FIGURES: dict[str, Callable[[Outcome], Drawing | None]] = {
    "history": history,
    "importances": importances,
    "slices": slices,
    "parallel": parallel,
    "rungs": climbing,
}
"""by file name, in the order of the page; one that has nothing to show returns None"""
