"""Build the main table (each agent's difference from the baseline) and the notes for judging it."""

from __future__ import annotations

from collections.abc import Callable
from itertools import groupby
from math import isfinite

from auvbench import metrics
from auvbench.analysis import optional_columns
from auvbench.analysis.formatting import NOTHING, name, size, unit_of_difference
from auvbench.analysis.labels import OWN, in_short, usual_sentence
from auvbench.analysis.measures import Measure, measure
from auvbench.analysis.planning import MOST_EPISODES
from auvbench.analysis.primary import AHEAD, BEHIND, EQUIVALENT, OPEN
from auvbench.analysis.records import Against, Needed, Primary, Problem, Ranking, Row
from auvbench.evaluation.scenario_sets import cited
from auvbench.reporting.tables.table import (
    DAGGER,
    Cell,
    Heading,
    Line,
    Table,
    column_of,
    estimate_cell,
)
from auvbench.statistics.intervals import SUCCEEDED, wilson
from auvbench.statistics.power import MOST_SEEDS
from auvbench.statistics.reliability import Reliability

SYMBOLS = {AHEAD: "▲", EQUIVALENT: "■", BEHIND: "▼", OPEN: "○"}
"""symbols of the verdicts, which do not depend on colours"""
BASELINE = "baseline"
USUAL = {"success_rate": 2, "mean_energy_J": 4, "action_ms": 5}
"""metrics after the primary metric, with the weights of their columns (`Heading.weight`)"""

LONGEST = 16
"""largest number of characters of a baseline's label that a heading shows"""

KINDS = {
    "failed": "failed",
    "unfinished": "unfinished",
    "missing": "missing",
    "damaged": "damaged",
    "foreign": "not comparable",
    "duplicate": "given twice",
}
"""titles of the kinds of problems, in the order in which a report lists the kinds"""

SAME_TEST = (
    "The test fixes task, noise, disturbances and simulator for all agents, also if they were trained with others; protocol=own "
    "tests a run in its own."
)
OWN_TEST = "Each run was tested in its own task, noise and disturbances, at its own frequency."

KNOWS = (
    "what the agent knows beyond noisy positions: the vehicle's sheet, a model made from it, the reference ahead (preview), a map, "
    "true velocities"
)

NEAR_AN_END = 0.1
"""A rate closer to 0 or 1 than this gets a caution, because the distribution of rates over seeds is skewed near 0 and 1"""
FEW_SEEDS = 10
NOT_BEHIND = "trainings that are not behind the baseline by more than the margin, on these scenarios"


_Column = tuple[Heading, Callable[[Row], Cell]]


def main_table(ranking: Ranking) -> Table:
    """Return the main table; columns of metrics without any value are left out."""
    columns = [*_lead(ranking), *_metric(ranking, ranking.rank_by, 1), *_against(ranking)]
    for metric, weight in (USUAL | dict.fromkeys(ranking.columns, 2)).items():
        if metric != ranking.rank_by:
            columns += _metric(ranking, metric, weight)
    columns += _effort(ranking)
    lines = tuple(
        Line(tuple(cell(row) for _, cell in columns), verdict_of(ranking, row.label)) for row in ranking.rows
    )
    by = name(measure(ranking.rank_by))
    against = f" against {ranking.primary.baseline}" if ranking.primary else ""
    title = f"Agents{against} in {by} on protocol {ranking.protocol}."
    return Table(tuple(heading for heading, _ in columns), lines, title, tuple(notes(ranking)))


def verdict_of(ranking: Ranking, label: str) -> str:
    """Return an agent's verdict; 'baseline' for the baseline, and '' if no agent is compared."""
    if ranking.primary is None:
        return ""
    against = ranking.primary.of(label)
    return against.verdict if against else BASELINE


def label_of(row: Row) -> str:
    """Return the label, with a dagger for one training seed."""
    return row.label if row.compared else f"{row.label} {DAGGER}"


def result_of(against: Against) -> tuple[str, str]:
    """Return the verdict, and a remark on what would decide an open comparison.

    Examples are ("behind*", "") and ("open", "(5 trainings; 8 needed)").
    """
    if against.verdict != OPEN:
        return against.marked_verdict, ""
    if against.few:
        return OPEN, f"({against.trainings} trainings; {against.enough} needed)"
    return OPEN, needed_text(against.needed)


def needed_text(needed: Needed | None) -> str:
    """Return a remark on what would decide an open comparison: "(about 9 trainings would decide)"; '' if unknown."""
    if needed is None:
        return ""
    most = MOST_SEEDS if needed.unit == "trainings" else MOST_EPISODES
    count = f"more than {most}" if needed.count is None else f"about {needed.count}"
    return f"({count} {needed.unit} would decide)"


def _lead(ranking: Ranking) -> list[_Column]:
    columns: list[_Column] = [(Heading("agent", words=True), lambda row: Cell(label_of(row)))]
    if any(row.trained for row in ranking.rows):
        columns.append((Heading("budget", "steps", weight=2), _budget))
    if ranking.primary is None and any(row.trained for row in ranking.rows):
        heading = Heading("trainings that succeeded", weight=3)
        columns.append((heading, lambda row: _trainings(row, ranking.confidence)))
    return columns


def _effort(ranking: Ranking) -> list[_Column]:
    """Return the columns on the agents' knowledge, and on the tuning trials that chose the agents' settings.

    A column without entries is left out.
    """
    columns: list[_Column] = []
    if any(row.knows for row in ranking.rows):
        heading = Heading("knows", weight=5, words=True, hint=KNOWS)
        columns.append((heading, lambda row: Cell(", ".join(row.knows) or NOTHING)))
    if any(row.trials for row in ranking.rows):
        heading = Heading(
            "tuning", "trials", weight=5, hint="number of trials of the search that chose the settings"
        )
        columns.append(
            (heading, lambda row: Cell(f"{row.trials:,}" if row.trials else NOTHING, sort=row.trials))
        )
    if any(row.trial_s is not None for row in ranking.rows):  # older searches did not record this time
        steps = Heading("tuning", "steps", weight=5, hint="environment steps of these trials")
        columns.append((steps, lambda row: _steps(row.trial_steps)))
        hours = Heading(
            "tuning", "core hours", weight=5, hint="processor time of these trials, including their tests"
        )
        columns.append((hours, lambda row: _hours(row.trial_s)))
    return columns


def _steps(steps: int | None) -> Cell:
    return Cell(in_short(steps) if steps else NOTHING, sort=steps)


def _hours(seconds: float | None) -> Cell:
    return Cell(NOTHING) if seconds is None else Cell(f"{seconds / 3600:.2g}", sort=seconds)


def _budget(row: Row) -> Cell:
    if not row.budget or not any(row.budget):
        return Cell(NOTHING)
    ends = dict.fromkeys(in_short(steps) for steps in (row.budget[0], row.budget[-1]))
    return Cell(" to ".join(ends), sort=float(row.budget[-1]))


def _trainings(row: Row, confidence: float) -> Cell:
    """Return the cell "5 of 5 [57, 100]": number of successful trainings, and Wilson's interval of their share in per cent."""
    if not row.trained:
        return Cell(NOTHING)
    n = len(row.seeds)
    low, high = (f"{100 * float(end):.0f}" for end in wilson(row.succeeded, n, confidence))
    return Cell(f"{row.succeeded} of {n}", f"[{low}, {high}]", row.succeeded / n)


def _metric(ranking: Ranking, metric: str, weight: int = 0) -> list[_Column]:
    if not any(metric in row.estimates for row in ranking.rows):
        return []
    column = column_of(metric, weight)
    return [(column, lambda row: estimate_cell(row.estimates.get(metric), column.scale))]


def _against(ranking: Ranking) -> list[_Column]:
    primary = ranking.primary
    if primary is None:
        return []
    m = measure(ranking.rank_by)

    def difference(row: Row) -> Cell:
        against = primary.of(row.label)
        if against is None or not isfinite(against.difference.low):  # baseline, or too few trainings
            return Cell(NOTHING)
        return estimate_cell(against.difference, m.scale, signed=True)

    def verdict(row: Row) -> Cell:
        against = primary.of(row.label)
        if against is None:
            return Cell(BASELINE)
        order = float((AHEAD, EQUIVALENT, OPEN, BEHIND).index(against.verdict))
        word, lacks = result_of(against)
        return Cell(f"{SYMBOLS[against.verdict]} {word}", lacks, order)

    title = f"from {primary.baseline}" if len(primary.baseline) <= LONGEST else "difference"
    columns = [
        (Heading(title, unit_of_difference(m).strip()), difference),
        (Heading("result", words=True), verdict),
    ]
    return [*columns, *not_behind(ranking)]


def not_behind(ranking: Ranking) -> list[_Column]:
    """Return a list with the column of trainings that are not behind the baseline; [] if no agent learns."""
    primary = ranking.primary
    if primary is None or not any(against.reliability for against in primary.comparisons):
        return []

    def reliable(row: Row) -> Cell:
        against = primary.of(row.label)
        return reliability_cell(against.own_reliability if against else None)

    return [(Heading(not_behind_title(primary.baseline), "trainings", hint=NOT_BEHIND), reliable)]


def not_behind_title(baseline: str) -> str:
    """Return the heading of the column of trainings not behind the baseline; a long label of the baseline is left out."""
    return f"not behind {baseline}" if len(baseline) <= LONGEST else "not behind"


def reliability_cell(reliability: Reliability | None) -> Cell:
    """Return the cell "19 of 20 [75, 100]": trainings that are not behind, and the interval of their share in per cent."""
    if reliability is None:
        return Cell(NOTHING)
    limits = f"[{100 * reliability.low:.0f}, {100 * reliability.high:.0f}]"
    return Cell(
        f"{reliability.count} of {reliability.trainings}", limits, reliability.count / reliability.trainings
    )


def notes(ranking: Ranking) -> list[str]:
    """Return the notes below the main table, the most important note first, without markup."""
    counts = sorted({row.episodes for row in ranking.rows})
    episodes = " to ".join(str(c) for c in dict.fromkeys((counts[0], counts[-1]))) if counts else "0"
    compared, few, more = ([], [], []) if ranking.primary is None else explained(ranking.primary)
    declared = " ".join(line for line in (ranking.sealed, ranking.declaration) if line)
    lines = [
        *compared,
        *few,
        *([declared] if declared else []),
        f"Protocol {ranking.protocol}, condition {ranking.condition}, scenarios {cited(ranking.fingerprint)}: "
        f"{episodes} episodes per training seed, the same for every agent. Training seeds: {_seeds(ranking)}.",
        OWN_TEST if ranking.protocol == OWN else SAME_TEST,
        *more,
    ]
    lines += usual_sentence([row.key for row in ranking.rows], [row.trained for row in ranking.rows])
    if any(metric.startswith("par") for metric in (ranking.rank_by, *ranking.columns)):
        lines.append("PAR-1: a failure counts as the limit of the episode; PAR-2: as twice the limit.")
    lines += remarks(ranking)
    return [*lines, *limit_lines(ranking)] if optional_columns.OVER_BEST_KNOWN in ranking.columns else lines


def explained(primary: Primary) -> tuple[list[str], list[str], list[str]]:
    """Return three lists of notes on the primary analysis: the comparison, too few trainings, and all other notes."""
    m = measure(primary.measure)
    best = (
        " (the best agent with several trainings, as the table has no controller)"
        if primary.chosen_by_rank
        else ""
    )
    has_margin = primary.margin == primary.margin
    within = (
        f"within ±{size(primary.margin, m)} equivalent"
        if has_margin
        else "without a margin, no agent is equivalent"
    )
    learner = any(c.trainings for c in primary.comparisons)
    of = (
        "Typical training (half of all trainings are better, half worse) less"
        if learner
        else "Difference from"
    )
    compared = (
        f"{of} {primary.baseline}{best} in {name(m)}, paired by scenario. The intervals hold together with "
        f"{100 * primary.confidence:g} %; {within}. Other intervals hold one by one."
    )
    some = [c for c in primary.comparisons if c.few]
    few = []
    if any(c.starred for c in some):
        few.append(
            f"* fewer than {some[0].enough} trainings: the verdict assumes that trainings cluster around the typical one."
        )
    if any(c.verdict == OPEN for c in some):
        few.append(
            f"Open with fewer than {some[0].enough} trainings: {some[0].enough} trainings that are all clearly better, or all "
            f"clearly worse, than {primary.baseline} would decide."
        )
    more = [_reliability(primary, m)] if learner else []
    if any(c.verdict == OPEN and c.needed for c in primary.comparisons):
        more.append(
            "Open, with a number of trainings or episodes: this number decides with 80 % power if further ones are like these. "
            "Plan them before adding seeds (auvbench plan)."
        )
    return [compared], [" ".join(few)] if few else [], more


def _reliability(primary: Primary, m: Measure) -> str:
    """Return a note on the column of trainings that are not behind the baseline.

    The note also gives the upper limit of the share of trainings that are behind, and the share of failing trainings
    that would change a verdict on the mean.
    """
    margin = primary.margin if primary.margin == primary.margin else 0.0
    reliabilities = [(c.agent, c.own_reliability) for c in primary.comparisons if c.own_reliability]
    limits = {r.trainings: r.excluded for _, r in reliabilities if r.count == r.trainings}
    text = (
        f"Not behind: trainings at most {size(margin, m)} worse than {primary.baseline} on these scenarios; brackets: "
        f"{100 * primary.confidence:g} % interval of the share of all trainings, in per cent."
    )
    if limits:
        shares = [f"{n} trainings, none of them behind, {100 * limits[n]:.0f} %" for n in sorted(limits)]
        text += (
            f" Upper limit of the share of all trainings that are behind ({100 * primary.confidence:g} %, one-sided): "
            f"{'; '.join(shares)}."
        )
    turns = [(agent, r.mean_turns) for agent, r in reliabilities if r.mean_turns is not None]
    if turns:
        shares = [f"{agent} {100 * q:.2g} %" for agent, q in turns]
        text += (
            " A verdict about the mean would be lost if this share of trainings failed in every episode: "
            f"{'; '.join(shares)}."
        )
    return text


def remarks(ranking: Ranking) -> list[str]:
    """Return notes on rows that are not compared, unequal budgets, and successful and failed trainings; then the cautions."""
    lines = []
    if not all(row.compared for row in ranking.rows):
        lines.append(
            f"{DAGGER} one training seed: the row describes this policy and is not compared, because another training may "
            "end elsewhere. Train more seeds: seed=0,1,2,3,4."
        )
    if len({row.budget for row in ranking.rows if row.budget}) > 1:
        lines.append("Budgets differ: an agent with more steps may be ahead for that alone.")
    if ranking.primary is None and any(row.trained and row.compared for row in ranking.rows):
        lines.append(
            f"A training succeeded if it reaches at least {100 * SUCCEEDED:.0f} % of the test goals; brackets: "
            f"{100 * ranking.confidence:g} % interval of the share of trainings that succeed."
        )
    return [*lines, *failed_trainings(ranking), *cautions(ranking)]


def limit_lines(ranking: Ranking) -> list[str]:
    """Return the notes on the best known times, or the reason why no best known times are available."""
    if ranking.limit is None:
        return [ranking.no_limit] if ranking.no_limit else []
    return optional_columns.sentences(ranking.limit)


def failed_trainings(ranking: Ranking) -> list[str]:
    """Return a sentence for each agent with failed trainings."""
    return [
        f"{row.label}: {len(row.failed_seeds)} of {len(row.seeds)} trainings failed (seed "
        f"{', '.join(map(str, row.failed_seeds))}) and count as success 0; --where state=complete leaves them out."
        for row in ranking.rows
        if row.failed_seeds
    ]


def cautions(ranking: Ranking) -> list[str]:
    """Return cautions on intervals that are too narrow, times measured on different machines, and misleading means.

    docs/statistics.md has the measured error rates of the intervals.
    """
    several = [row for row in ranking.rows if row.trained and 1 < len(row.seeds) <= FEW_SEEDS]
    rates = [row.estimates["success_rate"].value for row in several if "success_rate" in row.estimates]
    lines = list(ranking.machines)
    if any(0 < rate < NEAR_AN_END or rate > 1 - NEAR_AN_END for rate in rates):
        lines.append(
            "Success beyond 90 % (or below 10 %) with few seeds: where trainings differ strongly, 95 % intervals held in 80 "
            "to 90 % of simulated experiments."
        )
    by = measure(ranking.rank_by)
    counted = any(metric.measure == by.name and metric.counts_failures for metric in metrics.registered())
    if by.name.startswith("mean_") and by.name != "mean_return" and not counted:
        lines.append(
            f"{name(by).capitalize()} is a mean over all test episodes, including failures, so a quick failure "
            "looks good. Read it with the success rate."
        )
    return lines


def _seeds(ranking: Ranking) -> str:
    sets = {row.seeds for row in ranking.rows if row.trained and row.compared} or {
        row.seeds for row in ranking.rows if row.trained
    }
    if not sets:
        return "none, no agent learns"
    if len(sets) == 1:
        return ", ".join(map(str, next(iter(sets))))
    sizes = sorted(len(s) for s in sets)
    return f"{sizes[0]} to {sizes[-1]} per agent"


def grouped(problems: tuple[Problem, ...]) -> list[tuple[str, list[Problem]]]:
    """Return (title, problems) for each kind of problem, in the order of `KINDS`; problems are sorted by run or path."""
    order = list(KINDS)
    ordered = sorted(problems, key=lambda p: (order.index(p.kind), p.where))
    return [(KINDS[kind], list(members)) for kind, members in groupby(ordered, key=lambda p: p.kind)]
