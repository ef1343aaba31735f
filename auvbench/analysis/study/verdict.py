"""How a claim is judged: parts that hold, do not hold or cannot be said, and what they make together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from auvbench.analysis.effects import mean_difference
from auvbench.analysis.measures import measure
from auvbench.analysis.model import Agent, Finding
from auvbench.analysis.prose import amount, counted, difference, p_value
from auvbench.analysis.study.trend import Trend
from auvbench.statistics.estimate import Estimate

HOLDS, FAILS, OPEN = "holds", "does not hold", "cannot be said"


@dataclass(frozen=True, slots=True)
class Part:
    """One test of a claim."""

    verdict: str
    statistic: str = ""
    missing: str = ""
    run_ids: tuple[str, ...] = ()


def together(text: str, parts: Sequence[Part]) -> Finding:
    """A claim fails if one of its parts does, holds if all do, and cannot be said otherwise."""
    verdicts = [part.verdict for part in parts]
    verdict = FAILS if FAILS in verdicts else OPEN if OPEN in verdicts else HOLDS
    several = len(parts) > 1
    statistics = []
    for letter, part in zip("abcdef", parts, strict=False):
        if part.statistic:
            statistics.append(f"({letter}) {part.statistic}: {part.verdict}" if several else part.statistic)
    missing = [
        f"({letter}) {part.missing}" if several else part.missing
        for letter, part in zip("abcdef", parts, strict=False)
        if part.missing
    ]
    runs = tuple(dict.fromkeys(run for part in parts for run in part.run_ids))
    return Finding(text, verdict, _sentence(statistics), _sentence(missing), runs)


def _sentence(parts: Sequence[str]) -> str:
    text = "; ".join(parts)
    return f"{text[0].upper()}{text[1:]}." if text else ""


def by_interval(estimate: Estimate, above: float, *, less: bool = False) -> str:
    """Holds if the whole interval lies above a bound (`less`: below it), fails if it lies on the other side."""
    low, high = estimate.low, estimate.high
    if low > above:
        return FAILS if less else HOLDS
    if high < above:
        return HOLDS if less else FAILS
    return OPEN


def averaged(
    pairs: Sequence[tuple[Agent, Agent]], metric: str, what: str, confidence: float, absent: str
) -> Part:
    """A part that claims first > second in a measure, averaged over matched cells."""
    if not pairs:
        return Part(OPEN, missing=absent)
    m = measure(metric)
    estimate, _ = mean_difference(pairs, m, confidence)
    cells = counted(len(pairs), "matched cell")
    verdict = by_interval(estimate, 0.0)
    missing = more_seeds([agent for pair in pairs for agent in pair]) if verdict == OPEN else ""
    return Part(verdict, f"{what} {difference(estimate, m)} over {cells}", missing, runs_of(pairs))


def runs_of(pairs: Sequence[tuple[Agent, ...]]) -> tuple[str, ...]:
    """Ids of all runs behind some agents."""
    return tuple(dict.fromkeys(run.id for pair in pairs for agent in pair for run in agent.runs))


def more_seeds(agents: Sequence[Agent]) -> str:
    """What would resolve a difference that is not."""
    fewest = min(len(agent.outcome) for agent in agents)
    return f"an interval that excludes the bound; the fewest seeds of a cell are {fewest}"


def by_trend(found: Trend, what: str, confidence: float, ids: tuple[str, ...]) -> Part:
    """A part that claims a rising trend; two one-sided permutation tests."""
    alpha = (1 - confidence) / 2
    verdict = HOLDS if found.p_up < alpha else FAILS if found.p_down < alpha else OPEN
    interval = amount(found.estimate, measure("success_rate"))
    statistic = f"{what} {interval} of {counted(found.pairs, 'pair')} of runs, {p_value(min(1, 2 * min(found.p_up, found.p_down)))}"
    missing = "more training seeds per cell" if verdict == OPEN else ""
    return Part(verdict, statistic, missing, ids)
