"""Describe in one line how a report differs from the declared analysis, and when the analysis was declared."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, fields
from datetime import datetime
from pathlib import Path

from auvbench.analysis.formatting import capitalized, counted, listed
from auvbench.analysis.grouping import failed_training, subject_of
from auvbench.analysis.load import readable_runs
from auvbench.analysis.records import Agent, Ranking, RunRecord, learns
from auvbench.runs.declared import KEY, Declared

NAMED = 3
"""Largest number of agents that a sentence names"""


@dataclass(frozen=True, slots=True)
class Analysed:
    """Options from which a report computes its verdicts."""

    rank_by: str
    baseline: str | None
    margin: float | None
    protocol: str
    condition: str
    confidence: float


@dataclass(frozen=True, slots=True)
class Plan:
    """Declared analysis of a section."""

    declared: Declared
    analysed: Analysed
    rows: frozenset[str]
    """Ids of the section's declared runs"""


def declared_rows(
    declared: Declared, folder: Path, protocol: str, loaded: Sequence[RunRecord] | None = None
) -> dict[str, frozenset[str]]:
    """Return the ids of the declared runs, by vehicle and task.

    A declaration written by an earlier version of auvbench does not name runs. In this case, all tested runs and
    all failed trainings in the declaration's folder count as declared.

    Args:
        declared: declaration.
        folder: folder of the declaration.
        protocol: declared protocol.
        loaded: all runs in the folder, if the caller has loaded them; None: read the folder if necessary.
    """
    rows: dict[str, set[str]] = {}
    if declared.names_runs:
        for stage in declared.rows:
            for subject, ids in stage.runs.items():
                rows.setdefault(subject, set()).update(ids)
    else:
        for run in readable_runs([folder]) if loaded is None else loaded:
            if failed_training(run) or protocol in run.source.protocols():
                rows.setdefault(subject_of(run), set()).add(run.id)
    return {subject: frozenset(ids) for subject, ids in rows.items()}


def sentence(
    plan: Plan, done: Analysed, runs: Sequence[RunRecord], agents: Sequence[Agent], ranking: Ranking
) -> str:
    """Return the sentence that says whether a table is the declared analysis, and when it was declared.

    Args:
        plan: declared analysis.
        done: options of the table.
        runs: runs of the section.
        agents: agents of the table.
        ranking: ranking of the table.
    """
    used = [run for run in runs if failed_training(run) or done.protocol in run.evaluations]
    differences = [
        *_options(plan, done, ranking),
        *_rows(plan, used, agents),
        *_scenarios(plan.declared, done.protocol, used),
    ]
    digest = plan.declared.digest
    if differences:
        return f"Not the declared analysis ({digest}): {'; '.join(differences)}."
    declared = plan.declared
    parts = [_when(declared, used), _later(declared, used, agents), _planned(declared, agents)]
    return " ".join(part for part in parts if part)


def undeclared(why: str) -> str:
    """Return the sentence for a report without a declared analysis; `why` is the reason if the runs have several."""
    return f"{capitalized(why or 'no analysis was declared before the runs')}."


def _options(plan: Plan, done: Analysed, ranking: Ranking) -> list[str]:
    """Return the options that differ from the declaration, as command-line flags, and a text on a replaced baseline."""
    declared = plan.analysed
    differences = [
        f"--{field.name.replace('_', '-')} {getattr(done, field.name)}"
        for field in fields(Analysed)
        if _plain(getattr(done, field.name)) != _plain(getattr(declared, field.name))
    ]
    primary = ranking.primary
    if primary is not None and declared.baseline is not None and done.baseline == declared.baseline:
        names = {row.label.casefold() for row in ranking.rows} | {
            str(row.key.get("algo")).casefold() for row in ranking.rows
        }
        if declared.baseline.casefold() not in names:
            differences.append(f"the baseline is {primary.baseline} instead of {declared.baseline}")
    return differences


def _plain(value: object) -> object:
    return value.casefold() if isinstance(value, str) else value


def _rows(plan: Plan, used: Sequence[RunRecord], agents: Sequence[Agent]) -> list[str]:
    """Return which declared runs are missing, and which runs were not declared."""
    ids = {run.id for run in used}
    differences = []
    if missing := plan.rows - ids:
        of = f"{len(missing)} of {counted(len(plan.rows), 'declared run')}"
        is_missing = "is" if len(missing) == 1 else "are"
        names = sorted({_algorithm(id) for id in missing})
        differences.append(f"{of} {is_missing} missing ({listed(names, NAMED)})")
    if added := ids - plan.rows:
        of = counted(len(added), "run")
        differences.append(
            f"{of} {'was' if len(added) == 1 else 'were'} not declared ({_joined(_labels(agents, added))})"
        )
    return differences


def _algorithm(id: str) -> str:
    """Return the beginning of a run's id, which names algorithm, vehicle and task.

    >>> _algorithm("ppo-rexrov-k1-f10-s42-5a6b7c8d")
    'ppo-rexrov'
    """
    return re.sub(r"-k[^k]*$", "", id)


def _labels(agents: Sequence[Agent], ids: Collection[str]) -> list[str]:
    """Return labels for the runs in `ids`: an agent's label for all of its runs, '2 trainings of LABEL' for some."""
    labels = []
    for agent in agents:
        own = {run.id for run in agent.runs}
        if n := len(own & set(ids)):
            labels.append(agent.label if n == len(own) else f"{counted(n, 'training')} of {agent.label}")
    if not labels:
        labels = sorted({_algorithm(id) for id in ids})
    return labels


def _joined(labels: Sequence[str]) -> str:
    """Return the first labels in one line, joined by semicolons because a label may contain commas."""
    more = [f"{len(labels) - NAMED} more"] if len(labels) > NAMED else []
    return "; ".join([*labels[:NAMED], *more])


def _scenarios(declared: Declared, protocol: str, used: Sequence[RunRecord]) -> list[str]:
    """Return how the tests differ from the declared protocol."""
    if not declared.names_runs or protocol != declared.protocol:
        return []
    differences: dict[str, None] = {}
    for run in used:
        if (evaluation := run.evaluations.get(protocol)) is None:
            continue
        summary = evaluation.summary
        if (seed := summary["seed"]) != declared.scenario_seed:
            differences[f"scenarios of seed {seed} instead of {declared.scenario_seed}"] = None
        for condition in summary["conditions"]:
            if condition["episodes"] != declared.episodes:
                differences[f"{condition['episodes']} test episodes instead of {declared.episodes}"] = None
            if condition["name"] not in declared.conditions:
                differences[f"condition {condition['name']} was not declared"] = None
    return list(differences)[:NAMED]


def _carry(declared: Declared, used: Sequence[RunRecord]) -> int:
    """Return the number of runs that were created under the declaration."""
    digests = declared.digests
    return sum(run.manifest.get(KEY) in digests for run in used)


def _when(declared: Declared, used: Sequence[RunRecord]) -> str:
    """Return a sentence on when the analysis was declared; if the declaration names no runs, also on what it declares."""
    under = _carry(declared, used)
    if under < len(used):
        after = f"{len(used) - under} of {counted(len(used), 'run')}"
        return f"The analysis ({declared.digest}) was declared after {after} were made."
    if declared.names_runs:
        first = declared.rows[0]
        return f"The analysis was declared on {_day(_time(first.declared))}, before the first run ({declared.digests[0]})."
    covered, excluded = ["measure", "baseline", "margin"], ["agents", "seeds", "protocol", "conditions"]
    if declared.seeds:
        covered, excluded = [*covered, "the number of seeds"], ["agents", *excluded[2:]]
    return (
        f"Declared before the first run ({declared.digest}): {listed(covered)}. {capitalized(listed(excluded))} were not part "
        "of the declaration."
    )


def _later(declared: Declared, used: Sequence[RunRecord], agents: Sequence[Agent]) -> str:
    """Return which runs were declared when results of other runs already existed."""
    if not _carry(declared, used):
        return ""
    ended = sorted(time for run in used if (time := _time(run.manifest.get("ended"))) is not None)
    groups: dict[str, list[tuple[int, str]]] = {}
    for run in used:
        declared_at = _declared_at(declared, run)
        if declared_at is not None and (earlier := sum(time < declared_at for time in ended)):
            groups.setdefault(_day(declared_at), []).append((earlier, run.id))
    texts = []
    for day, counts in groups.items():
        labels = _joined(_labels(agents, {id for _, id in counts}))
        texts.append(f"{labels} ({day}, after {min(counts)[0]} of {len(used)} runs)")
    word = "Declared" if declared.names_runs else "Added"
    return f"{word} later: {'; '.join(texts)}." if texts else ""


def _declared_at(declared: Declared, run: RunRecord) -> datetime | None:
    """Return when a run was declared; None if unknown.

    If a stage of the declaration names the run, and the run's manifest has the digest of this stage, return the
    stage's date. Otherwise return the date on which the run was created.
    """
    stage = declared.stage_of(run.id)
    if stage is not None and run.manifest.get(KEY) == stage[1]:
        return _time(stage[0].declared)
    return _time(run.manifest.get("created"))


def _time(text: object) -> datetime | None:
    try:
        time = datetime.fromisoformat(str(text))
    except ValueError:
        return None
    return time if time.tzinfo is not None else None


def _day(time: datetime | None) -> str:
    """Return a date as '27 November 2026'."""
    return "an unknown date" if time is None else f"{time.day} {time:%B %Y}"


def _planned(declared: Declared, agents: Sequence[Agent]) -> str:
    """Return which learners have a different number of seeds than planned."""
    counts = [(agent.label, len(agent.runs)) for agent in agents if learns(agent)]
    other = [f"{label} has {n}" for label, n in counts if n != declared.seeds]
    if not declared.seeds or not other:
        return ""
    return f"Planned: {counted(declared.seeds, 'seed')}; {listed(other, NAMED)}."
