"""The findings of a study in sentences."""

from __future__ import annotations

from collections import Counter

from auvbench.analysis.formatting import amount, counted, difference, listed, name
from auvbench.analysis.measures import Measure
from auvbench.statistics.estimate import Estimate
from auvbench.tuning.outcome import Fresh, Outcome, state_of
from auvbench.tuning.view import plain, worth


def summary(found: Outcome) -> list[str]:
    """Return the findings, the most important first."""
    lines = [fresh(found, found.fresh)] if found.fresh is not None else []
    if found.broken:
        lines.append(broken(found))
    if found.best is not None:
        lines.append(
            f"Best in the search: trial {found.best.number}, {worth(found.results(found.best)[-1], found.objective)}, on the "
            "validation scenarios that chose it. The best of many trials is partly lucky."
        )
    counts = Counter(state_of(trial) for trial in found.trials)
    states = [f"{count} {state}" for state, count in sorted(counts.items())]
    trained = f" Trained: {found.steps:,} environment steps." if found.steps else ""
    lines.append(f"{len(found.trials)} trials: {', '.join(states) or 'none'}.{trained}")
    if edges := at_the_edge(found):
        lines.append(edges)
    return lines


def at_the_edge(found: Outcome) -> str:
    """Name the best values at an end of their range; return '' for none."""
    if found.best is None:
        return ""
    params = found.best.params
    near = [f"{d.key} ({d.text})" for d in found.plan.dimensions if d.at_end(params[d.key])]
    if not near:
        return ""
    return f"At an end of the range: {listed(near, 4)}. A wider range may hold better settings."


def fresh(found: Outcome, at: Fresh) -> str:
    """Compare the best and the untuned settings on what the search has not seen."""
    measure, then = found.objective.measure, found.objective.then
    on = f"{len(at.seeds)} fresh training seeds and " if found.plan.learns and len(at.seeds) > 1 else ""
    return (
        f"On {on}fresh validation scenarios: {name(measure)} {amount(at.tuned, measure)} tuned, "
        f"{amount(at.untuned, measure)} untuned; {_compared(at.difference, measure)}. "
        f"{name(then)}: {plain(at.then[0], then)} tuned, {plain(at.then[1], then)} untuned; "
        f"{_compared(at.then_difference, then)}."
    )


def _compared(of: Estimate, measure: Measure) -> str:
    return f"difference {difference(of, measure)}, {verdict(of, measure)}"


def verdict(of: Estimate, measure: Measure) -> str:
    """Return better, worse or not resolved: whether the interval of tuned less untuned excludes zero."""
    if of.low > 0 or of.high < 0:
        return "better" if of.value * measure.sign > 0 else "worse"
    return "not resolved"


def broken(found: Outcome) -> str:
    """Name the trainings with fresh seeds that failed."""
    return f"With fresh seeds {counted(len(found.broken), 'training')} failed, so no gain is shown: {listed(found.broken, 3)}."


def evidence(found: Outcome) -> str:
    """Return the sentence for the header of the preset."""
    if found.broken:
        return broken(found)
    if found.fresh is None:
        return "Not trained with fresh seeds yet: its result in the search is partly lucky."
    return fresh(found, found.fresh)
