"""Write what `auvbench publish` computes from the copied rows: tables, figures, policies, and the blocks of
the README.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from auvbench.commands.report_options import OF_THE_TABLE, STORED, Options, defaults

if TYPE_CHECKING:
    from auvbench.analysis.records import Report, RunRecord
    from auvbench.runs.declared import Declared


@dataclass(frozen=True, slots=True)
class Study:
    """Options of publish itself, without report's flags."""

    folder: Path
    also: tuple[str, ...]
    pictures: tuple[str, ...]
    paths: bool
    compact: bool
    policies: bool
    command: str


def check(study: Study, options: Options) -> None:
    """Check, before anything is written, that an existing README has a place for each block.

    Raises:
        UserError: a block has no place.
    """
    from auvbench.reporting import readme

    readme.check(study.folder / "README.md", _blocks(study, options))


def rehearse(paths: Sequence[Path], study: Study, options: Options) -> None:
    """Check, before anything is written, that a report of the runs with these options is possible.

    Raises:
        UserError: it is not possible, or an option has an unknown name.
    """
    from auvbench.commands.report import analysed

    analysed(paths, options)
    for name in study.also:
        analysed(paths, _further(options, name))


def _further(options: Options, protocol: str) -> Options:
    return replace(options, protocol=protocol, condition=None, study=None)


def _blocks(study: Study, options: Options) -> list[str]:
    from auvbench.reporting import best_policies

    policies = study.policies or best_policies.has_policies(study.folder)
    chosen = {"figures": bool(study.pictures), "claims": bool(options.study), "policies": policies}
    return [
        name
        for name in ("table", "findings", "figures", "claims", "policies", "provenance")
        if chosen.get(name, True)
    ]


def write(study: Study, options: Options, sources: Mapping[str, RunRecord]) -> tuple[int, int]:
    """Compute the report from the published files and write it.

    Args:
        study: options of publish.
        options: options of the report.
        sources: runs as loaded, by id; they have the weights of the policies.

    Returns:
        Number of runs in the report, and number of policies that could not be exported.
    """
    from auvbench.commands.report import analysed
    from auvbench.reporting import readme
    from auvbench.reporting import write as files
    from auvbench.runs import declared, history

    folder = study.folder
    analysis = _stored(options)
    declared.write(folder, analysis)
    chosen = replace(options, format=("csv",), where=(), out=folder, undecided="")
    chosen = replace(chosen, declared=analysis, declared_in=folder, usual=chosen)
    reports = analysed([folder], chosen)
    further = [(name, analysed([folder], _further(chosen, name))) for name in study.also]
    protocols = [(options.protocol, reports), *further]
    _tables(protocols, folder)
    scored = _scores(protocols, chosen, folder)
    runs = [run for report in reports for run in report.runs]
    names = _blocks(study, options)
    policies, missing = _policies(reports, study, sources) if "policies" in names else ("", 0)
    texts = {
        "table": lambda: "\n\n".join([*scored, _ranked(reports, folder)]),
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
    if any(place in text for place in (readme.QUESTION, readme.ANSWER, readme.CAVEATS)):
        print(f"next: replace the brackets in {path} by question, answer and caveats")
    return len(runs), missing


def _tables(protocols: Sequence[tuple[str, Sequence[Report]]], folder: Path) -> None:
    """Write table.csv and verdicts.json of the first protocol, and conditions.csv of all protocols."""
    from auvbench.commands.report_sections import rows
    from auvbench.reporting import tables
    from auvbench.reporting import write as files

    reports = protocols[0][1]
    files.text(folder / "table.csv", rows(reports, tables.csv))
    files.if_any(folder / "verdicts.json", files.verdicts(reports))
    conditions = [
        (name, rows(protocol_reports, tables.conditions_csv)) for name, protocol_reports in protocols
    ]
    files.if_any(folder / "conditions.csv", tables.joined("protocol", conditions))


def _scores(protocols: Sequence[tuple[str, Sequence[Report]]], options: Options, folder: Path) -> list[str]:
    """Write score.csv of all protocols; return the tables across tasks as Markdown, or none if the study has
    one task.
    """
    from auvbench.commands.report_sections import across_tasks
    from auvbench.reporting import tables
    from auvbench.reporting import write as files

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


def _stored(options: Options) -> Declared:
    """Return the analysis that reproduces the shipped tables when the study is reported without flags."""
    from auvbench.runs.declared import Declared

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


def _policies(reports: Sequence[Report], study: Study, sources: Mapping[str, RunRecord]) -> tuple[str, int]:
    """Return the README block, and the number of policies that could not be exported."""
    from auvbench.reporting import best_policies

    rows = best_policies.renew(
        [best_policies.best(r.agents, r.ranking.rank_by) for r in reports],
        sources,
        study.folder,
        export=study.policies,
    )
    without = [row for row in rows if row.problem]
    for row in without:
        print(f"cannot export a policy of {row.agent} ({row.run}): {row.problem}")
    return best_policies.markdown(rows), len(without)


def _ranked(reports: Sequence[Report], folder: Path) -> str:
    """Return headline, main figure and main table of each section; with several sections, the tables are folded."""
    from auvbench.reporting import tables
    from auvbench.reporting.figures import MAIN
    from auvbench.reporting.readme import fold

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
    """Return the heading of a section, empty if the study has only one."""
    return f"### {report.section.title[:1].upper()}{report.section.title[1:]}"


def _findings(reports: Sequence[Report]) -> str:
    """Return the findings of each section; the first five are visible, the rest folded."""
    from auvbench.reporting.write import findings_in_markdown

    headings = [f"{_heading(report)}\n\n" if len(reports) > 1 else "" for report in reports]
    texts = [findings_in_markdown(report.findings) or "None." for report in reports]
    return "\n\n".join(map(str.__add__, headings, texts))


def _claims(reports: Sequence[Report]) -> str:
    """Return the study's claims with their verdicts, and its published numbers next to ours, for each section
    that has them.
    """
    from auvbench.reporting import tables
    from auvbench.reporting.write import claims_in_markdown

    parts = []
    for report in reports:
        if report.claims:
            parts.append(claims_in_markdown(report.claims))
        if comparison := tables.comparison_table(report.comparison):
            parts.append("\n" + tables.pipes(comparison))
    return "\n".join(parts) or "No claim of the study can be tested."


def _figures(report: Report, pictures: Sequence[str], folder: Path, section: str = "") -> list[str]:
    """Draw figures of a section into `figures`, or `figures/SECTION`; return them as Markdown."""
    from auvbench.reporting.figures import draw
    from auvbench.reporting.tables.text_formats import escape

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
"""colours of a picture; lines and areas need no more"""


def _shrink(png: Path) -> None:
    """Reduce a picture to `COLOURS`, which saves two thirds of the bytes."""
    from PIL import Image  # a dependency of Matplotlib

    from auvbench.runs.atomic_io import write_atomic

    stream = io.BytesIO()
    with Image.open(png) as image:
        flat = image.convert("RGB").quantize(COLOURS, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
        flat.save(stream, "png", optimize=True)
    write_atomic(png, stream.getvalue())
