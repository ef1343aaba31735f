"""What stands below a table: how the numbers came about, and what is not in it."""

from __future__ import annotations

from auvbench.analysis import limit
from auvbench.analysis.model import Problem, Ranking
from auvbench.analysis.rounding import NOTHING
from auvbench.reporting.tables.columns import DAGGER, letters, policies

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


NEAR_AN_END = 0.1
"""a rate so close to 0 or 1, or closer: seeds that differ strongly are skewed there"""
FEW_SEEDS = 10


def notes(ranking: Ranking) -> list[str]:
    """The sentences of the note, without markup."""
    counts = sorted({row.episodes for row in ranking.rows})
    episodes = "–".join(str(c) for c in dict.fromkeys((counts[0], counts[-1]))) if counts else "0"
    percent = f"{100 * ranking.confidence:g} %"
    lines = [
        f"Protocol {ranking.protocol}, condition {ranking.condition}, scenarios {ranking.fingerprint}: "
        f"{episodes} episodes per training seed, the same for every agent. Training seeds: {_seeds(ranking)}.",
        f"{units(ranking)}Ranked by {ranking.order}{_penalised(ranking)}. Brackets are {percent} intervals; a rank in "
        f"parentheses is its {percent} interval; {resolution(ranking)}.",
    ]
    trained = [row for row in ranking.rows if row.trained]
    single = policies(ranking)
    if single:
        lines.append(one_training(ranking))
    if ranking.compare == "algorithms" and len(single) < len(trained):
        lines.append(
            "The intervals of the other trained agents cover training seeds and test episodes."
            if single
            else "The intervals cover training seeds and test episodes."
        )
    lines += (*failed_trainings(ranking), *cautions(ranking))
    if ranking.compare == "algorithms" and len(single) < len(trained) < len(ranking.rows):
        lines.append(
            f"Seeds {NOTHING}: does not learn; the interval covers test episodes, and there is nothing else."
        )
    return lines + further(ranking, percent)


def further(ranking: Ranking, percent: str) -> list[str]:
    """What the columns on request are."""
    lines = []
    if "next_training" in ranking.columns:
        lines.append(
            f"Next training: its bracket holds at least 90 % of all trainings, with {percent} confidence, if they are "
            "normal on the log-odds; where some fail altogether they are not."
        )
    if {"iqm_success", "optimality_gap"} & set(ranking.columns):
        lines.append(
            "IQM, optimality gap: over training seeds and the conditions of the protocol; brackets are stratified "
            "bootstrap intervals, too short with few seeds."
        )
    if limit.COLUMN in ranking.columns:
        lines += limit_lines(ranking)
    if any(name.startswith("auc_") for name in ranking.columns):
        lines.append(
            "AUC: area under success on the validation scenarios during training, as a share of success throughout."
        )
    return lines


def of_pairs(ranking: Ranking) -> str:
    """What must stand beside differences of two agents: whose interval is what, and why it may be so wide."""
    text = "Each interval is of its pair by itself; verdicts follow p, which answers to all pairs at once."
    if (
        sum(row.compared and len(row.seeds) > 1 for row in ranking.rows) > 1
        and ranking.compare == "algorithms"
    ):
        text += (
            " Trainings of no agent are taken to differ less than the average of this table's, because few seeds may "
            "agree by luck: an agent whose trainings end far apart widens the intervals of the other trained ones."
        )
    return text


def limit_lines(ranking: Ranking) -> list[str]:
    """What agents are set in relation to, or why they are not."""
    if ranking.limit is None:
        return [ranking.no_limit] if ranking.no_limit else []
    return [limit.explained(), *limit.sentences(ranking.limit)]


def remarks(ranking: Ranking) -> tuple[str, ...]:
    """What must stand beside a table: what a row is, which rows are not compared, which trainings failed."""
    single = (one_training(ranking),) if policies(ranking) else ()
    said = (units(ranking).strip(), *single, *failed_trainings(ranking), *cautions(ranking))
    return tuple(filter(None, said))


def units(ranking: Ranking) -> str:
    """What a row is, where it is not an agent with its training seeds; ends in a space."""
    if ranking.compare != "policies":
        return ""
    return (
        "Each row is one policy, the outcome of one training, compared as it is: the intervals and letters hold for "
        "other test episodes, and say nothing of what another training of the same algorithm would give. "
    )


def one_training(ranking: Ranking) -> str:
    """What the dagger says, with the command that trains more seeds where it is known."""
    text = (
        f"{DAGGER} one training seed: the row describes this policy, its interval covers test episodes only, and it "
        "is not compared, because another training may end elsewhere"
    )
    if ranking.more_seeds:
        return f"{text}. More seeds: {ranking.more_seeds}"
    return f"{text}: train more seeds (seed=0,1,2,3,4)."


def failed_trainings(ranking: Ranking) -> list[str]:
    """A sentence per agent some of whose trainings failed."""
    return [
        f"{row.label}: {len(row.failed_seeds)} of {len(row.seeds)} trainings failed (seed "
        f"{', '.join(map(str, row.failed_seeds))}) and count as success 0; --failed-trainings omit leaves them out."
        for row in ranking.rows
        if row.failed_seeds
    ]


def cautions(ranking: Ranking) -> list[str]:
    """Where the numbers of this table are known to promise too much: docs/statistics.md has the measurements."""
    several = [row for row in ranking.rows if row.trained and 1 < len(row.seeds) <= FEW_SEEDS]
    rates = [row.estimates["success_rate"].value for row in several if "success_rate" in row.estimates]
    found = [ranking.agreement] if ranking.agreement else []
    found += ranking.machines
    if any(0 < rate < NEAR_AN_END or rate > 1 - NEAR_AN_END for rate in rates):
        found.append(
            "Rates beyond 90 % (or below 10 %) of few training seeds: where trainings differ as strongly as some do, their "
            "95 % intervals held in 80 to 88 % of simulated experiments, and no interval contains a kind of training "
            "that was not among the seeds."
        )
    if ranking.rank_by.startswith("mean_") and ranking.rank_by != "mean_return":
        found.append(
            f"{ranking.rank_by} is over all test episodes, however they ended: what a failure saves makes it look good. "
            "Read it beside the success rate."
        )
    equal = [c for c in ranking.comparisons if c.verdict == "equivalent"]
    seeds = {row.label: len(row.seeds) for row in several}
    fewest = min((seeds[x] for c in equal for x in (c.first, c.second) if x in seeds), default=0)
    if fewest:
        found.append(
            f"Equivalent speaks of trainings of the kinds seen: what befalls 3 of 10 trainings is in none of {fewest} "
            f"seeds with a probability of {100 * 0.7**fewest:.0f} %."
        )
    return found


def _penalised(ranking: Ranking) -> str:
    used = [name for name in dict.fromkeys((ranking.rank_by, ranking.then)) if name.startswith("par")]
    if not used:
        return ""
    counts = "the limit" if all(name.startswith("par1") for name in used) else "a multiple of the limit"
    return f" ({', '.join(used)}: a failure counts as {counts})"


def resolution(ranking: Ranking) -> str:
    """How a reader sees which agents are resolved from each other."""
    if letters(ranking):
        return "agents that share a group letter are not resolved from each other"
    return (
        "agents whose rank intervals do not overlap are resolved from each other (the group letters, too many to "
        "read here, are in the CSV)"
    )


def _seeds(ranking: Ranking) -> str:
    if ranking.compare == "policies":
        return "one per row"
    pooled = [row.label for row in ranking.rows if row.trained and row.pooled]
    if pooled:
        return (
            f"see the table; a row of so many runs ({', '.join(pooled[:4])}) pools what --group-by left out"
        )
    sets = {row.seeds for row in ranking.rows if row.trained}
    if not sets:
        return "none, no agent learns"
    if len(sets) == 1:
        return ", ".join(map(str, next(iter(sets))))
    marked = policies(ranking)
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
