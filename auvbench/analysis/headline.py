"""The answer of a report in one sentence, made from the primary analysis."""

from __future__ import annotations

from auvbench.analysis.formatting import amount, name, rounded_difference, size
from auvbench.analysis.measures import LIMITED_BY_STEPS, Measure, measure
from auvbench.analysis.primary import AHEAD, BEHIND, EQUIVALENT, OPEN
from auvbench.analysis.records import Against, Primary, Ranking


def headline(ranking: Ranking) -> str:
    """Return one sentence: who is furthest ahead of the baseline, and how many agents have which verdict."""
    m = measure(ranking.rank_by)
    primary = ranking.primary
    if not ranking.rows:
        return "No agent could be ranked."
    if primary is None:
        row = ranking.rows[0]
        if len(ranking.rows) == 1:
            return f"{row.label} is the only agent: {name(m)} {amount(row.estimates[m.name], m)}."
        return f"None of {len(ranking.rows)} agents is compared: each has one training seed."
    ahead = primary.having(AHEAD)
    first = (
        _lead(max(ahead, key=lambda c: m.sign * c.difference.value), primary, m)
        if ahead
        else f"No agent is ahead of {primary.baseline} in {name(m)}"
    )
    return f"{first}; {_counts(primary, m)}." if _counts(primary, m) else f"{first}."


def _lead(best: Against, primary: Primary, m: Measure) -> str:
    gain, interval = rounded_difference(best.difference, m)
    if m.column in LIMITED_BY_STEPS:
        return f"{best.agent} reaches waypoints {gain} sooner than {primary.baseline}{interval}"
    if m.name == "success_rate":
        return f"{best.agent} reaches {gain} more of the waypoints than {primary.baseline}{interval}"
    return f"{best.agent} is ahead of {primary.baseline} by {gain} in {name(m)}{interval}"


def _counts(primary: Primary, m: Measure) -> str:
    """Return '5 agents are equivalent to PID within 11 steps, 12 are behind, 10 are open'."""
    margin = size(primary.margin, m)
    parts: list[str] = []
    for verdict, words in (
        (AHEAD, "also ahead"),
        (EQUIVALENT, f"equivalent to {primary.baseline} within {margin}"),
        (BEHIND, "behind"),
        (OPEN, "open"),
    ):
        n = len(primary.having(verdict)) - (verdict == AHEAD)
        if n > 0:
            noun = "" if parts else " agent" if n == 1 else " agents"
            parts.append(f"{n}{noun} {'is' if n == 1 else 'are'} {words}")
    return ", ".join(parts)
