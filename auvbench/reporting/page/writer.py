"""Write the page: gather what the template shows, and put style, script and data inside it."""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jinja2
from markupsafe import Markup

from auvbench.analysis.findings import SHOWN
from auvbench.analysis.primary import headline
from auvbench.analysis.records import Agent, ClaimVerdict, Finding, Problem, Ranking, RunRecord
from auvbench.analysis.score import Scores
from auvbench.reporting.figures import MAIN, Figure
from auvbench.reporting.page import parts as of_page
from auvbench.reporting.page import trajectories as trajectories_
from auvbench.reporting.tables.appendix import (
    COMPARISON_NOTE,
    comparison_table,
    conditions_table,
    ranks_table,
    score_notes,
    score_table,
)
from auvbench.reporting.tables.main import main_table
from auvbench.reporting.tables.notes import grouped, limit_lines, notes, of_pairs
from auvbench.reporting.tables.table import Table
from auvbench.reporting.write import Part, overview, text

if TYPE_CHECKING:
    from auvbench.analysis.thesis import ComparisonRow

SCRIPTS = ("tables.js", "pen.js", "camera.js", "scene.js", "chart.js", "viewer.js")
"""Joined in this order into the page's one script."""
_COLOUR = re.compile(r"#[0-9a-fA-F]{6}")
_GREY = "#7f7f7f"
_DASHES = {"-": "solid", "--": "dashed", "-.": "dashdot", ":": "dotted"}


def write(
    path: Path,
    *,
    ranking: Ranking,
    agents: Sequence[Agent],
    runs: Sequence[RunRecord],
    figures: Sequence[Figure] = (),
    findings: Sequence[Finding] = (),
    claims: Sequence[ClaimVerdict] = (),
    comparison: Sequence[ComparisonRow] = (),
    problems: Sequence[Problem] = (),
    colours: Mapping[str, tuple[str, Any, Any]],
    command: str = "",
    title: str = "",
    section: str = "",
) -> Path:
    """Write the report as one HTML file that needs nothing but a browser; return its path.

    Everything is inside the file: style, script, figures, trajectories. Links lead by relative paths to the
    files of the runs, so the page and the runs move together. The same arguments give the same bytes.

    Args:
        path: the file to write, usually `report/index.html`; folders are made.
        ranking: the ranked table.
        agents: the agents of the ranking, in any order.
        runs: every run that was found, with or without an evaluation.
        figures: in the order to show.
        findings: what the data show in addition to the primary analysis.
        claims: the claims of a study with their verdicts.
        comparison: the numbers of a study's own table with ours.
        problems: what was found while loading; those of the ranking are added.
        colours: by label (colour as #rrggbb, marker, line style), as in the figures.
        command: the command line that made the report.
        title: the page's title; by default it names the experiments that the runs belong to.
        section: the section of a report that has several; `../index.html` then shows all.

    Raises:
        OSError: the file cannot be written.
    """
    order = {row.label: place for place, row in enumerate(ranking.rows)}
    agents = sorted(agents, key=lambda agent: order.get(agent.label, len(order)))
    styles = _styles(agents, colours)
    hues = {label: colour for label, (colour, _) in styles.items()}
    links = of_page.Links(path, runs)
    scenes = trajectories_.read(agents, protocol=ranking.protocol, condition=ranking.condition)
    embedded, figure_problems = of_page.embed(figures, links)
    everything = (*ranking.problems, *problems, *figure_problems, *scenes.problems)
    found = of_page.findings(findings, links)
    further = of_page.metrics_table(ranking)

    def linked(table: Table) -> Table:
        return of_page.of_agents(table, ranking, hues, links)

    html = render(
        runs,
        ranking,
        title=(title or title_of(runs)) + (f", {section}" if section else ""),
        headline=headline(ranking),
        above="../index.html" if section else "",
        table=of_page.of_agents(main_table(ranking), ranking, {}, links),  # its colours are those of verdicts
        conditions=linked(conditions_table(ranking)) if ranking.conditions else None,
        further=linked(further) if further else None,
        ranks=linked(ranks_table(ranking)),
        notes=notes(ranking),
        findings=found[:SHOWN],
        more_findings=found[SHOWN:],
        claims=of_page.claims(claims, links),
        comparison=comparison_table(comparison) if comparison else None,
        comparison_note=COMPARISON_NOTE,
        main_figure=next((figure for figure in embedded if figure.name == MAIN), None),
        figures=[figure for figure in embedded if figure.name != MAIN],
        scenes=scenes.scenes,
        left_out=scenes.left_out,
        data=_data(scenes, agents, styles, runs),
        runs=of_page.runs_table(runs, agents, hues, links),
        problems=grouped(tuple(dict.fromkeys(everything))),
        facts=of_page.facts(ranking, runs),
        command=command,
        limit=limit_lines(ranking),
    )
    return text(path, html)


def render(found: Sequence[RunRecord], ranking: Ranking, **shown: Any) -> str:
    """Return the page of some runs as HTML; it leaves out what `shown` does not name."""
    return filled(
        "page.html",
        SCRIPTS,
        ranking=ranking,
        pairs_note=of_pairs(ranking),
        vehicles=of_page.distinct(run.config.get("vehicle.name") for run in found),
        runs_found=len(found),
        confidence=f"{100 * ranking.confidence:g}",
        **shown,
    )


def title_of(runs: Sequence[RunRecord]) -> str:
    """Return the title that names the first experiments of the runs."""
    names = sorted({str(name) for run in runs if (name := run.config.get("name"))})
    if not names:
        return "auvbench report"
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    return f"auvbench report: {', '.join(names[:3])}{more}"


def filled(template: str, scripts: Sequence[str], **shown: Any) -> str:
    """Return a template of `assets/` with its style, its one script, and the policy that lets only this script run."""
    script = "\n".join(_asset(name) for name in scripts)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode("ascii")
    policy = (
        "default-src 'none'; img-src data:; style-src 'unsafe-inline'; "
        f"script-src 'sha256-{digest}'; base-uri 'none'; form-action 'none'"
    )
    # Labels, ids and messages come from foreign files, so everything is escaped.
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(_asset), autoescape=True, trim_blocks=True, lstrip_blocks=True
    )
    return environment.get_template(template).render(
        style=Markup(_asset("page.css")), script=Markup(script), policy=policy, **shown
    )


def _asset(name: str) -> str:
    return files("auvbench.reporting.page").joinpath("assets", name).read_text(encoding="utf-8")


def _styles(
    agents: Sequence[Agent], colours: Mapping[str, tuple[str, Any, Any]]
) -> dict[str, tuple[str, str]]:
    """Return (colour, dash) by label; any other text becomes grey, so that it cannot enter a style."""
    found = {}
    for agent in agents:
        colour, _, line = colours.get(agent.label, (_GREY, "", "-"))
        found[agent.label] = (colour if _COLOUR.fullmatch(colour) else _GREY, _DASHES.get(line, "dashed"))
    return found


def _data(
    scenes: trajectories_.Scenes,
    agents: Sequence[Agent],
    styles: Mapping[str, tuple[str, str]],
    runs: Sequence[RunRecord],
) -> dict[str, Any]:
    """Return what the 3-D view reads; the template's tojson filter escapes it for a script element."""
    config: Mapping[str, Any] = runs[0].config if runs else {}
    waypoint = config.get("task.name", "waypoint") == "waypoint"
    return {
        "agents": [
            {"label": agent.label, "colour": styles[agent.label][0], "dash": styles[agent.label][1]}
            for agent in agents
        ],
        # The original task has the whole water in its box; other tasks have what their paths need.
        "goal": "waypoint" if waypoint else "goal",
        "cone": _length(config.get("task.cone"), 0.0),
        "reach": _length(config.get("task.standoff"), 0.0),
        "goal_radius": _length(config.get("task.goal_radius", config.get("task.tolerance", 0.0)), 3.0),
        "depth": [_length(config.get("task.depth_low"), -60.0), _length(config.get("task.depth_high"), -1.0)],
        "episodes": trajectories_.pack(scenes),
    }


def _length(value: Any, default: float) -> float:
    return float(value) if isinstance(value, int | float) and abs(value) < 1e6 else default


def write_overview(
    path: Path,
    parts: Sequence[Part],
    command: str = "",
    score: Scores | None = None,
) -> Path:
    """Write the page of all sections; each has its own page at `<folder>/index.html`.

    Raises:
        OSError: the file cannot be written.
    """
    shown = []
    for part in parts:
        href = f"./{part.folder}/index.html"
        links = of_page.Links(path, part.runs, href)
        shown.append(
            {
                "title": part.title,
                "heading": part.title[:1].upper() + part.title[1:],
                "headline": headline(part.ranking),
                "fingerprint": part.ranking.fingerprint,
                "href": href,
                "table": of_page.of_agents(main_table(part.ranking), part.ranking, {}, links),
                "notes": notes(part.ranking),
                "findings": of_page.findings(part.findings[:SHOWN], links),
            }
        )
    runs = [run for part in parts for run in part.runs]
    problems = dict.fromkeys(problem for part in parts for problem in part.ranking.problems)
    scored = score_table(score) if score is not None and score.rows else None
    html = render(
        runs,
        parts[0].ranking,
        title=title_of(runs),
        headline=overview(len(parts), score),
        parts=shown,
        problems=grouped(tuple(problems)),
        # Each section has its own scenarios.
        facts=[fact for fact in of_page.facts(parts[0].ranking, runs) if fact[0] != "Scenarios"],
        command=command,
        score=None if score is None else {"table": scored, "notes": score_notes(score)},
    )
    return text(path, html)
