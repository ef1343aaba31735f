"""Write the page: collect what the template shows, and embed style, script and data."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup

from auvbench.analysis.findings import SHOWN
from auvbench.analysis.formatting import capitalized
from auvbench.analysis.primary import headline
from auvbench.analysis.ranking import FINER
from auvbench.analysis.records import Ranking, Report, RunRecord
from auvbench.analysis.score import Scores
from auvbench.registry import TASKS
from auvbench.reporting.figures import MAIN, Figure
from auvbench.reporting.figures.looks import Look, colour_of
from auvbench.reporting.page import parts as of_page
from auvbench.reporting.page import trajectories
from auvbench.reporting.tables.appendix import comparison_table, conditions_tables, ranks_table, score_table
from auvbench.reporting.tables.main import grouped, limit_lines, main_table
from auvbench.reporting.tables.table import SHOWN_NOTES, Table
from auvbench.reporting.write import Facts, distinct, facts, overview, text
from auvbench.runs.identity import DEFAULT_TASK

SCRIPTS = ("tables.js", "pen.js", "camera.js", "scene.js", "chart.js", "viewer.js")
"""Source files of the page's script, in the order of concatenation."""
_DASHES = {"-": "solid", "--": "dashed", "-.": "dashdot", ":": "dotted"}


def write(
    path: Path,
    report: Report,
    figures: Sequence[Figure] = (),
    by_condition: Sequence[Table] = (),
    *,
    command: str = "",
    several: bool = False,
) -> Path:
    """Write the report of a section as one self-contained HTML file and return its path.

    The file contains style, script, figures and trajectories. Links to the files of the runs are relative, so the
    page and the runs can be moved together. The same arguments give the same bytes.

    Args:
        path: file to write, usually `report/index.html`; its folders are created.
        report: report of the section.
        figures: figures in the order to show.
        by_condition: tables that compare agents under several conditions.
        command: command line of the report.
        several: whether the report has several sections; `../index.html` then shows all sections.

    Raises:
        OSError: the file cannot be written.
    """
    ranking, agents, runs = report.ranking, report.agents, report.runs
    looks = colour_of(agents)
    hues = {label: look.colour for label, look in looks.items()}
    links = of_page.Links(path, runs)
    tracks, damaged, left_out = trajectories.read(
        agents, protocol=ranking.protocol, condition=ranking.condition
    )
    embedded, figure_problems = of_page.embed(figures, links)
    everything = (*ranking.problems, *figure_problems, *damaged)

    def linked(table: Table | None) -> Table | None:
        return of_page.of_agents(table, ranking, hues, links) if table else None

    html = render(
        runs,
        ranking,
        title=title_of(runs) + (f", {report.section.title}" if several else ""),
        headline=headline(ranking),
        above="../index.html" if several else "",
        # The main table gets no colours of agents ({}), because its colours mean verdicts.
        table=of_page.of_agents(main_table(ranking), ranking, {}, links),
        conditions=[linked(table) for table in conditions_tables(ranking)],
        by_condition=by_condition,
        further=linked(of_page.metrics_table(ranking)),
        ranks=linked(ranks_table(ranking)),
        link=links.row,
        findings=report.findings[:SHOWN],
        more_findings=report.findings[SHOWN:],
        claims=report.claims,
        comparison=comparison_table(report.comparison),
        main_figure=next((figure for figure in embedded if figure.name == MAIN), None),
        figures=[figure for figure in embedded if figure.name != MAIN],
        left_out=left_out,
        data=_data(tracks, looks, runs),
        runs=of_page.runs_table(runs, agents, hues, links),
        problems=grouped(tuple(dict.fromkeys(everything))),
        facts=_facts(ranking, runs, scenarios=True),
        command=command,
        limit=limit_lines(ranking),
    )
    return text(path, html)


def render(records: Sequence[RunRecord], ranking: Ranking, **shown: Any) -> str:
    """Return the page of some runs as HTML, with a content security policy that allows only the page's own script.

    The template leaves out parts that `shown` does not have.
    """
    return document(
        "page.html",
        SCRIPTS,
        ranking=ranking,
        vehicles=distinct(run.config.get("vehicle.name") for run in records),
        runs_found=len(records),
        confidence=f"{100 * ranking.confidence:g}",
        shown_notes=SHOWN_NOTES,
        **shown,
    )


def document(template: str, scripts: Sequence[str], **shown: Any) -> str:
    """Return a self-contained page, rendered from a template in the assets.

    The page's content security policy allows only the page's own script.
    """
    script = "\n".join(_asset(name) for name in scripts)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode("ascii")
    policy = (
        "default-src 'none'; img-src data:; style-src 'unsafe-inline'; "
        f"script-src 'sha256-{digest}'; base-uri 'none'; form-action 'none'"
    )
    # Labels, ids and messages come from untrusted files, so everything is escaped.
    environment = jinja2.Environment(
        autoescape=True, trim_blocks=True, lstrip_blocks=True, loader=jinja2.FunctionLoader(_asset)
    )
    return environment.get_template(template).render(
        style=Markup(_asset("page.css")), script=Markup(script), policy=policy, **shown
    )


def title_of(runs: Sequence[RunRecord]) -> str:
    """Return a title with the first three names of the runs' experiments."""
    names = sorted({str(name) for run in runs if (name := run.config.get("name"))})
    if not names:
        return "auvbench report"
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    return f"auvbench report: {', '.join(names[:3])}{more}"


def _asset(name: str) -> str:
    return files("auvbench.reporting.page").joinpath("assets", name).read_text(encoding="utf-8")


def _data(
    tracks: Sequence[trajectories.Track],
    looks: Mapping[str, Look],
    runs: Sequence[RunRecord],
) -> dict[str, Any]:
    """Return the data of the 3-D view, unescaped: the template's tojson filter escapes the data for a script element."""
    config: Mapping[str, Any] = runs[0].config if runs else {}
    task = TASKS.get(str(config.get("task.name", DEFAULT_TASK)))
    return {
        "agents": [
            {"label": label, "colour": look.colour, "dash": _DASHES[look.linestyle]}
            for label, look in looks.items()
        ],
        # The 3-D view of the waypoint task shows the whole water; the view of another task is as large as the paths.
        "goal": "goal" if task is None else task.goal,
        "cone": _length(config.get("task.cone"), 0.0),
        "reach": _length(config.get("task.standoff"), 0.0),
        "team": any(track.path.others is not None for track in tracks),
        "goal_radius": _length(config.get("task.goal_radius", config.get("task.tolerance", 0.0)), 3.0),
        "depth": [_length(config.get("task.depth_low"), -60.0), _length(config.get("task.depth_high"), -1.0)],
        "episodes": trajectories.pack(tracks),
    }


def _length(value: Any, default: float) -> float:
    return float(value) if isinstance(value, int | float) and abs(value) < 1e6 else default


def _facts(ranking: Ranking, runs: Sequence[RunRecord], scenarios: bool) -> Facts:
    """Return the facts for the page's section on methods; with `scenarios`, also the fingerprint and the seeds."""
    summaries = [e.summary for run in runs if (e := run.evaluations.get(ranking.protocol))]
    seeds = [f"seed {seed}" for seed in distinct(summary["seed"] for summary in summaries)]
    return [
        ("Protocol", (f"{ranking.protocol}, condition {ranking.condition}",)),
        *([("Scenarios", (f"fingerprint {ranking.fingerprint}", *seeds))] if scenarios else []),
        ("Ranked by", (", then ".join(dict.fromkeys((ranking.rank_by, FINER))),)),
        *facts(runs),
    ]


def write_overview(
    path: Path,
    reports: Sequence[Report],
    command: str = "",
    score: Scores | None = None,
    by_condition: Sequence[Table] = (),
) -> Path:
    """Write the overview page of all sections; each section has its own page at `<folder>/index.html`.

    Raises:
        OSError: the file cannot be written.
    """
    shown = []
    for report in reports:
        title, ranking = report.section.title, report.ranking
        href = f"./{report.section.folder}/index.html"
        links = of_page.Links(path, report.runs, href)
        shown.append(
            {
                "title": title,
                "heading": capitalized(title),
                "headline": headline(ranking),
                "fingerprint": ranking.fingerprint,
                "href": href,
                "table": of_page.of_agents(main_table(ranking), ranking, {}, links),
                "findings": report.findings[:SHOWN],
            }
        )
    runs = [run for report in reports for run in report.runs]
    problems = dict.fromkeys(problem for report in reports for problem in report.ranking.problems)
    html = render(
        runs,
        reports[0].ranking,
        title=title_of(runs),
        headline=overview(len(reports), score),
        parts=shown,
        problems=grouped(tuple(problems)),
        facts=_facts(reports[0].ranking, runs, scenarios=False),  # each section shows its own scenarios
        command=command,
        score=None if score is None else score_table(score),
        by_condition=by_condition,
    )
    return text(path, html)
