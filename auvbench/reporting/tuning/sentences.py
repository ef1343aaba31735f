"""What a study found, in sentences that its data generate."""

from __future__ import annotations

from auvbench.analysis import rounding
from auvbench.analysis.formatting import counted, listed
from auvbench.analysis.measures import Measure
from auvbench.reporting.page.numbers import duration
from auvbench.statistics.estimate import Estimate
from auvbench.tuning.outcome import Fresh, Outcome
from auvbench.tuning.space import share_of
from auvbench.tuning.view import amount, plain


def summary(found: Outcome) -> list[str]:
    """Most important first."""
    best = found.best
    lines = [fresh(found, found.fresh)] if found.fresh is not None else []
    if found.broken:
        lines.append(broken(found))
    if best is not None:
        result = best.result
        estimate = Estimate(result["objective"], result["low"], result["high"])
        lines.append(
            f"Best in the search: trial {best.number}, {amount(estimate, found.objective.measure)}, "
            f"{found.objective.then.name} {plain(result['then'], found.objective.then)}, on the validation scenarios that "
            "chose it: the best of many is lucky."
        )
    counts = {
        state: sum(t.state == state for t in found.trials)
        for state in ("done", "pruned", "waiting", "failed")
    }
    said = [f"{number} {_STATES[state]}" for state, number in counts.items() if number]
    lines.append(f"{len(found.trials)} trials: {', '.join(said) or 'none'}.")
    if found.learns and found.cost.steps:
        lines.append(cost(found))
    if edges := at_the_edge(found):
        lines.append(edges)
    return lines


def at_the_edge(found: Outcome) -> str:
    """Which of the best values lie at an end of what was searched; '' where none does."""
    if found.best is None:
        return ""
    near = []
    for dimension in found.plan.dimensions:
        if dimension.kind == "choice":
            continue
        share = share_of(dimension, found.best.params[dimension.key])
        if not NEAR < share < 1 - NEAR:
            near.append(f"{dimension.key} ({dimension.text})")
    if not near:
        return ""
    lies = "lies" if len(near) == 1 else "lie"
    return f"{listed(near, 4)} {lies} at an end of the range: a wider one may hold better settings."


NEAR = 0.02
"""share of a range that counts as its end"""


_STATES = {
    "done": "brought to the end",
    "pruned": "pruned",
    "waiting": "not finished",
    "failed": "failed",
}


def fresh(found: Outcome, at: Fresh) -> str:
    """Best against untuned, on what the search has not seen."""
    measure, then = found.objective.measure, found.objective.then
    on = f"{len(at.seeds)} fresh training seeds and " if found.learns and len(at.seeds) > 1 else ""
    text = f"On {on}fresh validation scenarios: tuned {amount(at.tuned, measure)}, untuned {amount(at.untuned, measure)}; "
    text += f"difference {_difference(at.difference, measure)}, {verdict(at.difference, measure)}. "
    text += f"{then.name}: {plain(at.then[0], then)} and {plain(at.then[1], then)}, difference "
    text += f"{_difference(at.then_difference, then)}, {verdict(at.then_difference, then)}."
    return text


def verdict(difference: Estimate, measure: Measure) -> str:
    """Better | worse | not resolved: whether the interval of tuned less untuned leaves out zero."""
    if difference.low > 0 or difference.high < 0:
        return "better" if difference.value * measure.sign > 0 else "worse"
    return "not resolved"


def _difference(of: Estimate, measure: Measure) -> str:
    value, low, high = rounding.rounded(of, 100.0 if measure.rate else 1.0)
    unit = " points" if measure.rate else ""
    return f"{value}{unit}" + (f" [{low}, {high}]" if low else "")


def cost(found: Outcome) -> str:
    """What was trained, and what promotions saved."""
    at = found.cost
    text = f"Trained: {at.steps:,} environment steps in {duration(at.seconds)} of training."
    if at.restarted > at.steps:
        saved = (at.restarted - at.steps) / at.restarted
        text += (
            f" Promoted trials went on where they stood: begun again at each rung they would have taken {at.restarted:,} "
            f"steps; {100 * saved:.0f} % of the steps, {duration(at.saved_seconds)}, were not trained twice."
        )
    return text


def broken(found: Outcome) -> str:
    """What failed with fresh seeds, so that nothing is known of the gain."""
    return f"With fresh seeds {counted(len(found.broken), 'training')} failed, so no gain is shown: {listed(found.broken, 3)}."


def evidence(found: Outcome) -> str:
    """For the header of the preset."""
    if found.broken:
        return broken(found)
    if found.fresh is None:
        return "Not yet trained with fresh seeds: what it showed in the search is lucky."
    return fresh(found, found.fresh)
