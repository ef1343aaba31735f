"""Writes the page: gathers what the template shows, and puts style, script and data inside it."""

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

from auvbench.analysis.aggregate import Across
from auvbench.analysis.findings import SHOWN
from auvbench.analysis.headline import headline
from auvbench.analysis.records import Agent, ClaimVerdict, Finding, Problem, Ranking, RunRecord
from auvbench.reporting.figures.scene import MAIN
from auvbench.reporting.page import figures as figures_
from auvbench.reporting.page import numbers, sources, study, table
from auvbench.reporting.page import trajectories as trajectories_
from auvbench.reporting.page.links import Links
from auvbench.reporting.tables import table as tables
from auvbench.reporting.tables.aggregate import across_table
from auvbench.reporting.tables.aggregate import notes as notes_of
from auvbench.reporting.tables.appendix import pairs_table, ranks_table
from auvbench.reporting.tables.by_condition import conditions_table
from auvbench.reporting.tables.main import main_table
from auvbench.reporting.tables.notes import grouped, limit_lines, notes, of_pairs
from auvbench.reporting.write import text

if TYPE_CHECKING:  # drawing needs matplotlib, showing does not
    from auvbench.analysis.study import ComparisonRow
    from auvbench.reporting.figures import Figure

SCRIPTS = ("tables.js", "lightbox.js", "pen.js", "camera.js", "scene.js", "chart.js", "viewer.js")
"""Joined in this order into the page's one script."""
_COLOUR = re.compile(r"#[0-9a-fA-F]{6}")
_GREY = "#7f7f7f"
_DASHES = {"-": "solid", "solid": "solid", "--": "dashed", "dashed": "dashed"} | {
    "-.": "dashdot",
    "dashdot": "dashdot",
    ":": "dotted",
    "dotted": "dotted",
}


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
    trajectories: trajectories_.Scenes | None = None,
    colours: Mapping[str, tuple[str, Any, Any]],
    command: str = "",
    title: str = "",
    section: str = "",
    over: Across | None = None,
) -> Path:
    """Write the report as one HTML file that needs nothing but a browser.

    Everything is inside the file: style, script, figures, trajectories. Links lead by relative paths to the
    files of the runs, so the page and the runs move together. The same arguments give the same bytes.

    Args:
        path: the file to write, usually `report/index.html`; folders are made.
        ranking: the ranked table.
        agents: the agents of the ranking, in any order.
        runs: every run that was found, with or without an evaluation.
        figures: objects with `name`, `title`, `caption`, `png`, `svg`, in the order to show.
        findings: what the data show in addition to the primary analysis.
        claims: the claims of a study with their verdicts.
        comparison: the numbers of a study's own table with ours.
        problems: what was found while loading; those of the ranking are added.
        trajectories: the paths of the 3-D view; None reads them from the agents' runs.
        colours: by label (colour as #rrggbb, marker, line style), as in the figures.
        command: the command line that made the report.
        title: the page's title; by default it names the experiments that the runs belong to.
        section: the section that the page is of, where the report has several and `../index.html` shows all.
        over: the agents over all tasks, where that was asked for.

    Returns:
        The path that was written.

    Raises:
        OSError: the file cannot be written.
    """
    order = {row.label: place for place, row in enumerate(ranking.rows)}
    agents = sorted(agents, key=lambda agent: order.get(agent.label, len(order)))
    styles = _styles(agents, colours)
    hues = {label: colour for label, (colour, _) in styles.items()}
    links = Links(path, agents, runs, ranking.protocol)
    scenes = trajectories
    if scenes is None:
        scenes = trajectories_.read(agents, protocol=ranking.protocol, condition=ranking.condition)
    embedded, figure_problems = figures_.embed(figures, links)
    everything = _distinct((*ranking.problems, *problems, *figure_problems, *scenes.problems))
    found = sources.findings(findings, links)
    html = render(
        runs,
        ranking,
        title=(title or title_of(runs)) + (f", {section}" if section else ""),
        headline=numbers.minus(headline(ranking)),
        above="../index.html" if section else "",
        **tables_of(ranking, hues, links),
        notes=[numbers.minus(line) for line in notes(ranking)],
        over=over_all(over),
        findings=found[:SHOWN],
        more_findings=found[SHOWN:],
        claims=sources.claims(claims, links),
        comparison=study.table(comparison, hues, links),
        main_figure=next((figure for figure in embedded if figure.name == MAIN), None),
        figures=[figure for figure in embedded if figure.name != MAIN],
        scenes=scenes,
        data=_data(scenes, agents, styles, runs),
        runs=sources.run_lines(runs, agents, hues, links),
        problems=grouped(tuple(everything)),
        facts=sources.facts(ranking, agents, runs),
        command=command,
        limit=limit_lines(ranking),
    )
    return text(path, html)


def tables_of(ranking: Ranking, hues: Mapping[str, str], links: Links) -> dict[str, Any]:
    """Return the tables of one section as the template draws them."""

    def shown(whole: tables.Table | None) -> list[table.ShownTable]:
        wanted = [] if whole is None or not ranking.rows else table.parts(whole)
        return [table.of_agents(part, ranking, hues, links) for part in wanted]

    main = main_table(ranking)
    pairs = ranking.comparisons
    return {
        "table": table.of_agents(main, ranking, {}, links),  # its colours are those of the verdicts
        "conditions": shown(conditions_table(ranking)) if ranking.conditions else [],
        "further": shown(table.metrics_table(ranking, main)),
        "ranks": table.of_agents(ranks_table(ranking), ranking, hues, links),
        "pairs": table.printed(pairs_table(pairs)) if pairs else None,
    }


def render(found: Sequence[RunRecord], ranking: Ranking, **shown: Any) -> str:
    """Return the page of some runs as HTML; `shown` replaces parts of a page that shows nothing."""
    nothing: dict[str, Any] = {
        "parts": (),
        "above": "",
        "table": None,
        "notes": (),
        "further": (),
        "conditions": (),
        "over": None,
        "ranks": None,
        "pairs": None,
        "findings": (),
        "more_findings": (),
        "claims": (),
        "comparison": None,
        "marks": study.MARKS,
        "main_figure": None,
        "figures": (),
        "scenes": trajectories_.Scenes(),
        "data": {},
        "runs": (),
        "run_columns": sources.RUN_COLUMNS,
        "problems": (),
        "facts": (),
        "command": "",
        "limit": (),
    }
    always = {
        "ranking": ranking,
        "pairs_note": of_pairs(ranking),
        "vehicles": sources.vehicles(found),
        "runs_found": len(found),
        "confidence": f"{100 * ranking.confidence:g}",
    }
    return filled("page.html", SCRIPTS, **(nothing | always | shown))


def over_all(found: Across | None) -> dict[str, Any] | None:
    """Return the agents over all tasks as the template draws them."""
    return None if found is None else {"table": table.printed(across_table(found)), "notes": notes_of(found)}


def hues_of(agents: Sequence[Agent], colours: Mapping[str, tuple[str, Any, Any]]) -> dict[str, str]:
    """Colour by label."""
    return {label: colour for label, (colour, _) in _styles(agents, colours).items()}


def title_of(runs: Sequence[RunRecord]) -> str:
    names = sorted({str(name) for run in runs if (name := run.config.get("name"))})
    if not names:
        return "auvbench report"
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    return f"auvbench report: {', '.join(names[:3])}{more}"


def filled(template: str, scripts: Sequence[str], **shown: Any) -> str:
    """A page of the templates in `assets/`, with its style, its one script and the policy that lets only this one run.

    Args:
        template: its name.
        scripts: of `assets/`, joined in this order.
        shown: what the template names.
    """
    script = "\n".join(_asset(name) for name in scripts)
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(_asset),
        # Labels, ids and messages come from foreign files.
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(
        style=Markup(_asset("page.css")), script=Markup(script), policy=_policy(script), **shown
    )


def _asset(name: str) -> str:
    return files("auvbench.reporting.page").joinpath("assets", name).read_text(encoding="utf-8")


def _policy(script: str) -> str:
    """A content security policy: nothing from a network, no script but the page's own."""
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode("ascii")
    return (
        "default-src 'none'; img-src data:; style-src 'unsafe-inline'; "
        f"script-src 'sha256-{digest}'; base-uri 'none'; form-action 'none'"
    )


def _styles(
    agents: Sequence[Agent], colours: Mapping[str, tuple[str, Any, Any]]
) -> dict[str, tuple[str, str]]:
    """(colour, dash) by label; what is not a colour becomes grey, so that nothing else enters a style."""
    found = {}
    for agent in agents:
        colour, _, line = colours.get(agent.label, (_GREY, "", "-"))
        dash = _DASHES.get(line, "dashed") if isinstance(line, str) else "dashed"
        found[agent.label] = (colour if _COLOUR.fullmatch(colour) else _GREY, dash)
    return found


def _data(
    scenes: trajectories_.Scenes,
    agents: Sequence[Agent],
    styles: Mapping[str, tuple[str, str]],
    runs: Sequence[RunRecord],
) -> dict[str, Any]:
    """What the 3-D view reads; the template's tojson filter escapes it for a script element."""
    config: Mapping[str, Any] = runs[0].config if runs else {}
    start = [scene.tracks[0].position[0].tolist() for scene in scenes.scenes[:1]]
    return {
        "agents": [
            {"label": agent.label, "colour": styles[agent.label][0], "dash": styles[agent.label][1]}
            for agent in agents
        ],
        "start": [round(value, 3) for value in start[0]] if start else [0.0, 0.0, -20.0],
        "goal_radius": _length(config.get("task.goal_radius"), 3.0),
        "depth": [_length(config.get("task.depth_low"), -60.0), _length(config.get("task.depth_high"), -1.0)],
        "episodes": trajectories_.pack(scenes),
    }


def _length(value: Any, default: float) -> float:
    return float(value) if isinstance(value, int | float) and abs(value) < 1e6 else default


def _distinct(problems: Sequence[Problem]) -> list[Problem]:
    return list(dict.fromkeys(problems))
