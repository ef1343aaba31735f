"""Figures of a study, by `optuna.visualization.matplotlib`: history, each key alone, and rungs."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import optuna
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import LogLocator, NullLocator
from optuna.study import Study
from optuna.trial import TrialState, create_trial
from optuna.visualization import matplotlib as plots

from auvbench.analysis.measures import Measure
from auvbench.reporting.figures import Figure, style
from auvbench.tuning.outcome import Outcome

COLUMNS = 4
"""panels in a row"""


def draw(found: Outcome, out: Path) -> list[Figure]:
    """Draw the figures that the study has enough trials for into `out`/figures, as PNG and SVG."""
    study, measure = in_units(found)
    label = f"{measure.name}, %" if measure.rate else measure.name
    better = f"{'Higher' if measure.higher_is_better else 'Lower'} is better."
    drawn = []
    with style.styled(), plt.ioff(), warnings.catch_warnings():
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
        if found.complete > 1:
            caption = f"Trials with the whole budget, and the best so far. {better}"
            drawn.append(("history", "Search history", caption, _history(study, label)))
        if found.complete > 2:
            caption = f"Trials with the whole budget over each key. {better}"
            drawn.append(("slices", "Each key alone", caption, _slices(study, label)))
        if any(len(trial.intermediate_values) > 1 for trial in study.trials):
            caption = f"A line per trial over the environment steps of its training. {better}"
            drawn.append(("rungs", "Rungs", caption, _rungs(study, label, found.plan.budgets)))
        figures = []
        for name, title, caption, canvas in drawn:
            png, svg = style.save(canvas, out / "figures" / name)
            plt.close(canvas)
            figures.append(Figure(name, title, caption, png, svg))
    return figures


def in_units(found: Outcome) -> tuple[Study, Measure]:
    """Return the study in the unit of the measure that tells its trials apart, and that measure.

    The second measure takes over where more than half of the trials with the best trial's budget tie in the first.
    """
    best = found.best
    peers = [trial for trial in found.trials if best and trial.last_step == best.last_step]
    tops = [found.results(trial)[-1].objective for trial in peers]
    second = bool(tops) and 2 * tops.count(tops[0]) > len(tops) > 1
    measure = found.objective.then if second else found.objective.measure
    study = optuna.create_study(direction="maximize" if measure.higher_is_better else "minimize")
    for trial in sorted(found.trials, key=lambda trial: trial.number):
        values = [
            (100 if measure.rate else 1) * (score.then if second else score.objective)
            for score in found.results(trial)
        ]
        complete = trial.state is TrialState.COMPLETE and math.isfinite(values[-1])
        study.add_trial(
            create_trial(
                state=TrialState.COMPLETE if complete else TrialState.PRUNED,
                value=values[-1] if complete else None,
                params={_short(key): value for key, value in trial.params.items()},
                distributions={_short(key): value for key, value in trial.distributions.items()},
                intermediate_values=dict(zip(found.plan.budgets, values, strict=False)),
            )
        )
    return study, measure


def _short(key: str) -> str:
    return key.partition(".")[2]


def _history(study: Study, label: str) -> Canvas:
    ax = plots.plot_optimization_history(study, target_name=label)
    ax.legend(loc="best")
    return _restyled([ax], 5.4, 3.4)


def _slices(study: Study, label: str) -> Canvas:
    found = plots.plot_slice(study, target_name=label)
    panels: list[Axes] = [found] if isinstance(found, Axes) else list(found)
    figure = panels[0].get_figure()
    assert isinstance(figure, Canvas)
    for extra in [ax for ax in figure.axes if ax not in panels]:  # the colour bar of trial numbers
        extra.remove()
    columns = min(COLUMNS, len(panels))
    rows = -(-len(panels) // columns)
    grid = figure.add_gridspec(rows, columns)
    for place, ax in enumerate(panels):
        ax.set_subplotspec(grid[place])
        if ax.get_xscale() == "log":
            low, high = ax.get_xlim()
            ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 3.0) if high < 100 * low else (1.0,)))
            ax.xaxis.set_minor_locator(NullLocator())
            ax.xaxis.set_major_formatter("{x:g}")
        ax.set_ylabel(label if place % columns == 0 else "")
    return _restyled(panels, 2.35 * columns, 2.1 * rows)


def _rungs(study: Study, label: str, budgets: Sequence[int]) -> Canvas:
    ax = plots.plot_intermediate_values(study)
    if legend := ax.get_legend():
        legend.remove()
    ax.set_xscale("log")
    ax.set_xticks(budgets, [f"{budget:,}" for budget in budgets])
    ax.xaxis.set_minor_locator(NullLocator())
    ax.set_xlabel("environment steps of training")
    ax.set_ylabel(label)
    return _restyled([ax], 5.4, 3.4)


def _restyled(panels: Sequence[Axes], width: float, height: float) -> Canvas:
    """Return the figure in the style of the other figures, without Optuna's titles."""
    figure = panels[0].get_figure()
    assert isinstance(figure, Canvas)
    figure.suptitle("")
    for ax in panels:
        ax.set_title("")
        ax.set_facecolor("white")
        ax.grid(color="#dddddd")
    figure.set_size_inches(width, height)
    figure.set_dpi(style.DPI)
    figure.set_layout_engine("constrained")
    return figure
