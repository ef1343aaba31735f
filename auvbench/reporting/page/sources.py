"""Sources of the numbers: the table of runs, findings and claims with their runs, methods."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from auvbench.analysis.records import Agent, ClaimVerdict, Finding, Ranking, RunRecord
from auvbench.reporting.page import table
from auvbench.reporting.page.links import Links
from auvbench.runs.progress import duration, telling

VERDICTS = {"holds": "yes", "does not hold": "no", "cannot be said": "open"}
"""a claim's verdict to the name of its style"""
RUN_COLUMNS = ("Success, %", "Collision, %", "Timeout, %", "Steps", "Train steps", "Train success, %", "Time")
"""titles of `RunLine.numbers`"""


@dataclass(frozen=True, slots=True)
class Number:
    """A printed number, its sorting key, and the file it comes from."""

    text: str
    sort: float | None
    href: str = ""


@dataclass(frozen=True, slots=True)
class RunLine:
    """One run in the table of runs."""

    anchor: str
    """id of the row"""
    agent_anchor: str
    """id of the agent, on the first row of each agent"""
    agent: str
    colour: str
    id: str
    href: str
    state: str
    seed: int
    numbers: tuple[Number, ...]


@dataclass(frozen=True, slots=True)
class Sentence:
    """A finding or a claim as printed."""

    text: str
    basis: str
    sources: tuple[tuple[str, str], ...]
    """(run id, link)"""
    verdict: str = ""
    style: str = ""
    missing: str = ""


def run_lines(
    runs: Sequence[RunRecord], agents: Sequence[Agent], colours: Mapping[str, str], links: Links
) -> list[RunLine]:
    """Return the agents' runs in the order of the agents, then every other run that was found."""
    lines, seen = [], set()
    for index, agent in enumerate(agents):
        for row, run in enumerate(agent.runs):
            anchor = f"agent-{index}" if row == 0 else ""
            lines.append(_run_line(run, agent, row, anchor, colours, links))
            seen.add(run.id)
    return lines + [_run_line(run, None, 0, "", colours, links) for run in runs if run.id not in seen]


def findings(found: Iterable[Finding], links: Links) -> list[Sentence]:
    """Return findings as printed, with links to their runs."""
    return [Sentence(table.minus(f.text), table.minus(f.basis), _sources(f.run_ids, links)) for f in found]


def claims(found: Iterable[ClaimVerdict], links: Links) -> list[Sentence]:
    """Return claims as printed, with their verdicts and links to their runs."""
    return [
        Sentence(
            table.minus(claim.text),
            table.minus(claim.statistic),
            _sources(claim.run_ids, links),
            claim.verdict,
            VERDICTS.get(claim.verdict, "open"),
            claim.missing,
        )
        for claim in found
    ]


def _sources(run_ids: Iterable[str], links: Links) -> tuple[tuple[str, str], ...]:
    return tuple((run_id, f"#{anchor}") for run_id in run_ids if (anchor := links.anchor(run_id)))


def facts(
    ranking: Ranking, agents: Sequence[Agent], runs: Sequence[RunRecord]
) -> list[tuple[str, tuple[str, ...]]]:
    """Return the lines of the methods: what a reader needs to judge and repeat the numbers."""
    summaries = [e.summary for run in runs if (e := run.evaluations.get(ranking.protocol))]
    versions = [found for run in runs if isinstance(found := run.manifest.get("versions"), Mapping)]
    commits = [found for run in runs if isinstance(found := run.manifest.get("git"), Mapping)]
    hosts = [found for run in runs if isinstance(found := run.manifest.get("host"), Mapping)]
    packages = sorted({str(name) for found in versions for name in found})
    seeds = [f"seed {seed}" for seed in distinct(summary.get("seed") for summary in summaries)]
    found = [
        ("Protocol", (f"{ranking.protocol}, condition {ranking.condition}",)),
        ("Scenarios", (f"fingerprint {ranking.fingerprint}", *seeds)),
        ("Test episodes", (f"{_span([row.episodes for row in ranking.rows])} for each training seed",)),
        ("Training seeds", (f"{_span([len(row.seeds) for row in ranking.rows])} for each agent",)),
        ("Ranked by", (ranking.order,)),
        ("Vehicle", distinct(run.config.get("vehicle.name") for run in runs)),
        ("Simulator", distinct(run.config.get("simulator.name") for run in runs)),
        ("Versions", tuple(f"{n} {' and '.join(distinct(v.get(n) for v in versions))}" for n in packages)),
        (
            "Source",
            distinct(
                f"commit {str(git['commit'])[:12]}{' with local changes' if git.get('dirty') else ''}"
                for git in commits
                if git.get("commit")
            ),
        ),
        (
            "Hosts",
            distinct(
                f"{host.get('cpu') or host.get('name') or 'unknown'}"
                + (f", {host['cores']} cores" if host.get("cores") else "")
                for host in hosts
            ),
        ),
    ]
    return [(name, values) for name, values in found if values]


def distinct(values: Iterable[Any]) -> tuple[str, ...]:
    """Return the different values as sorted text, without missing ones."""
    return tuple(sorted({str(value) for value in values if value is not None and value != ""}))


def _run_line(
    run: RunRecord, agent: Agent | None, row: int, agent_anchor: str, colours: Mapping[str, str], links: Links
) -> RunLine:
    test: list[Number] = [Number(table.NOTHING, None)] * 4
    if agent is not None:
        href = links.evaluation(run)
        rates = [float((agent.outcome[row] == code).mean()) for code in range(3)]
        test = [Number(table.fixed(100 * rate, 1), rate, href) for rate in rates]
        steps = agent.metrics.get("steps")
        mean = _number(float(steps[row].mean())) if steps is not None else None
        test.append(Number(table.fixed(mean, 1), mean, href))
    return RunLine(
        anchor=links.anchor(run.id),
        agent_anchor=agent_anchor,
        agent=agent.label if agent else "",
        colour=colours.get(agent.label, "") if agent else "",
        id=run.id,
        href=links.manifest(run),
        state=run.state,
        seed=run.seed,
        numbers=(*test, *_training(run, links)),
    )


def _training(run: RunRecord, links: Links) -> tuple[Number, Number, Number]:
    steps, total, success, seconds, episodes = (
        _number(run.manifest.get(key))
        for key in ("steps", "total_steps", "success_rate", "wall_time_s", "episodes")
    )
    success = telling(success, int(episodes)) if episodes is not None else success
    href = links.training(run)
    if run.state == "complete" and not steps:
        steps = total = None  # a controller with nothing to learn
    text = table.fixed(steps, 0)
    if steps is not None and total is not None and steps < total:
        text += f" of {table.fixed(total, 0)}"
    return (
        Number(text, steps, href),
        Number(table.fixed(None if success is None else 100 * success, 1), success, href),
        Number(table.NOTHING if seconds is None else duration(seconds), seconds),
    )


def _number(value: Any) -> float | None:
    """Return a finite number of a manifest, or None."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return None
    return float(value)


def _span(values: Sequence[int]) -> str:
    ends = sorted({min(values), max(values)}) if values else []
    return " to ".join(map(str, ends)) or table.NOTHING
