"""How a claim is judged: parts that hold, do not hold or cannot be said, and what they make together.

Of every claim, "holds" and "does not hold" are wrong with at most (1 - confidence)/2 each (claim 1: 1 - confidence),
where the sample is as its test supposes: a claim holds if *all* of its m parts do, so each part is tested at that level
(an intersection-union test: Berger 1982, Technometrics 24:295), and it fails if *one* part does, so each is tested at
that level over m. docs/claims-measured.md has the measured rates.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from auvbench.analysis.effects import learns, matched, mean_difference
from auvbench.analysis.formatting import amount, counted, difference, p_value
from auvbench.analysis.measures import measure
from auvbench.analysis.records import Agent, ClaimVerdict
from auvbench.analysis.study.evidence import cell
from auvbench.analysis.study.trend import Trend
from auvbench.analysis.timing import budget_of
from auvbench.statistics.intervals import Estimate

HOLDS, FAILS, OPEN = "holds", "does not hold", "cannot be said"


@dataclass(frozen=True, slots=True)
class Part:
    """One test of a claim."""

    verdict: str
    statistic: str = ""
    missing: str = ""
    run_ids: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Levels:
    """How sure a part must be of either answer."""

    holds: float
    """confidence of the two-sided interval that says "holds" """
    fails: float
    """confidence of the one that says "does not hold", corrected for the parts of the claim"""

    @classmethod
    def of(cls, confidence: float, parts: int) -> Levels:
        """Of a claim with several parts."""
        return cls(confidence, 1 - (1 - confidence) / parts)


def together(text: str, parts: Sequence[Part]) -> ClaimVerdict:
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
    return ClaimVerdict(text, verdict, _sentence(statistics), _sentence(missing), runs)


def _sentence(parts: Sequence[str]) -> str:
    text = "; ".join(parts)
    return f"{text[0].upper()}{text[1:]}." if text else ""


def by_interval(at: Callable[[float], Estimate], levels: Levels, above: float, *, less: bool = False) -> str:
    """Holds if the whole interval lies above a bound (`less`: below it), fails if it lies on the other side.

    Args:
        at: the estimate with its interval, by confidence.
        levels: the confidence of either answer.
        above: the bound.
        less: the part claims a value below the bound.
    """
    yes, no = at(levels.holds), at(levels.fails)
    if (yes.high < above) if less else (yes.low > above):
        return HOLDS
    if (no.low > above) if less else (no.high < above):
        return FAILS
    return OPEN


def runs_of(pairs: Sequence[tuple[Agent, ...]]) -> tuple[str, ...]:
    """Ids of all runs behind some agents."""
    return tuple(dict.fromkeys(run.id for pair in pairs for agent in pair for run in agent.runs))


def more_seeds(agents: Sequence[Agent]) -> str:
    """What would resolve a difference that is not."""
    fewest = min(len(agent.outcome) for agent in agents)
    return f"an interval that excludes the bound; the fewest seeds of a cell are {fewest}"


def by_trend(found: Trend, what: str, levels: Levels, ids: tuple[str, ...]) -> Part:
    """A part that claims a rising trend; two one-sided permutation tests."""
    rises, falls = found.p_up < (1 - levels.holds) / 2, found.p_down < (1 - levels.fails) / 2
    verdict = HOLDS if rises else FAILS if falls else OPEN
    interval = amount(found.estimate, measure("success_rate"))
    p = p_value(min(1, 2 * min(found.p_up, found.p_down)))
    statistic = f"{what} {interval} of {counted(found.pairs, 'pair')} of runs, {p}"
    missing = "more training seeds per cell" if verdict == OPEN else ""
    return Part(verdict, statistic, missing, ids)


LEARNED = 0.15
"""test success above which a run learned something: ten runs of 3000 and 5000 steps reached 0.2 to 8.4 %"""

Group = tuple[Agent, ...]


def learned(agent: Agent) -> bool:
    """Whether the best run of an agent succeeds more than an untrained one may."""
    return bool(agent.success.mean(axis=1).max() > LEARNED)


def budget(agent: Agent) -> int | None:
    """Training steps that an agent's runs were given; None where they differ."""
    steps = {budget_of(run) for run in agent.runs}
    return steps.pop() if len(steps) == 1 else None


def informative(groups: Sequence[Group]) -> tuple[list[Group], list[str]]:
    """The groups of agents to be compared that are evidence, and in words why others are not.

    Nothing follows from agents that learned nothing, for the factor does not matter there: a group is left out
    if none of its agents learned. One that did and one that did not is evidence: leaving it out would choose by the
    result.
    """
    kept: list[Group] = []
    left = {"one training seed": 0, "unequal training budgets": 0, "nothing learned by any of its agents": 0}
    for group in groups:
        trained = [agent for agent in group if learns(agent)]
        budgets = {budget(agent) for agent in trained}
        if any(len(agent.outcome) < 2 for agent in trained):
            left["one training seed"] += 1
        elif len(budgets) > 1 or None in budgets:
            left["unequal training budgets"] += 1
        elif not any(learned(agent) for agent in group):
            left["nothing learned by any of its agents"] += 1
        else:
            kept.append(group)
    return kept, [f"{counted(n, 'cell')} left out: {why}" for why, n in left.items() if n]


def extremes(agents: Sequence[Agent]) -> tuple[list[tuple[Agent, Agent]], float, float]:
    """Pairs (largest K, smallest K) of agents equal in all else, and these two K; none where K does not vary."""
    ks = sorted({cell(agent)[0] for agent in agents if np.isfinite(cell(agent)[0])})
    if len(ks) < 2:
        return [], np.nan, np.nan
    return matched(agents, "reward.k", ks[-1], ks[0]), ks[0], ks[-1]


def averaged(
    pairs: Sequence[Group],
    metric: str,
    what: str,
    levels: Levels,
    absent: str,
    above: float = 0.0,
    *,
    less: bool = False,
) -> Part:
    """A part that claims first - second > a bound (`less`: below it) in a measure, averaged over matched cells."""
    if not pairs:
        return Part(OPEN, missing=absent)
    kept, left = informative(pairs)
    if not kept:
        return Part(OPEN, missing="; ".join([f"{absent} that are evidence", *left]), run_ids=runs_of(pairs))
    m = measure(metric)
    two = [(group[0], group[1]) for group in kept]
    verdict = by_interval(lambda c: mean_difference(two, m, c)[0], levels, above, less=less)
    shown = difference(mean_difference(two, m, levels.holds)[0], m)
    statistic = "; ".join([f"{what} {shown} over {counted(len(kept), 'matched cell')}", *left])
    missing = more_seeds([agent for pair in kept for agent in pair]) if verdict == OPEN else ""
    return Part(verdict, statistic, missing, runs_of(kept))
