"""Analyse runs: from paths to a ranked table for each section, and a score across tasks."""

from __future__ import annotations

import os
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from auvbench.analysis import claims, score, thesis
from auvbench.analysis.conditions import default, sealed_note
from auvbench.analysis.declaration import Analysed, Plan, declared_rows, sentence, undeclared
from auvbench.analysis.effort import with_effort
from auvbench.analysis.findings import find
from auvbench.analysis.grouping import SEVERAL, Section, sections, split_problems, subject_of
from auvbench.analysis.load import agents, load, require
from auvbench.analysis.measures import in_unit, to_rank_by
from auvbench.analysis.names import name_agents
from auvbench.analysis.optional_columns import add_optimality, validate_columns, with_columns
from auvbench.analysis.options import Options
from auvbench.analysis.primary import find_baseline
from auvbench.analysis.ranking import one_run_of_a_controller, rank
from auvbench.analysis.records import Agent, ClaimVerdict, Problem, Ranking, Report, RunRecord, task_of
from auvbench.analysis.score import Scores
from auvbench.analysis.thesis import ComparisonRow
from auvbench.config.tasks import primary_of
from auvbench.errors import ReportError, closest
from auvbench.record import PRIMARY
from auvbench.registry import TASKS


def analyse(paths: Sequence[Path], options: Options) -> list[Report]:
    """Analyse the runs under some paths, and return one report for each section of runs.

    If a section cannot be reported, the first report lists the reason.

    Raises:
        UserError: an option has an unknown name, or no section can be reported.
    """
    if options.rank_by != PRIMARY:
        to_rank_by(options.rank_by)  # report a wrong name before any run is read
    for task, measure in options.primary.items():
        to_rank_by(measure, f"report: primary.{task}")
    validate_columns(options.columns)
    runs, problems = load(paths, options.protocol, options.where)
    runs = name_agents(runs, options.names)
    require(runs, problems, options.protocol)
    parts = sections(runs, options.protocol)
    measures = dict.fromkeys(_measure(part, options) for part in parts)
    if options.margin is not None and len(measures) > 1:
        raise ReportError(
            f"--margin {options.margin:g}: the tasks are ranked by {', '.join(measures)}, which have "
            "different units; leave --margin "
            "out (null in a declared analysis), or name one task: --where task=NAME"
        )
    condition = options.condition or default(runs, options.protocol)
    rows = _declared_rows(paths, runs, options)
    reports: list[Report] = []
    refused: list[tuple[str, ReportError]] = []
    for part, own in zip(parts, split_problems(problems, parts), strict=True):
        try:
            reports.append(_analyse(part, own, condition, options, rows, several=len(parts) > 1))
        except ReportError as error:
            refused.append((part.title, error))
    if not reports:
        raise refused[0][1]
    if options.baseline is not None and all(report.without_baseline for report in reports):
        labels = sorted({agent.label for report in reports for agent in report.agents})
        raise ReportError(
            f"--baseline {options.baseline!r}: no such agent in any of the {len(reports)} sections; "
            f"{closest(options.baseline, labels)}"
        )
    named = [Problem(title, "missing", str(error)) for title, error in refused]
    first = reports[0].ranking
    reports[0] = replace(reports[0], ranking=replace(first, problems=(*first.problems, *named)))
    return reports


def _declared_rows(
    paths: Sequence[Path], runs: Sequence[RunRecord], options: Options
) -> Mapping[str, frozenset[str]] | None:
    """Return the ids of the declared runs by vehicle and task; None without a declared analysis."""
    if options.declared is None or options.declared_in is None or options.usual is None:
        return None
    folder = options.declared_in
    uses_all_runs = not options.where and all(path.resolve() == folder for path in paths)
    return declared_rows(options.declared, folder, options.usual.protocol, runs if uses_all_runs else None)


def _declaration(
    part: Section,
    agents: Sequence[Agent],
    ranking: Ranking,
    condition: str,
    options: Options,
    rows: Mapping[str, frozenset[str]] | None,
) -> str:
    """Return the sentence on the declared analysis of a section."""
    if options.declared is None or options.usual is None or rows is None:
        return undeclared(options.undecided)

    def analysed(chosen: Options, condition: str) -> Analysed:
        measure = _measure(part, chosen)
        return Analysed(
            measure, chosen.baseline, chosen.margin, chosen.protocol, condition, chosen.confidence
        )

    usual = options.usual
    declared = [rows.get(subject, frozenset()) for subject in {subject_of(run) for run in part.runs}]
    plan = Plan(
        options.declared,
        analysed(usual, usual.condition or default(part.runs, options.protocol)),
        frozenset[str]().union(*declared),
    )
    return sentence(plan, analysed(options, condition), part.runs, agents, ranking)


def _analyse(
    part: Section,
    problems: Sequence[Problem],
    condition: str,
    options: Options,
    rows: Mapping[str, frozenset[str]] | None,
    several: bool,
) -> Report:
    """Return the report of one section; if it is one of several sections (`several`), it may lack the baseline."""
    grouped, more = agents(part.runs, options.protocol, condition)
    grouped = [one_run_of_a_controller(agent) for agent in grouped]
    rank_by = _measure(part, options)
    baseline = options.baseline
    # One of several sections may lack the baseline, and a subset of the runs may lack the declared baseline.
    declared = options.declared is not None and baseline == options.declared.baseline
    if baseline is not None and (several or declared):
        try:
            find_baseline(grouped, baseline)
        except ReportError as error:
            baseline, more = None, [*more, Problem(part.title, "missing", str(error))]
    ranking = rank(
        grouped,
        rank_by=rank_by,
        baseline=baseline,
        confidence=options.confidence,
        margin=in_unit(options.margin, rank_by),
        protocol=options.protocol,
        condition=condition,
        problems=(*problems, *part.problems, *more),
    )
    note = _declaration(part, grouped, ranking, condition, options, rows)
    seal = sealed_note(part.runs, options.protocol)
    ranking = replace(add_optimality(ranking, grouped), declaration=note, sealed=seal)
    ranking = with_columns(ranking, grouped, options.columns)
    ranking = with_effort(ranking, grouped, options.trials)
    by_label = {agent.label: agent for agent in grouped}
    ordered = [by_label[row.label] for row in ranking.rows]  # The best agents get the most distinct colours.
    claims, numbers = _study(part.runs, ordered, options)
    missing = options.baseline is not None and baseline is None and not declared
    return Report(part, ordered, ranking, find(ranking, ordered), claims, numbers, missing)


def _measure(part: Section, options: Options) -> str:
    """Return the measure that ranks the agents of the section: the option, or the task's primary measure."""
    if options.rank_by != PRIMARY:
        return options.rank_by
    task = str(part.runs[0].config.get("task.name"))
    return options.primary.get(task) or primary_of(task)


def _study(
    runs: Sequence[RunRecord], agents: Sequence[Agent], options: Options
) -> tuple[Sequence[ClaimVerdict], Sequence[ComparisonRow]]:
    if options.study is None:
        return (), ()
    judged = claims.judge(runs, agents, confidence=options.confidence, seed=0)
    return judged, thesis.compare(agents, options.confidence)


def across_tasks(reports: Sequence[Report], options: Options) -> Scores | None:
    """Return the score across tasks; None for fewer than two tasks, or if the scores of a section have no scale.

    The scores have no scale if the section's agents have the sheets of several vehicles, because each sheet has
    its own PID. Of several sections with the same vehicle and task, only the largest is used.
    """
    parts: dict[str, Report] = {}
    for report in reports:
        parts.setdefault(report.section.vehicle, report)
    if len({_task(report) for report in parts.values()}) < 2:
        return None
    if any(subject.startswith(SEVERAL) for subject in parts):
        return None
    place_of = {name: place for place, name in enumerate(TASKS)}
    parts = dict(sorted(parts.items(), key=lambda part: place_of.get(_task(part[1]), len(place_of))))
    one_vehicle = len({report.runs[0].config.get("vehicle.name") for report in parts.values()}) == 1
    tested = [
        score.OneTask(
            _task(report).replace("_", " ") if one_vehicle else subject,
            to_rank_by(report.ranking.rank_by),
            _by_condition(report, options),
            {name: _adding(report, name, options.protocol) for name in (score.ZERO, score.ONE)},
        )
        for subject, report in parts.items()
    ]
    return score.scores(tested, options.protocol, options.confidence)


def _task(report: Report) -> str:
    return task_of(report.runs[0])


def _by_condition(report: Report, options: Options) -> dict[str, Sequence[Agent]]:
    """Return the agents of a section by condition of the protocol."""
    names = [condition.name for condition in report.ranking.conditions]
    if not names:
        return {report.ranking.condition: report.agents}
    by_name: dict[str, Sequence[Agent]] = {}
    for name in names:
        met, _ = agents(report.runs, options.protocol, name)
        by_name[name] = [one_run_of_a_controller(agent) for agent in met]
    return by_name


def _adding(report: Report, algorithm: str, protocol: str) -> str:
    """Return a sentence with the commands that train and test an algorithm, so that its runs join a section."""
    run = report.runs[0]
    config = run.config
    words = [f"{key}={config.get(f'{key}.name')}" for key in ("task", "vehicle")]
    folder = run.directory.parent
    output = os.path.relpath(folder.resolve().parent)
    words += [f"algo={algorithm}", *([] if output == "outputs" else [f"output={output}"])]
    train = ["auvbench", "train", *words, f"name={folder.resolve().name}"]
    test = ["auvbench", "evaluate", str(folder)]
    test += [] if protocol == "test" else [f"protocol={protocol}"]
    return f"{shlex.join(train)} && {shlex.join(test)} adds them."
