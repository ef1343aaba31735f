"""Publish a study: copy the rows of runs, and compute tables, figures and the blocks of a README from the copies.

The best policies are exported from the runs themselves.
"""

from __future__ import annotations

import io
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from auvbench.analysis.analyse import across_tasks, analyse
from auvbench.analysis.archive import RUNS, Archive, is_archive
from auvbench.analysis.by_condition import Subject, compare, of_protocol
from auvbench.analysis.damage import Damage
from auvbench.analysis.formatting import counted, listed
from auvbench.analysis.grouping import failed_training
from auvbench.analysis.load import load, require
from auvbench.analysis.options import OF_THE_TABLE, STORED, Options, defaults
from auvbench.analysis.records import Report, RunRecord
from auvbench.errors import ReportError
from auvbench.reporting import archive, best_policies, readme, tables
from auvbench.reporting import write as files
from auvbench.reporting.figures import MAIN, draw
from auvbench.reporting.folder import rows
from auvbench.reporting.readme import fold
from auvbench.reporting.tables.text_formats import escape
from auvbench.reporting.write import claims_in_markdown, findings_in_markdown
from auvbench.runs import declared, history
from auvbench.runs.atomic_io import write_atomic
from auvbench.runs.declared import Declared

NAMED = 3
"""largest number of runs that a message names; the other runs are only counted"""


@dataclass(frozen=True, slots=True)
class Study:
    """Options of `auvbench publish` in addition to the options of a report."""

    folder: Path
    pictures: tuple[str, ...]
    paths: bool
    compact: bool
    policies: bool
    command: str


@dataclass(frozen=True, slots=True)
class Published:
    """Result of `publish`."""

    runs: int
    """number of runs in the report"""
    complete: bool
    """whether no item was left out"""
    lines: tuple[str, ...]
    """messages on items that were left out, and on the next steps"""


def publish(paths: Sequence[Path], study: Study, options: Options) -> Published:
    """Publish the runs under some paths.

    Args:
        paths: run directories, or folders that contain them.
        study: options of publish.
        options: options of the report.

    Raises:
        UserError: the README has no place for a block, an option has an unknown name, or no report is possible;
            no file is written in these cases.
        ReportError: the study's folder contains run directories, or publishing would remove runs of the study.
        OSError: a file cannot be written.
    """
    readme.check(study.folder / "README.md", _blocks(study, options))
    for protocol_options in (options, *(of_protocol(options, name) for name in options.also)):
        analyse(paths, protocol_options)
    runs, omitted, duplicates = _copy(paths, options, study)
    count, without, further = _compute(study, options, {run.id: run for run in runs})
    lines = (*(f"not published: {line}" for line in omitted), *duplicates, *without, *further)
    return Published(count, not omitted and not without, lines)


def _blocks(study: Study, options: Options) -> list[str]:
    policies = study.policies or best_policies.has_policies(study.folder)
    readme_path = study.folder / "README.md"
    conditions = bool(options.also) and (not readme_path.exists() or readme.has(readme_path, "conditions"))
    chosen = {
        "conditions": conditions,
        "figures": bool(study.pictures),
        "claims": bool(options.study),
        "policies": policies,
    }
    return [name for name in readme.PARTS if chosen.get(name, True)]


def _copy(
    paths: Sequence[Path], options: Options, study: Study
) -> tuple[list[RunRecord], list[str], list[str]]:
    """Write the files of the runs.

    Returns:
        Loaded runs that were written, a line for each item left out, and a line for each duplicate.

    Raises:
        ReportError: no run can be published, or the study's folder contains runs.
    """
    folder = study.folder
    protocols = (options.protocol, *options.also)
    runs, problems = load(paths, protocols, options.where)
    require(runs, problems, options.protocol)
    for run in runs:
        if not run.source.published and folder.resolve() in run.directory.resolve().parents:
            raise ReportError(f"--to {folder}: contains the run {run.directory}; name a folder without runs")
    chosen = [run for run in runs if run.evaluations or failed_training(run)]
    ids = {run.id for run in chosen}
    _refuse_loss(folder, ids)
    omitted = archive.write(chosen, folder, protocols, trajectories=study.paths, compact=study.compact)
    omitted += archive.write_history(runs, folder)
    untested = [p for p in problems if p.kind == "missing"]
    omitted += [
        f"{p.where}: {p.message}"
        for p in problems
        if p.kind not in ("missing", "duplicate") and not (p.kind == "failed" and p.where in ids)
    ]
    if untested:
        omitted.append(f"{listed([p.where for p in untested], NAMED)}: {untested[0].message}")
    return chosen, omitted, [f"{p.where}: {p.message}" for p in problems if p.kind == "duplicate"]


def _refuse_loss(folder: Path, chosen: Collection[str]) -> None:
    """Raise ReportError if publishing would remove runs: the study in the folder has runs that `chosen` lacks."""
    if not is_archive(folder):
        return
    try:
        lost = [name for name in Archive(folder).ids() if name not in chosen]
    except Damage as damage:
        raise ReportError(f"{folder}: {damage}; remove {RUNS} to publish again") from damage
    if lost:
        raise ReportError(
            f"{folder} has {counted(len(lost), 'run')} that would be lost, for example {lost[0]}; to keep them, also name {folder} "
            f"as a source; otherwise publish into another folder, or remove {folder / RUNS}"
        )


def _compute(
    study: Study, options: Options, sources: Mapping[str, RunRecord]
) -> tuple[int, list[str], list[str]]:
    """Compute the report from the published files and write it.

    Args:
        study: options of publish.
        options: options of the report.
        sources: loaded runs by id, with the weights of their policies.

    Returns:
        Number of runs in the report; a line for each policy that could not be exported; lines that name the
            author's next steps.
    """
    folder = study.folder
    analysis = _stored(options)
    declared.write(folder, analysis)
    chosen = replace(options, format=("csv",), where=(), out=folder, undecided="")
    chosen = replace(chosen, declared=analysis, declared_in=folder, usual=chosen)
    reports = analyse([folder], chosen)
    tested_also = [(name, analyse([folder], of_protocol(chosen, name))) for name in options.also]
    protocols = [(options.protocol, reports), *tested_also]
    _tables(protocols, folder)
    scored = _scores(protocols, chosen, folder)
    runs = [run for report in reports for run in report.runs]
    names = _blocks(study, options)
    tested = [(chosen, reports), *((of_protocol(chosen, name), found) for name, found in tested_also)]
    subjects = compare(tested) if "conditions" in names else []
    files.if_any(folder / "by_condition.csv", tables.by_condition_csv(subjects))
    policies, without = _policies(reports, study, sources) if "policies" in names else ("", [])
    texts = {
        "table": lambda: "\n\n".join([*scored, _ranked(reports, folder)]),
        "conditions": lambda: _by_condition(subjects),
        "findings": lambda: _findings(reports),
        "figures": lambda: "\n\n".join(_figures(reports[0], study.pictures, folder)) or "No figure.",
        "claims": lambda: _claims(reports),
        "policies": lambda: policies,
        "provenance": lambda: readme.provenance(runs, study.command, history.read(folder)),
    }
    path = folder / "README.md"
    blocks = {name: texts[name]() for name in names}
    text = readme.fill(path, study.folder.resolve().name, blocks)
    files.text(path, text)
    unfilled = any(place in text for place in (readme.QUESTION, readme.ANSWER, readme.CAVEATS))
    further = [f"next: replace the brackets in {path} by question, answer and caveats"] if unfilled else []
    return len(runs), without, further


def _tables(protocols: Sequence[tuple[str, Sequence[Report]]], folder: Path) -> None:
    """Write table.csv and verdicts.json of the first protocol, and conditions.csv of all protocols."""
    reports = protocols[0][1]
    files.text(folder / "table.csv", rows(reports, tables.csv))
    files.if_any(folder / "verdicts.json", files.verdicts(reports))
    conditions = [
        (name, rows(protocol_reports, tables.conditions_csv)) for name, protocol_reports in protocols
    ]
    files.if_any(folder / "conditions.csv", tables.joined("protocol", conditions))


def _scores(protocols: Sequence[tuple[str, Sequence[Report]]], options: Options, folder: Path) -> list[str]:
    """Write score.csv of all protocols, and return the tables of scores across tasks as Markdown.

    The result is empty if the study has only one task.
    """
    protocol_scores = [
        (name, across_tasks(reports, replace(options, protocol=name))) for name, reports in protocols
    ]
    scores = [(name, score) for name, score in protocol_scores if score is not None]
    files.if_any(
        folder / "score.csv", tables.joined("protocol", [(n, tables.score_csv(s)) for n, s in scores])
    )
    return [
        f"### Score across tasks, {'all conditions of ' if s.cells > len(s.titles) else 'undisturbed, '}protocol {n}\n\n"
        f"{tables.pipes(tables.score_table(s))}"
        for n, s in scores
    ]


def _by_condition(subjects: Sequence[Subject]) -> str:
    """Return Markdown with the table of the agents furthest ahead, and the folded tables of each task."""
    first, *further = tables.by_condition_tables(subjects)
    folded = [fold(table.title, tables.pipes(table)) for table in further]
    return "\n\n".join([f"### {first.title}", tables.pipes(first), *folded])


def _stored(options: Options) -> Declared:
    """Return the analysis to store with the study, so that `auvbench report` without flags gives the same tables."""
    usual = defaults()
    declared = options.declared
    names = OF_THE_TABLE if declared is not None and declared.names_runs else STORED
    other = {name: getattr(options, name) for name in names if getattr(options, name) != getattr(usual, name)}
    report = {name: list(value) if isinstance(value, tuple) else value for name, value in other.items()}
    if declared is None or not declared.names_runs:
        planned = None if declared is None else declared.seeds
        return Declared(options.rank_by, options.baseline, options.margin, planned, report=report)
    first = [options.condition] if options.condition else []
    remaining = [name for name in declared.conditions if name not in first]
    return replace(
        declared,
        measure=options.rank_by,
        baseline=options.baseline,
        margin=options.margin,
        protocol=options.protocol,
        conditions=(*first, *remaining),
        report=report,
    )


def _policies(
    reports: Sequence[Report], study: Study, sources: Mapping[str, RunRecord]
) -> tuple[str, list[str]]:
    """Return the README block of the policies, and a line for each policy that could not be exported."""
    exported = best_policies.renew(
        [best_policies.best(r.agents, r.ranking.rank_by) for r in reports],
        sources,
        study.folder,
        export=study.policies,
    )
    without = [f"cannot export a policy of {p.agent} ({p.run}): {p.problem}" for p in exported if p.problem]
    return best_policies.markdown(exported), without


def _ranked(reports: Sequence[Report], folder: Path) -> str:
    """Return headline, main figure and main table of each section; with several sections, the tables are folded."""
    parts = []
    for report in reports:
        if len(reports) > 1:
            parts.append(_heading(report))
        figure = _figures(report, [MAIN], folder, report.section.folder if report is not reports[0] else "")
        parts.append(tables.answer(report.ranking, "\n\n".join(figure)))
        details = tables.details(report.ranking)
        parts.append(details if len(reports) == 1 else fold(f"Table of {len(report.agents)} agents", details))
        parts += [
            fold(table.title, tables.pipes(table)) for table in tables.conditions_tables(report.ranking)
        ]
    return "\n\n".join(parts)


def _heading(report: Report) -> str:
    """Return the heading of a section in Markdown."""
    return f"### {report.section.title[:1].upper()}{report.section.title[1:]}"


def _findings(reports: Sequence[Report]) -> str:
    """Return the findings of each section; the first five are visible, the rest folded."""
    headings = [f"{_heading(report)}\n\n" if len(reports) > 1 else "" for report in reports]
    texts = [findings_in_markdown(report.findings) or "None." for report in reports]
    return "\n\n".join(map(str.__add__, headings, texts))


def _claims(reports: Sequence[Report]) -> str:
    """Return Markdown for each section: claims of the original study with verdicts, and the study's numbers next to ours."""
    parts = []
    for report in reports:
        if report.claims:
            parts.append(claims_in_markdown(report.claims))
        if comparison := tables.comparison_table(report.comparison):
            parts.append("\n" + tables.pipes(comparison))
    return "\n".join(parts) or "No claim of the study can be tested."


def _figures(report: Report, pictures: Sequence[str], folder: Path, section: str = "") -> list[str]:
    """Draw figures of a section into `figures/SECTION`, or `figures` without a section; return them as Markdown."""
    drawn = draw(pictures, report.agents, report.ranking, folder / "figures" / section)
    for figure in drawn:
        figure.svg.unlink(missing_ok=True)
        _shrink(figure.png)
    places = [figure.png.relative_to(folder).as_posix() for figure in drawn]
    return [
        f"![{escape(f.title)}]({place})\n\n{escape(f.caption)}"
        for f, place in zip(drawn, places, strict=True)
    ]


COLOURS = 128
"""number of colours in a picture, sufficient for lines and areas"""


def _shrink(png: Path) -> None:
    """Reduce a picture to `COLOURS` colours, which saves two thirds of the bytes."""
    from PIL import Image  # a dependency of Matplotlib

    stream = io.BytesIO()
    with Image.open(png) as image:
        flat = image.convert("RGB").quantize(COLOURS, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
        flat.save(stream, "png", optimize=True)
    write_atomic(png, stream.getvalue())
