"""Export the best policy of each learning algorithm of a study to `<folder>/policies/`, and list them in a table."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from auvbench.analysis.measures import to_rank_by
from auvbench.analysis.records import NO_POLICY, Agent, RunRecord, run_learns
from auvbench.errors import AuvbenchError
from auvbench.policies import exported
from auvbench.reporting.tables.text_formats import escape, rows
from auvbench.runs.directory import RunDirectory
from auvbench.untrusted import path_safety

FOLDER = "policies"
CHOSEN = "This test chose each policy, so its success is likely to be lower on other scenarios."


@dataclass(frozen=True, slots=True)
class Best:
    """Best run of an algorithm, and the reason if the run's policy could not be exported."""

    agent: str
    run: str
    success: float
    """success rate in the test"""
    problem: str = ""
    """reason why the policy has no file; '' if the policy has a file"""


def best(agents: Sequence[Agent], rank_by: str) -> list[tuple[Agent, int]]:
    """Return each agent with the index of the agent's best run; the order of the agents stays.

    If several runs are equally good, the first by id is the best. Agents without a value of the measure are left out.
    """
    measure = to_rank_by(rank_by)
    chosen = []
    for agent in agents:
        values = measure.values(agent)
        means = {
            i: measure.sign * float(np.nanmean(values[i]))
            for i in range(len(agent.runs))
            if (agent.outcome[i] != NO_POLICY).any() and not np.isnan(values[i]).all()
        }
        if means:
            chosen.append((agent, min(means, key=lambda i: (-means[i], agent.runs[i].id))))
    return chosen


def renew(
    sections: Sequence[Sequence[tuple[Agent, int]]],
    sources: Mapping[str, RunRecord],
    folder: Path,
    *,
    export: bool,
) -> list[Best]:
    """Export the best policy of each learning algorithm, and remove the exported policies of the study's other runs.

    Args:
        sections: result of `best` for each section, best agents first.
        sources: runs by id, with the weights of their policies.
        folder: folder of the study.
        export: whether to export and remove files; if False, the existing files are only listed.

    Raises:
        RunError: an output path is a link.
        MissingExtraError: onnx or onnxruntime is not installed.
        TrainingError: the disk is full, read-only or failing.
    """
    policies = folder / FOLDER
    path_safety.check_output(policies)
    rows = []
    for chosen in sections:
        done: set[str] = set()
        for agent, i in chosen:
            run = agent.runs[i]
            algorithm = str(run.config.get("algo.agent"))
            if algorithm in done or not _is_network(run):
                continue
            problem = _file(policies, run, sources.get(run.id), export)
            if not problem:
                done.add(algorithm)
            if export or not problem:
                rows.append(Best(agent.label, run.id, float(agent.success[i].mean()), problem))
    if export:
        ids = {run.id for chosen in sections for agent, _ in chosen for run in agent.runs}
        _remove(policies, ids - {row.run for row in rows})
    return rows


def _is_network(run: RunRecord) -> bool:
    from auvbench.evaluation.exporting import why_no_network

    agent, name = str(run.config.get("algo.agent")), str(run.config.get("algo.name"))
    return agent == "onnx" or not why_no_network(name, agent, run_learns(run))


def _file(folder: Path, run: RunRecord, source: RunRecord | None, export: bool) -> str:
    """Export a run's policy unless its file exists; return the reason if the policy still has no file, otherwise ''."""
    from auvbench.evaluation import exporting

    if (folder / f"{run.id}.onnx").exists():
        return ""
    if not export or source is None or source.source.published:
        return "its weights are not in the given folders"
    try:
        exporting.export(RunDirectory(source.directory), folder)
    except AuvbenchError as error:
        if error.exit_code == 1:  # a disk error
            raise
        return str(error).removeprefix(f"{source.directory}: ")
    return ""


def _remove(folder: Path, runs: Collection[str]) -> None:
    for run in sorted(runs):
        file = folder / f"{run}.onnx"
        if file.exists():
            file.unlink()
            exported.card_path(file).unlink(missing_ok=True)
            print(f"removed {file}: its policy is no longer the best of its algorithm")


def has_policies(folder: Path) -> bool:
    """Return whether a study has policies."""
    return any((folder / FOLDER).glob("*.onnx"))


def markdown(policies: Sequence[Best]) -> str:
    """Return the README block with a table of the policies and their cards, and a list of the failed exports."""
    files = [
        (
            escape(row.agent),
            escape(row.run),
            f"{100 * row.success:.1f}",
            f"[{escape(row.run)}.onnx](<{FOLDER}/{row.run}.onnx>)",
            f"[json](<{FOLDER}/{row.run}.json>)",
        )
        for row in policies
        if not row.problem
    ]
    head = [("agent", "best run", "success (%)", "policy", "card"), ["---"] * 5]
    parts = [rows([*head, *files]), CHOSEN] if files else ["No policy."]
    parts += [f"* no file for {escape(row.agent)}: {escape(row.problem)}" for row in policies if row.problem]
    return "\n\n".join(parts)
