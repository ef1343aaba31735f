"""Figures over the trials of a study: in the order in which they were begun, and from rung to rung."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from auvbench.reporting.figures import style
from auvbench.reporting.figures.scene import Drawing
from auvbench.reporting.tuning import looks
from auvbench.tuning.outcome import Outcome, Trial


def history(found: Outcome) -> Drawing | None:
    """Every trial in the order in which it was begun, and the best so far."""
    shown = sorted(looks.shown_of(found), key=lambda trial: trial.number)
    if len(shown) < 2:
        return None
    measure, key = looks.telling(found)
    scale, label = looks.scaled(measure)
    figure = style.canvas(5.4, 3.4)
    ax = figure.subplots()
    bounds = looks.bounded([scale * trial.result[key] for trial in shown], measure)
    if bounds is not None:
        ax.set_ylim(*bounds)
    for rung, (colour, marker) in enumerate(looks.rung_look(found)):
        own = [trial for trial in shown if trial.rung == rung]
        ax.plot(
            [trial.number for trial in own],
            [looks.kept(scale * trial.result[key], bounds) for trial in own],
            linestyle="",
            marker=marker,
            color=colour,
            markersize=4 if len(shown) > 40 else 5,
            clip_on=bounds is None,
        )
    numbers, values = _best_so_far(found, shown, key)
    ax.step(numbers, [scale * value for value in values], where="post", color=looks.BEST, linewidth=1.3)
    ax.set_xlabel("trial")
    ax.set_ylabel(label)
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    looks.rung_legend(figure, found, Line2D([], [], color=looks.BEST, label="best so far"))
    where = " at the last budget that it was given" if len(found.budgets) > 1 else ""
    return Drawing(
        figure,
        "Search history",
        f"Each mark is a trial{where}, on the validation scenarios that decide; {looks.direction(measure)}. "
        f"Best so far: of the trials with the largest budget yet.{looks.EDGE if bounds else ''}",
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


def climbing(found: Outcome) -> Drawing | None:
    """What every trial showed at each rung."""
    shown = looks.shown_of(found)
    if len(found.budgets) < 2 or not any(len(trial.results) > 1 for trial in shown):
        return None
    measure, key = looks.telling(found)
    scale, label = looks.scaled(measure)
    figure = style.canvas(5.4, 3.4)
    ax = figure.subplots()
    for trial in reversed(shown):
        rungs = sorted(trial.results)
        best = trial is shown[0]
        ax.plot(
            [found.budgets[rung] for rung in rungs],
            [scale * trial.results[rung][key] for rung in rungs],
            color=looks.BEST if best else "#7f8c94",
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
        f"Each line is a trial from rung to rung, {looks.direction(measure)}; it goes on from its own last checkpoint. "
        "Coloured: the best.",
    )
