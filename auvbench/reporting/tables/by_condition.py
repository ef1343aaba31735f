"""Build the tables of several conditions: the agent that is furthest ahead for each task, and all differences from the baseline."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import isfinite

from auvbench.analysis.by_condition import Subject
from auvbench.analysis.conditions import in_words
from auvbench.analysis.formatting import NOTHING, capitalized, name, unit_of_difference
from auvbench.analysis.grouping import TASK
from auvbench.analysis.measures import measure
from auvbench.analysis.primary import furthest_ahead
from auvbench.analysis.records import Against, Ranking
from auvbench.reporting.tables.main import SYMBOLS, label_of
from auvbench.reporting.tables.table import Cell, Heading, Line, Table, estimate_cell

FULL = 0.995
"""limit of success rates: the table of the agents furthest ahead prints a pair of success rates if one is at most this"""


def by_condition_tables(subjects: Sequence[Subject]) -> list[Table]:
    """Return the table of the agents furthest ahead, then differences and success of each vehicle and task."""
    if not subjects:
        return []
    several = len(subjects) > 1
    own = [
        table for subject in subjects for table in (differences(subject, several), success(subject, several))
    ]
    return [furthest(subjects), *own]


def furthest(subjects: Sequence[Subject]) -> Table:
    """Return the table of the agents furthest ahead of the baseline: one row per condition, one column per task."""
    columns = [_by_title(subject) for subject in subjects]
    titles = list(dict.fromkeys(title for column in columns for title in column))
    headings, measures = [Heading("condition", words=True)], []
    for subject in subjects:
        m = measure(subject.rankings[0].rank_by)
        measures.append(f"{_short(subject, subjects)}: {name(m)}")
        headings.append(
            Heading(_short(subject, subjects), unit_of_difference(m).strip(), words=True, weight=1)
        )
    rows = [
        Line(
            (
                Cell(title),
                *(_leader(column[title]) if title in column else Cell(NOTHING) for column in columns),
            )
        )
        for title in titles
    ]
    baselines = dict.fromkeys(r.primary.baseline for s in subjects for r in s.rankings if r.primary)
    notes = (
        f"The agent furthest ahead of {', '.join(baselines)}, its difference (typical training) with its interval, and its trainings "
        "that are not behind. Success of both is named where one fails now and then. Without an agent ahead: the baseline. "
        "The largest of several differences tends to be too large; its interval allows for that. "
        f"Measures: {'; '.join(measures)}.",
        _level(subjects[0]),
    )
    return Table(tuple(headings), tuple(rows), "Furthest ahead of the baseline, by task and condition", notes)


def differences(subject: Subject, several: bool) -> Table:
    """Return the table of each agent's difference from the baseline under each condition."""
    m = measure(subject.rankings[0].rank_by)

    def cell(ranking: Ranking, label: str) -> Cell:
        against = ranking.primary.of(label) if ranking.primary else None
        if against is not None:
            return _difference(against, m.scale)
        return Cell("baseline" if ranking.primary and label == ranking.primary.baseline else NOTHING)

    title = f"difference from the baseline in {name(m)} ({unit_of_difference(m).strip()})".replace(" ()", "")
    notes = (
        f"{SYMBOLS['ahead']} ahead, {SYMBOLS['equivalent']} equivalent, {SYMBOLS['behind']} behind, {SYMBOLS['open']} open; learners: the "
        "typical training, and the trainings that are not behind.",
        _level(subject),
    )
    return _grid(subject, cell, _titled(subject, title, several), notes)


def success(subject: Subject, several: bool) -> Table:
    """Return the table of each agent's success rate under each condition, in per cent."""

    def cell(ranking: Ranking, label: str) -> Cell:
        row = next((row for row in ranking.rows if row.label == label), None)
        return estimate_cell(row.estimates.get("success_rate") if row else None, 100.0)

    notes = (f"{100 * subject.rankings[0].confidence:g} % intervals, each by itself.",)
    return _grid(subject, cell, _titled(subject, "success (%)", several), notes)


def _grid(
    subject: Subject, cell: Callable[[Ranking, str], Cell], title: str, notes: tuple[str, ...]
) -> Table:
    columns = _by_title(subject)
    headings = [Heading("agent", words=True), *(Heading(column, weight=1) for column in columns)]
    labels = {row.label: label_of(row) for ranking in subject.rankings for row in ranking.rows}
    rows = [
        Line((Cell(labels[label]), *(cell(ranking, label) for ranking in columns.values())))
        for label in subject.labels
    ]
    return Table(tuple(headings), tuple(rows), title, notes)


def _by_title(subject: Subject) -> dict[str, Ranking]:
    """Return the rankings by the title of their condition.

    If two protocols have the same condition, the title of the second protocol's condition also names the protocol.
    """
    titled: dict[str, Ranking] = {}
    for ranking in subject.rankings:
        title = " ".join(filter(None, in_words(ranking.condition)))
        titled[title if title not in titled else f"{title}, {ranking.protocol}"] = ranking
    return titled


def _leader(ranking: Ranking) -> Cell:
    primary = ranking.primary
    if primary is None:
        return Cell(NOTHING)
    best = furthest_ahead(primary)
    rates = {row.label: row.estimates["success_rate"].value for row in ranking.rows}
    pair = [rates[label] for label in (*([best.agent] if best else []), primary.baseline)]
    success = " and ".join(f"{100 * rate:.0f}" for rate in pair)
    rare = "" if min(pair) > FULL else f"; success {success} %"
    if best is None:
        return Cell(primary.baseline, f"(none ahead{rare})")
    difference = estimate_cell(best.difference, measure(ranking.rank_by).scale, signed=True)
    return Cell(f"{best.agent} {difference.value}", f"{difference.more}{_trainings(best)}{rare}")


def _difference(against: Against, scale: float) -> Cell:
    if not isfinite(against.difference.low):  # too few trainings for an interval
        return Cell(NOTHING)
    cell = estimate_cell(against.difference, scale, signed=True)
    star = "*" if against.starred else ""
    return Cell(
        f"{SYMBOLS[against.verdict]}{star} {cell.value}", f"{cell.more}{_trainings(against)}", cell.sort
    )


def _trainings(against: Against) -> str:
    reliable = against.own_reliability
    return f", {reliable.count} of {reliable.trainings}" if reliable else ""


def _level(subject: Subject) -> str:
    percent = f"{100 * subject.rankings[0].confidence:g} %"
    return f"The intervals of one condition and task hold together with {percent}; those of several do not."


def _short(subject: Subject, subjects: Sequence[Subject]) -> str:
    """Return the name of the task if all subjects have the same vehicle, else the names of vehicle and task."""
    vehicles = {other.name.partition(TASK)[0] for other in subjects}
    task = subject.name.partition(TASK)[2]
    return (task or "waypoint").replace("_", " ") if len(vehicles) == 1 else subject.name


def _titled(subject: Subject, title: str, several: bool) -> str:
    return f"{subject.name}: {title}" if several else capitalized(title)
