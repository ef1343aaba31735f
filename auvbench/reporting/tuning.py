"""Write the report of a tuning study: all trials as CSV, Optuna's figures, and the findings as sentences."""

from __future__ import annotations

import math
import warnings
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import optuna
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import LogLocator, NullLocator
from optuna.study import Study
from optuna.trial import TrialState, create_trial
from optuna.visualization import matplotlib as plots

from auvbench.analysis.formatting import amount, counted, difference, listed, name
from auvbench.analysis.measures import Measure
from auvbench.reporting.figures import style
from auvbench.reporting.write import text
from auvbench.statistics.typical import FEWEST, trainings_needed
from auvbench.tuning.controller import worth
from auvbench.tuning.outcome import Gain, Outcome, state_of
from auvbench.tuning.search import ERROR
from auvbench.untrusted import path_safety


def report(outcome: Outcome) -> Path:
    """Write trials.csv and the figures into the study's folder report/, and return the path of trials.csv.

    Raises:
        OSError: a file cannot be written.
    """
    folder = outcome.folder.report
    path_safety.check_output(folder, ("trials.csv", "figures"))
    draw(outcome, folder)
    return text(folder / "trials.csv", table(outcome).to_csv(index=False, lineterminator="\n"))


def table(outcome: Outcome) -> pd.DataFrame:
    """Return a table with one row per trial, best first."""
    keys = [dimension.key for dimension in outcome.plan.dimensions]
    names = (outcome.objective.measure.name, "low", "high", outcome.objective.then.name)
    rows = []
    for place, trial in enumerate(outcome.ordered, 1):
        row: dict[str, Any] = {"place": place, "trial": trial.number, "state": state_of(trial)}
        row["steps"] = (trial.last_step or 0) if outcome.plan.learns else 0
        if shown := outcome.results(trial):
            last = shown[-1]
            row |= zip(names, (last.objective, last.low, last.high, last.then), strict=True)
        rows.append(
            row
            | {key: trial.params.get(key, "") for key in keys}
            | {"error": str(trial.user_attrs.get(ERROR, ""))}
        )
    return pd.DataFrame(rows, columns=["place", "trial", "state", "steps", *names, *keys, "error"])


def summary(outcome: Outcome) -> list[str]:
    """Return the findings of the study as sentences, the most important first."""
    lines = [gain(outcome)] if outcome.gains else []
    if outcome.broken:
        lines.append(broken(outcome))
    if outcome.best is not None:
        lines.append(
            f"Best in the search: trial {outcome.best.number}, {worth(outcome.results(outcome.best)[-1], outcome.objective)}, on the "
            "validation scenarios that chose it. So this value is optimistic (selection bias)."
        )
    counts = Counter(state_of(trial) for trial in outcome.trials)
    states = [f"{count} {state}" for state, count in sorted(counts.items())]
    trained = f" Trained: {outcome.steps:,} environment steps." if outcome.steps else ""
    lines.append(f"{counted(len(outcome.trials), 'trial')}: {', '.join(states) or 'none'}.{trained}")
    if shares := sorted(outcome.importances.items(), key=lambda item: -item[1]):
        lines.append(f"Importance: {listed([f'{key} {100 * share:.0f} %' for key, share in shares])}.")
    if edges := at_the_edge(outcome):
        lines.append(edges)
    if budgets := outcome.uninformative:
        later = [str(budget) for budget in outcome.plan.budgets if budget > budgets[-1]]
        lines.append(
            f"After {budgets[-1]:,} steps all trials have the same score, so their pruning chose nothing. Use larger budgets: "
            f"tune.rungs=[{','.join(later)}]"
        )
    return lines


def at_the_edge(outcome: Outcome) -> str:
    """Return a sentence on the best trial's values that are at an end of their range; '' without such values."""
    if outcome.best is None:
        return ""
    params = outcome.best.params
    near = [f"{d.key} ({d.text})" for d in outcome.plan.dimensions if d.at_end(params[d.key])]
    if not near:
        return ""
    return f"At an end of the range: {listed(near, 4)}. A wider range may contain better settings."


def gain(outcome: Outcome) -> str:
    """Return a sentence that compares the best and the untuned settings on scenarios and seeds outside the search."""
    seeds = len(outcome.plan.tune.fresh_seeds)
    on = f"{seeds} fresh training seeds and " if outcome.plan.learns and seeds > 1 else ""
    parts = [
        f"{name(of.measure)}: {amount(of.tuned, of.measure)} tuned, {amount(of.untuned, of.measure)} untuned, "
        f"difference {difference(of.difference, of.measure)}, {verdict(of)}"
        for of in outcome.gains
    ]
    return f"On {on}fresh validation scenarios: {'; '.join(parts)}."


def verdict(of: Gain) -> str:
    """Return the verdict on the tuned settings against the untuned settings, with the reliability.

    The verdict is "better" or "worse" if the interval of the difference excludes zero, otherwise "not resolved". With
    fewer than `FEWEST` fresh seeds, the text says that no verdict is possible.
    """
    r = of.reliability
    reliability_text = f" ({r.count} of {r.trainings} tuned trainings are not behind)" if r else ""
    if 0 < of.trainings < FEWEST:
        return f"no verdict below {FEWEST} fresh seeds{reliability_text}"
    if not (of.difference.low > 0 or of.difference.high < 0):
        return f"not resolved{reliability_text}"
    star = "*" if 0 < of.trainings < trainings_needed() else ""
    return f"{'better' if of.difference.value * of.measure.sign > 0 else 'worse'}{star}{reliability_text}"


def broken(outcome: Outcome) -> str:
    """Return a sentence on the failed trainings with fresh seeds."""
    return f"With fresh seeds {counted(len(outcome.broken), 'training')} failed, so no gain is shown: {listed(outcome.broken, 3)}."


def evidence(outcome: Outcome) -> str:
    """Return the sentence on the gain from tuning for the header of the preset."""
    if outcome.broken:
        return broken(outcome)
    return (
        gain(outcome)
        if outcome.gains
        else "Not compared with fresh seeds: its result in the search is optimistic (selection bias)."
    )


COLUMNS = 4
"""largest number of panels in a row"""


def draw(outcome: Outcome, out: Path) -> None:
    """Draw the figures for which the study has enough trials into `out`/figures, as PNG and SVG."""
    study, measure = in_units(outcome)
    label = f"{measure.name}, %" if measure.rate else measure.name
    drawn = {}
    with style.styled(), plt.ioff(), warnings.catch_warnings():
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
        if outcome.complete > 1:
            drawn["history"] = _history(study, label)
        if outcome.complete > 2:
            drawn["slices"] = _slices(study, label)
        if any(len(trial.intermediate_values) > 1 for trial in study.trials):
            drawn["rungs"] = _rungs(study, label, outcome.plan.budgets)
        for name, canvas in drawn.items():
            style.save(canvas, out / "figures" / name)
            plt.close(canvas)


def in_units(outcome: Outcome) -> tuple[Study, Measure]:
    """Return an Optuna study of the trials with values of one measure, in the measure's unit, and the measure.

    The measure is the first objective if it distinguishes the trials, otherwise the second objective. The first
    objective does not distinguish the trials if more than half of the trials with the best trial's budget have the
    same value.
    """
    best = outcome.best
    peers = [trial for trial in outcome.trials if best and trial.last_step == best.last_step]
    tops = [outcome.results(trial)[-1].objective for trial in peers]
    second = len(tops) > 1 and 2 * max(Counter(tops).values()) > len(tops)
    measure = outcome.objective.then if second else outcome.objective.measure
    study = optuna.create_study(direction="maximize" if measure.higher_is_better else "minimize")
    for trial in sorted(outcome.trials, key=lambda trial: trial.number):
        values = [
            measure.scale * (score.then if second else score.objective) for score in outcome.results(trial)
        ]
        complete = trial.state is TrialState.COMPLETE and math.isfinite(values[-1])
        study.add_trial(
            create_trial(
                state=TrialState.COMPLETE if complete else TrialState.PRUNED,
                value=values[-1] if complete else None,
                params={_short(key): value for key, value in trial.params.items()},
                distributions={_short(key): value for key, value in trial.distributions.items()},
                intermediate_values=dict(zip(outcome.plan.budgets, values, strict=False)),
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
    plot = plots.plot_slice(study, target_name=label)
    panels: list[Axes] = [plot] if isinstance(plot, Axes) else list(plot)
    figure = panels[0].get_figure()
    assert isinstance(figure, Canvas)
    for extra in [ax for ax in figure.axes if ax not in panels]:  # remove the colour bar of trial numbers
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
    """Return the figure of the panels in the style of the report's other figures, without Optuna's titles."""
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
