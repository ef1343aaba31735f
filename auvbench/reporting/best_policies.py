"""The best policy of each learning algorithm of a study as a file in `<folder>/policies/`, and their table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from auvbench.analysis.effects import run_learns
from auvbench.analysis.measures import to_rank_by
from auvbench.analysis.records import NO_POLICY, Agent, RunRecord
from auvbench.errors import AuvbenchError
from auvbench.policies import cards, exported
from auvbench.reporting.tables.text_formats import escape
from auvbench.reporting.tables.text_formats import rows as rows_of
from auvbench.runs.directory import RunDirectory
from auvbench.untrusted import path_safety

FOLDER = "policies"

MARK = "published"
"""true on the cards of files that publish may remove again"""

NO_WEIGHTS = "its weights are not in the given folders"
NOT_ASKED = "--policies exports it"
CHOSEN = "This test chose each policy, so its success is likely to be lower on other scenarios."


@dataclass(frozen=True, slots=True)
class Best:
    """An agent's best run, and why its policy has no file."""

    agent: str
    run: str
    success: float
    """share of the test's episodes"""
    reason: str = ""
    """empty where there is a file"""
    failed: bool = False
    """whether the export was tried in vain"""


def best(agents: Sequence[Agent], rank_by: str) -> list[tuple[Agent, int]]:
    """Return each agent, in the order given, with the row of its best run; of equals the first by id."""
    measure = to_rank_by(rank_by)
    found = []
    for agent in agents:
        values = measure.values(agent)
        rows = [
            i
            for i in range(len(agent.runs))
            if (agent.outcome[i] != NO_POLICY).any() and not np.isnan(values[i]).all()
        ]
        if rows:
            means = {i: measure.sign * float(np.nanmean(values[i])) for i in rows}
            found.append((agent, min(rows, key=lambda i: (-means[i], agent.runs[i].id))))
    return found


def renew(
    sections: Sequence[Sequence[tuple[Agent, int]]],
    sources: Mapping[str, RunRecord],
    folder: Path,
    *,
    export: bool,
) -> list[Best]:
    """Export the best policy of each learning algorithm, and remove published ones that are no longer the best.

    Args:
        sections: agents as `best` returns them.
        sources: the runs with their weights, by id.
        folder: of the study.
        export: False only looks at the files that exist.

    Raises:
        RunError: a link is in the way.
        MissingExtraError: onnx or onnxruntime is not installed.
        TrainingError: the disk is full, read-only or failing.
    """
    there = folder / FOLDER
    path_safety.check_output(there)
    rows = []
    for chosen in sections:
        done: dict[str, str] = {}
        for agent, i in chosen:
            run = agent.runs[i]
            algorithm = str(run.config.get("algo.agent"))
            failed = False
            if (reason := _nothing(run)) is None and algorithm in done:
                reason = f"{done[algorithm]} is the best of its algorithm"
            if reason is None:
                reason, failed = _file(there, run, sources.get(run.id), export)
            if not reason:
                done[algorithm] = agent.label
            rows.append(Best(agent.label, run.id, float(agent.success[i].mean()), reason, failed))
    if export:
        _remove_others(there, {row.run for row in rows if not row.reason or row.failed})
    return rows


def _nothing(run: RunRecord) -> str | None:
    """Return why a run has no policy to export; None where it has one."""
    from auvbench.evaluation.exporting import why_no_network

    agent, name = str(run.config.get("algo.agent")), str(run.config.get("algo.name"))
    return None if agent == "onnx" else why_no_network(name, agent, run_learns(run)) or None


def _file(there: Path, run: RunRecord, source: RunRecord | None, export: bool) -> tuple[str, bool]:
    """Return why a run has no file, empty where it has one, and whether that is a failure."""
    from auvbench.evaluation import exporting

    file = there / f"{run.id}.onnx"
    card = cards.card_path(file)
    if file.exists() or file.is_symlink():
        return ("", False) if _names_run(file, run.id) else (_other(file), True)
    if card.exists() and not _ours(card, run.id):
        return _other(file), True
    if not export:
        return NOT_ASKED, False
    if source is None or source.archive is not None:
        return NO_WEIGHTS, False
    try:
        exporting.export(RunDirectory(source.directory), there, {MARK: True})
    except AuvbenchError as error:
        if error.exit_code == 1:  # the disk's
            raise
        reason = str(error).removeprefix(f"{source.directory}: ")
        return reason, not isinstance(error, exporting.NoNetworkError)
    return "", False


def _names_run(file: Path, run: str) -> bool:
    try:
        _, card, _ = exported.read(file)
    except AuvbenchError:
        return False
    named = card.document.get("run") if card is not None else None
    return isinstance(named, Mapping) and named.get("id") == run


def _other(file: Path) -> str:
    return f"another file lies at {FOLDER}/{file.name}, or its card is not of it; remove both"


def _ours(card: Path, run: str) -> bool:
    """Return whether a card was written by publish, for this run."""
    try:
        document = cards.read_card(card).document
    except AuvbenchError:
        return False
    named = document.get("run")
    return document.get(MARK) is True and isinstance(named, Mapping) and named.get("id") == run


def _remove_others(there: Path, wanted: set[str]) -> None:
    for card in sorted(there.glob("*.json")):
        if card.stem in wanted or not _ours(card, card.stem):
            continue
        file = card.with_suffix(".onnx")
        if file.exists():
            try:
                exported.read(file)  # the card is of this file, and so the file is ours, too
            except AuvbenchError:
                continue
            file.unlink()
        card.unlink()
        print(f"removed {file}: no longer the best of its algorithm")


def any_of_ours(folder: Path) -> bool:
    """Return whether publish has put policies into a study's folder."""
    return any(_ours(card, card.stem) for card in (folder / FOLDER).glob("*.json"))


def markdown(rows: Sequence[Best]) -> str:
    """Return the block of the README: the policies, then the agents without a file and why."""
    files = [row for row in rows if not row.reason]
    table = rows_of(
        [
            ("agent", "best run", "success (%)", "policy", "card"),
            ["---"] * 5,
            *(
                (
                    escape(row.agent),
                    escape(row.run),
                    f"{100 * row.success:.1f}",
                    f"[{escape(row.run)}.onnx](<{FOLDER}/{row.run}.onnx>)",
                    f"[json](<{FOLDER}/{row.run}.json>)",
                )
                for row in files
            ),
        ]
    )
    by_reason: dict[str, list[str]] = {}
    for row in rows:
        if row.reason:
            by_reason.setdefault(row.reason, []).append(row.agent)
    none = "\n".join(
        f"* no file for {escape(', '.join(names))}: {escape(why)}" for why, names in by_reason.items()
    )
    return "\n\n".join(part for part in (*((table, CHOSEN) if files else ()), none) if part)
