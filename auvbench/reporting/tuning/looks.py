"""What the figures of a study share: which measure tells its trials apart, how rungs look, where an axis ends."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.colors import to_hex
from matplotlib.figure import Figure as Canvas
from matplotlib.lines import Line2D

from auvbench.analysis.measures import Measure
from auvbench.reporting.figures import style
from auvbench.tuning.outcome import Outcome, Trial

BEST = "#D55E00"
"""colour of the best trial"""
BLUES = mpl.colormaps["Blues"]


def shown_of(found: Outcome) -> list[Trial]:
    """Trials with a result, best first."""
    return [trial for trial in found.trials if trial.rung >= 0]


def telling(found: Outcome) -> tuple[Measure, str]:
    """The measure that tells trials apart, and its key in their results: the second where the first mostly ties.

    Trials that came as far as the best are looked at, if it has company: among them the study is decided.
    """
    shown = shown_of(found)
    highest = [trial for trial in shown if trial.rung == shown[0].rung]
    values = [trial.result["objective"] for trial in (highest if len(highest) > 1 else shown)]
    ties = sum(value == values[0] for value in values)
    if 2 * ties > len(values):
        return found.objective.then, "then"
    return found.objective.measure, "objective"


def bounded(values: Sequence[float], measure: Measure) -> tuple[float, float] | None:
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


def scaled(measure: Measure) -> tuple[float, str]:
    return (100.0, f"{measure.name}, %") if measure.rate else (1.0, measure.name)


def kept(value: float, bounds: tuple[float, float] | None) -> float:
    return value if bounds is None else min(max(value, bounds[0]), bounds[1])


def direction(measure: Measure) -> str:
    return "higher is better" if measure.higher_is_better else "lower is better"


def rung_look(found: Outcome) -> list[tuple[str, str]]:
    """Colour and marker of each rung: the more steps, the darker."""
    n = len(found.budgets)
    colours = ["#0072B2"] if n == 1 else [to_hex(BLUES(0.42 + 0.55 * i / (n - 1))) for i in range(n)]
    return [(colours[i], style.MARKERS[i % len(style.MARKERS)]) for i in range(n)]


def rung_legend(figure: Canvas, found: Outcome, *more: Line2D) -> None:
    if len(found.budgets) == 1 and not more:
        return
    handles = list(more)
    if len(found.budgets) > 1:
        handles += [
            Line2D([], [], color=colour, marker=marker, linestyle="", label=f"{budget:,} steps")
            for (colour, marker), budget in zip(rung_look(found), found.budgets, strict=True)
        ]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
