"""The best policy of each agent of a study as a file, in `<folder>/policies/`, and the table that names them."""

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
from auvbench.reporting.tables.markdown import escape
from auvbench.reporting.tables.markdown import rows as rows_of
from auvbench.runs.directory import RunDirectory
from auvbench.untrusted import path_safety

FOLDER = "policies"

MARK = "published"
"""true on the cards of files that publish may remove again"""

NO_WEIGHTS = "its weights are not in the folders that were named"
NOT_ASKED = "--policies exports it"
CHOSEN = "Each is the best of its agent's runs by this very test, so that its success is likely to be less elsewhere."


@dataclass(frozen=True, slots=True)
class Best:
    """An agent's best run, and its policy's file or why there is none."""

    agent: str
    run: str
    success: float
    """share of the test's episodes"""
    reason: str = ""
    """empty where there is a file"""
    failed: bool = False
    """whether there should have been one"""


def best(agents: Sequence[Agent], rank_by: str) -> list[tuple[Agent, int]]:
    """Each agent with the row of its best run: by the measure of the table and, of equals, the first by id."""
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
    chosen: Sequence[tuple[Agent, int]], sources: Mapping[str, RunRecord], folder: Path, *, export: bool
) -> list[Best]:
    """Exports what is not there yet, and removes policies of ours that are no agent's best any more.

    Args:
        chosen: as `best` returns it.
        sources: the runs that were named, by id: where the weights are.
        folder: of the study.
        export: without it nothing is written or removed, and only what is there is looked at.

    Raises:
        RunError: a link is in the way.
        MissingExtraError: onnx or onnxruntime is not installed.
        TrainingError: the disk is full, read-only or failing.
    """
    there = folder / FOLDER
    path_safety.check_output(there)
    rows = []
    for agent, i in chosen:
        run = agent.runs[i]
        reason, failed = _there(there, run.id), False
        if reason is None:
            reason = _nothing(run)
        if reason is None:
            reason, failed = _export(sources.get(run.id), there, run.id) if export else (NOT_ASKED, False)
        rows.append(
            Best(agent.label, run.id, float(agent.success[i].mean()), reason, failed or bool(_taken(reason)))
        )
    if export:
        _remove_others(there, {row.run for row in rows})
    return rows


def _nothing(run: RunRecord) -> str | None:
    """Why there is nothing to export, also of a copy; None of an agent that learns, and of a policy that was a file."""
    from auvbench.evaluation.exporting import why_no_network

    agent, name = str(run.config.get("algo.agent")), str(run.config.get("algo.name"))
    return None if agent == "onnx" else why_no_network(name, agent, run_learns(run)) or None


def _taken(reason: str) -> bool:
    return reason.startswith("another file")


def _there(there: Path, run: str) -> str | None:
    """Empty where the run's policy lies there already, why it cannot be put there, None where there is room."""
    file = there / f"{run}.onnx"
    if not file.exists() and not file.is_symlink():
        return (
            None if _ours(cards.card_path(file), run) or not cards.card_path(file).exists() else _other(file)
        )
    try:
        _, card, _ = exported.read(file)
    except AuvbenchError:
        card = None
    named = card.document.get("run") if card is not None else None
    return "" if isinstance(named, Mapping) and named.get("id") == run else _other(file)


def _other(file: Path) -> str:
    return f"another file lies at {FOLDER}/{file.name}, or its card is not of it; remove both"


def _ours(card: Path, run: str) -> bool:
    """Whether a card was written by publish, for this run."""
    try:
        document = cards.read_card(card).document
    except AuvbenchError:
        return False
    named = document.get("run")
    return document.get(MARK) is True and isinstance(named, Mapping) and named.get("id") == run


def _export(run: RunRecord | None, there: Path, name: str) -> tuple[str, bool]:
    """Why there is no file, and whether there should be."""
    from auvbench.evaluation.exporting import NoNetworkError, export

    if run is None or run.archive is not None:
        return NO_WEIGHTS, False
    try:
        export(RunDirectory(run.directory), there, {MARK: True})
    except AuvbenchError as error:
        if error.exit_code == 1:  # the disk's
            raise
        return str(error).removeprefix(f"{run.directory}: "), not isinstance(error, NoNetworkError)
    return "", False


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
        print(f"removed {file}: no longer an agent's best")


def any_of_ours(folder: Path) -> bool:
    """Whether publish has put policies into a study's folder."""
    return any(_ours(card, card.stem) for card in (folder / FOLDER).glob("*.json"))


def markdown(rows: Sequence[Best]) -> str:
    """The block of the README: agent, run, success in the test, file; and who has no file, and why."""
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
        f"* no file of {escape(', '.join(names))}: {escape(why)}" for why, names in by_reason.items()
    )
    return "\n\n".join(part for part in (*((table, CHOSEN) if files else ()), none) if part)
