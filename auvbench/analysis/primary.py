"""Compute the primary analysis: each agent against one baseline, with a margin, corrected only over these
comparisons.

Each agent has one interval of its difference from the baseline; a learner's interval is about its typical
training (statistics/typical.py). The intervals hold simultaneously (Bonferroni). The verdict follows from the
interval, so verdict and interval cannot disagree:

* equivalent: the whole interval is within the margin around zero;
* ahead, behind: the interval is not within the margin, and is on one side of zero;
* open: all other cases, and two agents at the measure's limit, e.g. both without success in any episode.

Holm's procedure would decide at most a few more comparisons. But simultaneous intervals that agree with Holm's
verdicts show only the sign of a resolved difference (Strassburger & Bretz 2008, Stat. Med. 27:4914).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from auvbench.analysis.formatting import amount, listed, name, rounded_difference, size
from auvbench.analysis.measures import LIMITED_BY_STEPS, Measure, measure
from auvbench.analysis.pairwise import Tests
from auvbench.analysis.planning import needed
from auvbench.analysis.records import Against, Agent, Comparison, Primary, Ranking, learns
from auvbench.analysis.typical import Typical
from auvbench.errors import ReportError, closest
from auvbench.registry import TASKS
from auvbench.statistics.intervals import BoolArray, Estimate
from auvbench.statistics.reliability import Reliability, reliability
from auvbench.statistics.typical import FEWEST, trainings_needed

AHEAD, EQUIVALENT, BEHIND, OPEN = VERDICTS = ("ahead", "equivalent", "behind", "open")

USUAL_BASELINE = "pid"
NO_BASELINE = ("random",)
"""controllers that are never the default baseline"""
RATE_MARGIN, RELATIVE_MARGIN = 0.02, 0.05
"""default margins: absolute for a rate, and relative to the baseline's value for other measures"""


def primary_analysis(
    agents: Sequence[Agent],
    tests: Tests,
    compared: BoolArray,
    baseline: Agent | None,
    margin: float | None,
) -> Primary | None:
    """Compare each agent with the baseline.

    Args:
        agents: agents in the order of the table.
        tests: tests of all pairs of the agents on the primary measure.
        compared: (n,) False for an agent with one training seed, whose comparison stays open.
        baseline: one of the agents; None chooses one (`default_baseline`).
        margin: smallest difference of interest in the measure's unit; None: 2 points for a rate, 5 % of the
            baseline's value for other measures.

    Returns:
        None if there is nothing to compare.
    """
    chosen = baseline or default_baseline(agents, compared)
    if chosen is None or len(agents) < 2:
        return None
    b = next(i for i, agent in enumerate(agents) if agent is chosen)
    m, confidence, typical = tests.measure, tests.confidence, tests.typical
    margin = default_margin(m, typical.value[b]) if margin is None else margin
    family = [i for i in range(len(agents)) if i != b and compared[i] and compared[b]]
    level = (1 - confidence) / max(len(family), 1)
    limited = _at_worst(tests)
    enough = trainings_needed(max(len(family), 1), 1 - confidence)
    comparisons = []
    for i, agent in enumerate(agents):
        if i == b:
            continue
        difference = replace(typical.difference(i, b, level), confidence=confidence)
        if i not in family:
            nothing = replace(difference, low=math.nan, high=math.nan)
            comparisons.append(Against(agent.label, nothing, OPEN))
            continue
        trainings = typical.fewest((i, b))
        # McNemar's test of two controllers may be stricter than the interval. If it is not significant, extend the interval to 0.
        if not trainings and not tests.p[i, b] < level:
            difference = replace(difference, low=min(difference.low, 0.0), high=max(difference.high, 0.0))
        reliable = reliability_of(agents, typical, i, b, margin, confidence)
        turned = typical.trainings[i] <= 1
        if limited[i] and limited[b]:
            comparisons.append(
                Against(agent.label, difference, OPEN, None, trainings, enough, reliable, turned)
            )
            continue
        verdict = verdict_of(difference, margin, m)
        few = 0 < trainings < enough
        plan = needed(typical, i, b, margin, level) if verdict == OPEN and not few else None
        reliable = reliability_of(agents, typical, i, b, margin, confidence, verdict)
        comparisons.append(
            Against(agent.label, difference, verdict, plan, trainings, enough, reliable, turned)
        )
    by_rank = baseline is None and learns(chosen)
    return Primary(m.name, chosen.label, margin, confidence, tuple(comparisons), by_rank)


def reliability_of(
    agents: Sequence[Agent],
    typical: Typical,
    i: int,
    b: int,
    margin: float,
    confidence: float,
    verdict: str = OPEN,
) -> Reliability | None:
    """Return how many trainings of agent i are not behind agent b by more than the margin.

    If agent i is a controller and agent b a learner, count the trainings of b that are not behind i. Return
    None for two controllers.
    """
    turned = typical.trainings[i] <= 1
    learner, other = (b, i) if turned else (i, b)
    if typical.trainings[learner] <= 1:
        return None
    baseline, m = float(typical.value[other]), typical.measure
    margin = margin if math.isfinite(margin) else 0.0
    edges = {AHEAD: 0.0, EQUIVALENT: -margin} if not turned else {BEHIND: 0.0, EQUIVALENT: -margin}
    return reliability(
        typical.gains(learner, baseline),
        margin,
        confidence=confidence,
        edge=edges.get(verdict, math.nan),
        failure=m.sign * (m.failure(agents[learner]) - baseline),
    )


def with_reliability(
    c: Comparison, agents: Sequence[Agent], typical: Typical, pair: tuple[int, int], margin: float
) -> Comparison:
    """Return a comparison of two agents, with the reliability of each learner against the other agent."""
    i, j = pair
    first, second = (
        reliability_of(agents, typical, agent, other, margin, c.difference.confidence)
        if typical.trainings[agent] > 1
        else None
        for agent, other in ((i, j), (j, i))
    )
    return replace(c, first_reliability=first, second_reliability=second)


def verdict_of(difference: Estimate, margin: float, m: Measure) -> str:
    """Return the verdict for the interval of a difference from the baseline.

    >>> from auvbench.analysis.measures import measure
    >>> verdict_of(Estimate(-3, -4, -2), 1.0, measure("par1_steps"))
    'ahead'
    >>> verdict_of(Estimate(-0.5, -0.9, -0.1), 1.0, measure("par1_steps"))
    'equivalent'
    """
    low, high = sorted((m.sign * difference.low, m.sign * difference.high))
    if -margin < low and high < margin:
        return EQUIVALENT
    return AHEAD if low > 0 else BEHIND if high < 0 else OPEN


def at_limit(agents: Sequence[Agent], tests: Tests, primary: Primary | None) -> str:
    """Return a sentence on the agents that, like the baseline, have the measure's worst possible value; '' without such agents."""
    limited = [agent.label for agent, at in zip(agents, _at_worst(tests), strict=True) if at]
    tied = [label for label in limited if primary is not None and label != primary.baseline]
    if primary is None or not tied or len(tied) == len(limited):
        return ""
    return (
        f"{primary.baseline} and {listed(tied, 4)} are {'both' if len(tied) == 1 else 'all'} at the limit of "
        f"{name(tests.measure)}: this test is too hard to tell them apart, so their comparison is open, not equivalent."
    )


def _at_worst(tests: Tests) -> BoolArray:
    """Return whether each agent's typical value (n,) is the worst possible value, as if every episode failed."""
    worst = tests.typical.worst
    return np.asarray(np.isfinite(worst) & np.isclose(tests.typical.value, worst, rtol=1e-9, atol=0.0))


def default_margin(m: Measure, baseline: float) -> float:
    """Return the default margin. Except for a rate, it is a share of the baseline's value; NaN if that value is 0 or missing."""
    if m.rate:
        return RATE_MARGIN
    return RELATIVE_MARGIN * abs(baseline) or math.nan


def default_baseline(agents: Sequence[Agent], compared: BoolArray) -> Agent | None:
    """Return PID if it is in the table, else the best controller, else the best agent; None if no agent is compared."""
    able = [agent for agent, ok in zip(agents, compared, strict=True) if ok]
    usual = [agent for agent in able if agent.key.get("algo") == USUAL_BASELINE]
    controllers = [a for a in able if not learns(a) and a.key.get("algo") not in NO_BASELINE]
    return next(iter((*usual, *controllers, *able)), None)


def find_baseline(agents: Sequence[Agent], name: str, option: str = "") -> Agent:
    """Return the agent with the label `name` (ignoring case), or the only agent of the algorithm `name`.

    Raises:
        ReportError: no agent or several agents match; lists the labels.
    """
    folded, argument = name.casefold(), option or f"--baseline {name!r}"
    exact = [agent for agent in agents if agent.label == name]
    matches = exact or [agent for agent in agents if agent.label.casefold() == folded]
    matches = matches or [agent for agent in agents if str(agent.key.get("algo", "")).casefold() == folded]
    if len(matches) == 1:
        return matches[0]
    if matches:
        labels = ", ".join(sorted(agent.label for agent in matches))
        raise ReportError(
            f"{argument} matches {len(matches)} agents; give the label of one of them: {labels}"
        )
    hint = closest(name, (agent.label for agent in agents))
    raise ReportError(f"{argument} is not one of the agents; {hint}")


def headline(ranking: Ranking) -> str:
    """Return one sentence: the agent furthest ahead of the baseline, and the number of agents by verdict."""
    m = measure(ranking.rank_by)
    primary = ranking.primary
    if not ranking.rows:
        return "No agent could be ranked."
    if primary is None:
        row = ranking.rows[0]
        if len(ranking.rows) == 1:
            return f"{row.label} is the only agent: {name(m)} {amount(row.estimates[m.name], m)}."
        return f"None of {len(ranking.rows)} agents is compared: each has one training seed."
    if not any(math.isfinite(c.difference.low) for c in primary.comparisons):
        return f"No agent can be compared with {primary.baseline}: a verdict needs at least {FEWEST} trainings of each learner."
    best = furthest_ahead(primary)
    first = _lead(best, ranking, m) if best else f"No agent is ahead of {primary.baseline} in {name(m)}"
    return "; ".join(filter(None, [first, _counts(primary, m)])) + "."


def furthest_ahead(primary: Primary) -> Against | None:
    """Return the comparison of the agent that is furthest ahead of the baseline; None if no agent is ahead."""
    sign = measure(primary.measure).sign
    return max(primary.having(AHEAD), key=lambda c: sign * c.difference.value, default=None)


def _lead(best: Against, ranking: Ranking, m: Measure) -> str:
    assert ranking.primary is not None
    gain, interval = rounded_difference(best.difference, m)
    agent, baseline, r = best.agent, ranking.primary.baseline, best.reliability
    ending = ""
    if r and best.of_baseline:
        ending = f", and {r.trainings - r.count} of {r.trainings} trainings of {baseline} are behind"
    elif r:
        ending = f", and {r.count} of {r.trainings} trainings are not behind"
    if best.trainings and not best.of_baseline:
        agent = f"The typical training of {agent}"
    if best.trainings and any(row.trained and row.label == baseline for row in ranking.rows):
        baseline = f"the typical training of {baseline}"
    reached = TASKS[ranking.task].reached if ranking.task in TASKS else ""
    if reached and m.column in LIMITED_BY_STEPS:
        text = f"{agent} reaches {reached} {gain} sooner than {baseline}{interval}"
    elif reached and m.name == "success_rate":
        text = f"{agent} reaches {gain} more of the {reached} than {baseline}{interval}"
    else:
        text = f"{agent} is ahead of {baseline} by {gain} in {name(m)}{interval}"
    return f"{text}{ending}"


def _counts(primary: Primary, m: Measure) -> str:
    """Return the numbers of agents by verdict: '5 agents are equivalent to PID within 11 steps, 12 are behind, 10 are open'."""
    margin = size(primary.margin, m)
    parts: list[str] = []
    for verdict, words in (
        (AHEAD, "also ahead"),
        (EQUIVALENT, f"equivalent to {primary.baseline} within {margin}"),
        (BEHIND, "behind"),
        (OPEN, "open"),
    ):
        comparisons = primary.having(verdict)
        n = len(comparisons) - (verdict == AHEAD)
        if n > 0:
            noun = "" if parts else " agent" if n == 1 else " agents"
            starred = sum(c.starred for c in comparisons)
            stars = f" ({starred} from few trainings, marked *)" if starred else ""
            parts.append(f"{n}{noun} {'is' if n == 1 else 'are'} {words}{stars}")
    return ", ".join(parts)
