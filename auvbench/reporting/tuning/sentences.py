"""The findings of a study in sentences."""

from __future__ import annotations

from collections import Counter

from auvbench.analysis.formatting import amount, counted, difference, listed, named
from auvbench.analysis.measures import Measure
from auvbench.statistics.intervals import Estimate
from auvbench.tuning.controller import worth
from auvbench.tuning.outcome import Outcome, state_of


def summary(found: Outcome) -> list[str]:
    """Return the findings, the most important first."""
    lines = [gain(found)] if found.gains else []
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
    lines.append(f"{counted(len(found.trials), 'trial')}: {', '.join(states) or 'none'}.{trained}")
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


def gain(found: Outcome) -> str:
    """Compare the best and the untuned settings on what the search has not seen."""
    seeds = len(found.plan.tune.fresh_seeds)
    on = f"{seeds} fresh training seeds and " if found.plan.learns and seeds > 1 else ""
    parts = [
        f"{named(of.tuned, of.measure)} tuned, {amount(of.untuned, of.measure)} untuned, "
        f"difference {difference(of.difference, of.measure)}, {verdict(of.difference, of.measure)}"
        for of in found.gains
    ]
    return f"On {on}fresh validation scenarios: {'; '.join(parts)}."


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
    return (
        gain(found)
        if found.gains
        else "Not compared with fresh seeds: its result in the search is partly lucky."
    )
