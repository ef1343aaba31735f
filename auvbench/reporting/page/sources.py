"""Where the numbers come from: the table of runs, findings with their runs, problems, methods."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from auvbench.analysis.records import Agent, ClaimVerdict, Finding, Ranking, RunRecord
from auvbench.reporting.page import numbers
from auvbench.reporting.page.links import Links
from auvbench.runs.progress import telling

VERDICTS = {"holds": "yes", "does not hold": "no", "cannot be said": "open"}
"""a claim's verdict to the name of its style"""
SHOWN = 4
"""runs linked next to a finding before the list is folded"""


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
class Source:
    """A link from a sentence to a run."""

    id: str
    href: str


@dataclass(frozen=True, slots=True)
class Sentence:
    """A finding or a claim as printed."""

    text: str
    basis: str
    sources: tuple[Source, ...]
    verdict: str = ""
    style: str = ""
    missing: str = ""

    @property
    def folded(self) -> bool:
        return len(self.sources) > SHOWN


@dataclass(frozen=True, slots=True)
class Fact:
    """One line of the methods."""

    name: str
    values: tuple[str, ...]


RUN_COLUMNS = (
    "Success, %",
    "Collision, %",
    "Timeout, %",
    "Steps",
    "Train steps",
    "Train success, %",
    "Time",
)
"""The numbers of `RunLine.numbers`."""


def run_lines(
    runs: Sequence[RunRecord], agents: Sequence[Agent], colours: Mapping[str, str], links: Links
) -> list[RunLine]:
    """The agents' runs in the order of the agents, then every other run that was found."""
    lines, seen = [], set()
    for index, agent in enumerate(agents):
        for row, run in enumerate(agent.runs):
            anchor = f"agent-{index}" if row == 0 else ""
            lines.append(_run_line(run, agent, row, anchor, colours, links))
            seen.add(run.id)
    lines += [_run_line(run, None, 0, "", colours, links) for run in runs if run.id not in seen]
    return lines


def findings(found: Iterable[Finding], links: Links) -> list[Sentence]:
    """Return findings as printed, with links to their runs."""
    return [
        Sentence(numbers.minus(f.text), numbers.minus(f.basis), _sources(f.run_ids, links)) for f in found
    ]


def claims(found: Iterable[ClaimVerdict], links: Links) -> list[Sentence]:
    """Return claims as printed, with their verdicts and links to their runs."""
    return [
        Sentence(
            numbers.minus(claim.text),
            numbers.minus(claim.statistic),
            _sources(claim.run_ids, links),
            claim.verdict,
            VERDICTS.get(claim.verdict, "open"),
            claim.missing,
        )
        for claim in found
    ]


def _sources(run_ids: Iterable[str], links: Links) -> tuple[Source, ...]:
    return tuple(Source(run_id, f"#{anchor}") for run_id in run_ids if (anchor := links.anchor(run_id)))


def facts(ranking: Ranking, agents: Sequence[Agent], runs: Sequence[RunRecord]) -> list[Fact]:
    """What a reader needs to judge and repeat the numbers, as far as the runs tell it."""
    episodes = sorted({row.episodes for row in ranking.rows})
    seeds = sorted({len(row.seeds) for row in ranking.rows})
    summaries = [e.summary for run in runs if (e := run.evaluations.get(ranking.protocol))]
    found = [
        Fact("Protocol", (f"{ranking.protocol}, condition {ranking.condition}",)),
        Fact("Scenarios", (f"fingerprint {ranking.fingerprint}", *_scenario_seed(summaries))),
        Fact("Test episodes", (f"{_span(episodes)} for each training seed",)),
        Fact("Training seeds", (f"{_span(seeds)} for each agent",)),
        Fact("Ranked by", (ranking.order,)),
        Fact("Vehicle", _distinct(run.config.get("vehicle.name") for run in runs)),
        Fact("Simulator", _distinct(run.config.get("simulator.name") for run in runs)),
        Fact("Versions", _versions(run.manifest.get("versions") for run in runs)),
        Fact("Source", _commits(run.manifest.get("git") for run in runs)),
        Fact("Hosts", _hosts(run.manifest.get("host") for run in runs)),
    ]
    return [fact for fact in found if fact.values]


def vehicles(runs: Iterable[RunRecord]) -> tuple[str, ...]:
    return _distinct(run.config.get("vehicle.name") for run in runs)


def _run_line(
    run: RunRecord, agent: Agent | None, row: int, agent_anchor: str, colours: Mapping[str, str], links: Links
) -> RunLine:
    test: list[Number] = [Number(numbers.NOTHING, None)] * 4
    if agent is not None:
        href = links.evaluation(run)
        rates = [float((agent.outcome[row] == code).mean()) for code in range(3)]
        test = [Number(numbers.fixed(100 * rate, 1), rate, href) for rate in rates]
        steps = agent.metrics.get("steps")
        mean = float(steps[row].mean()) if steps is not None else math.nan
        test.append(Number(numbers.fixed(mean, 1), mean if math.isfinite(mean) else None, href))
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
    steps, success, seconds = (
        _number(run.manifest.get(key)) for key in ("steps", "success_rate", "wall_time_s")
    )
    episodes = _number(run.manifest.get("episodes"))
    success = telling(success, int(episodes)) if episodes is not None else success
    href = links.training(run)
    total = _number(run.manifest.get("total_steps"))
    if run.state == "complete" and not steps:
        steps = total = None  # a controller with nothing to learn
    text = numbers.fixed(steps, 0)
    if steps is not None and total is not None and steps < total:
        text += f" of {numbers.fixed(total, 0)}"
    return (
        Number(text, steps, href),
        Number(numbers.fixed(None if success is None else 100 * success, 1), success, href),
        Number(numbers.duration(seconds), seconds, ""),
    )


def _number(value: Any) -> float | None:
    """A finite number of a manifest, or None."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return None
    return float(value)


def _span(values: Sequence[int]) -> str:
    if not values:
        return numbers.NOTHING
    return f"{values[0]}" if len(values) == 1 else f"{values[0]} to {values[-1]}"


def _scenario_seed(summaries: Iterable[Mapping[str, Any]]) -> tuple[str, ...]:
    seeds = _distinct(summary.get("seed") for summary in summaries)
    return (f"seed {', '.join(seeds)}",) if seeds else ()


def _distinct(values: Iterable[Any]) -> tuple[str, ...]:
    return tuple(sorted({str(value) for value in values if value is not None and value != ""}))


def _versions(found: Iterable[Any]) -> tuple[str, ...]:
    """'torch 2.13.0', one entry per package; several versions of one package are all named."""
    held: dict[str, set[str]] = {}
    for versions in found:
        if isinstance(versions, Mapping):
            for name, version in versions.items():
                held.setdefault(str(name), set()).add(str(version))
    return tuple(f"{name} {' and '.join(sorted(held[name]))}" for name in sorted(held))


def _commits(found: Iterable[Any]) -> tuple[str, ...]:
    commits = set()
    for git in found:
        if isinstance(git, Mapping) and git.get("commit"):
            changed = " with local changes" if git.get("dirty") else ""
            commits.add(f"commit {str(git['commit'])[:12]}{changed}")
    return tuple(sorted(commits))


def _hosts(found: Iterable[Any]) -> tuple[str, ...]:
    hosts = set()
    for host in found:
        if isinstance(host, Mapping):
            cores = f", {host['cores']} cores" if host.get("cores") else ""
            hosts.add(f"{host.get('cpu') or host.get('name') or 'unknown'}{cores}")
    return tuple(sorted(hosts))
