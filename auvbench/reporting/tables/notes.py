"""What stands below a table: how the numbers came about, and what is not in it."""

from __future__ import annotations

from auvbench.analysis.model import Problem, Ranking
from auvbench.analysis.rounding import NOTHING
from auvbench.reporting.tables.columns import DAGGER, letters, one_seed_among_many

KINDS = {
    "failed": "failed",
    "unfinished": "unfinished",
    "missing": "missing",
    "damaged": "damaged",
    "foreign": "not comparable",
    "duplicate": "given twice",
    "mixed": "pooled although different",
}
"""titles of the kinds of problems, in the order of a list"""


def notes(ranking: Ranking) -> list[str]:
    """The sentences of the note, without markup."""
    counts = sorted({row.episodes for row in ranking.rows})
    episodes = "–".join(str(c) for c in dict.fromkeys((counts[0], counts[-1]))) if counts else "0"
    percent = f"{100 * ranking.confidence:g} %"
    lines = [
        f"Protocol {ranking.protocol}, condition {ranking.condition}, scenarios {ranking.fingerprint}: "
        f"{episodes} episodes per training seed, the same for every agent. Training seeds: {_seeds(ranking)}.",
        f"Ranked by {ranking.rank_by}, then {ranking.then}. Brackets are {percent} intervals; a rank in "
        f"parentheses is its {percent} interval; {resolution(ranking)}.",
    ]
    trained = [row for row in ranking.rows if row.trained]
    single = [row for row in trained if len(row.seeds) < 2]
    if single and len(single) == len(trained):
        lines.append(
            "One training seed per agent: the intervals cover test episodes only, not what another training "
            "would give."
        )
    elif single:
        lines.append(
            f"{DAGGER} one training seed: the interval covers test episodes only; the others cover training "
            "seeds and test episodes."
        )
    elif trained:
        lines.append("The intervals cover training seeds and test episodes.")
    if len(single) < len(trained) < len(ranking.rows):
        lines.append(
            f"Seeds {NOTHING}: does not learn; the interval covers test episodes, and there is nothing else."
        )
    return lines


def resolution(ranking: Ranking) -> str:
    """How a reader sees which agents are resolved from each other."""
    if letters(ranking):
        return "agents that share a group letter are not resolved from each other"
    return (
        "agents whose rank intervals do not overlap are resolved from each other (the group letters, too many to "
        "read here, are in the CSV)"
    )


def _seeds(ranking: Ranking) -> str:
    sets = {row.seeds for row in ranking.rows if row.trained}
    if not sets:
        return "none, no agent learns"
    if len(sets) == 1:
        return ", ".join(map(str, next(iter(sets))))
    marked = one_seed_among_many(ranking)
    several = {row.seeds for row in ranking.rows if row.trained and row.label not in marked}
    if len(several) == 1:
        return ", ".join(map(str, next(iter(several)))) + f" ({DAGGER} one of them)"
    sizes = sorted(len(s) for s in sets)
    return f"{sizes[0]} to {sizes[-1]} per agent"


def grouped(problems: tuple[Problem, ...]) -> list[tuple[str, list[Problem]]]:
    """Problems by kind, under a title, in a fixed order; what stopped first stands first."""
    order = list(KINDS)
    kinds = sorted({p.kind for p in problems}, key=lambda k: order.index(k) if k in order else len(order))
    return [
        (KINDS.get(kind, kind), sorted((p for p in problems if p.kind == kind), key=lambda p: p.where))
        for kind in kinds
    ]
