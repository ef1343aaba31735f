"""Repeat the test of an entry with only the entry's archive, and compare the rows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
from omegaconf import OmegaConf

from auvbench.analysis.archive import FOLLOWING, Archive
from auvbench.analysis.conditions import default
from auvbench.analysis.grouping import agents, sections
from auvbench.analysis.load import load, require
from auvbench.analysis.ranking import rank
from auvbench.analysis.records import RunRecord
from auvbench.config import schema
from auvbench.config.compose import option
from auvbench.config.tasks import primary_of
from auvbench.errors import ReportError, RunError
from auvbench.evaluation.evaluate import stale
from auvbench.evaluation.parallel import evaluate_all
from auvbench.registry import AGENTS
from auvbench.reporting.entries import MODELS, Entry, Verified, model_files
from auvbench.runs import integrity, provenance
from auvbench.runs.atomic_io import as_json, write_atomic
from auvbench.runs.directory import RunDirectory, freeze, now
from auvbench.runs.pool import Pool
from auvbench.training.execute import execute
from auvbench.untrusted import path_safety
from auvbench.untrusted.text import short

BASELINE = "pid"
EMBEDDED = "fossen"
"""The only simulator that an entry may use; other simulators connect to programs on this machine"""


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of comparing the submitted rows with the rows of the repeated test."""

    verified: Verified
    lines: tuple[str, ...]
    """Sentences on the comparison"""


def rebuilt(entry: Entry, folder: Path, target: Path) -> list[RunDirectory]:
    """Return the runs of an unpacked entry as run directories below `target`, without evaluations.

    Raises:
        ReportError: a run is damaged, uses another simulator than the embedded one, or starts a program.
    """
    study = Archive(folder)
    runs = []
    for name in study.ids():
        try:
            place = path_safety.child(target, name)
            config = study.document(name, "config")
            _refuse_programs(config["simulator"]["name"], config["algo"]["agent"])
            run = RunDirectory(place)
            place.mkdir(parents=True)
            run.write_config({**config, "output": str(target.parent), "name": target.name})
            write_atomic(run.manifest_path, as_json(study.document(name, "manifest")))
            for file in model_files(entry, name):
                source = path_safety.child(folder, file)
                within = file.removeprefix(f"{MODELS}/{name}/")
                write_atomic(path_safety.child(run.model, within), source.read_bytes())
            run.check()
            if lost := integrity.lacking(run.path, run.manifest(), "model/"):
                raise ValueError(lost)
        except (ValueError, KeyError, TypeError, RunError) as error:
            raise ReportError(f"{entry.name}: run {short(name, 80)}: {short(error)}") from error
        runs.append(run)
    return runs


def _refuse_programs(simulator: object, agent: object) -> None:
    """Raise ValueError for a configuration whose test would start or contact another program."""
    if simulator != EMBEDDED:
        raise ValueError(f"simulator={short(simulator, 40)}: an entry must use simulator={EMBEDDED}")
    if isinstance(agent, str) and agent in AGENTS and AGENTS[agent].program:
        raise ValueError(f"algo={agent}: an entry must not start a program; publish a study instead")


def baseline(runs: Sequence[RunDirectory], target: Path) -> RunDirectory | None:
    """Return a new run of PID for the task and vehicle of an entry; None if the entry's agent is PID."""
    config = runs[0].config()
    if config["algo"]["agent"] == BASELINE:
        return None
    algo = OmegaConf.to_container(option("algo", BASELINE), resolve=True)
    run = freeze({**config, "algo": algo, "seed": 0, "output": str(target.parent), "name": target.name})
    execute(run)
    return run


def compare(
    entry: Entry,
    folder: Path,
    work: Path,
    protocol: schema.Protocol,
    pool: Pool,
    report: Callable[[RunDirectory, str, int], None] = lambda *_: None,
) -> Outcome:
    """Repeat the test of an unpacked entry, and compare its rows with the submitted rows.

    Args:
        entry: description of the entry.
        folder: folder of the unpacked entry.
        work: empty folder for runs.
        protocol: protocol of the entry.
        pool: worker processes.
        report: function that shows the progress; see `evaluate_all`.

    Raises:
        ReportError: a run cannot be tested, or its scenarios have changed.
    """
    runs = rebuilt(entry, folder, work / "again")
    reference = baseline(runs, work / "baseline")
    for result in evaluate_all([*runs, *([reference] if reference else [])], protocol, pool, report=report):
        if result.error:
            raise ReportError(f"{entry.name}: {result.error}")
    submitted, problems = load([folder], entry.protocol)
    require(submitted, problems, entry.protocol)
    retested = {run.id: run for run in load([run.path for run in runs], entry.protocol)[0]}
    ids = {run.id for run in submitted}
    different = []
    for run in submitted:
        if run.state != "complete":
            continue
        submitted_rows = run.evaluations.get(entry.protocol)
        other = retested[run.id].evaluations[entry.protocol]
        if submitted_rows is None or submitted_rows.fingerprint != other.fingerprint:
            raise ReportError(
                f"{entry.name}: this version of auvbench draws different scenarios for {run.id}; verify "
                f"with auvbench {short(entry.auvbench, 40)}"
            )
        if not same_rows(submitted_rows.episodes, other.episodes):
            different.append(run.id)
    beside = [reference.path] if reference else []
    before, value, (low, high) = _verdict([folder, *beside], entry.protocol, ids)
    after, value_again, _ = _verdict([work / "again", *beside], entry.protocol, ids)
    cpu = str(provenance.host()["cpu"])
    same_cpu = cpu == entry.cpu
    agree = before == after and low <= value_again <= high
    ok = not different or (not same_cpu and agree)
    lines = (
        f"rows: {len(submitted) - len(different)} of {len(submitted)} runs have the same bits",
        f"processor: {cpu}" + ("" if same_cpu else f"; submitted from {short(entry.cpu, 80)}"),
        f"verdict against PID: {before} in the entry, {after} when repeated; "
        f"measure: {value:.5g} in the entry, {value_again:.5g} when repeated",
    )
    version = provenance.versions()["auvbench"]
    return Outcome(Verified(now(), version, cpu, not different, before, after, ok), lines)


def same_rows(first: pd.DataFrame, second: pd.DataFrame) -> bool:
    """Return whether two tables of episodes have the same columns, in any order, and values with the same bits."""
    tables = [frame.drop(columns=[c for c in FOLLOWING if c in frame.columns]) for frame in (first, second)]
    names = [sorted(frame.columns) for frame in tables]
    if names[0] != names[1]:
        return False
    a, b = (frame[names[0]].reset_index(drop=True) for frame in tables)
    return all(a[c].tolist() == b[c].tolist() or a[c].equals(b[c]) for c in names[0])


def _verdict(paths: Sequence[Path], protocol: str, ids: set[str]) -> tuple[str, float, tuple[float, float]]:
    """Return the verdict on the agent of the runs `ids` against the baseline, the agent's primary measure, and its interval."""
    runs, _ = load(paths, protocol)
    (part, *_) = sections(runs, protocol)
    condition = default(part.runs, protocol)
    grouped, _ = agents(part.runs, protocol, condition)
    measure = primary_of(str(part.runs[0].config.get("task.name")))
    ranking = rank(grouped, rank_by=measure, protocol=protocol, condition=condition)
    row = next(row for row in ranking.rows if ids & set(row.run_ids))
    estimate = row.estimates[ranking.rank_by]
    against = None if ranking.primary is None else ranking.primary.of(row.label)
    return "none" if against is None else against.verdict, estimate.value, (estimate.low, estimate.high)


def refuse_unfit(runs: Sequence[RunRecord]) -> None:
    """Raise ReportError if a run cannot be an entry: it has no weights, or its test needs another program."""
    for run in runs:
        if run.source.published:
            raise ReportError(
                f"{run.directory.parent}: a published study has no weights; name the folder of the runs"
            )
        try:
            _refuse_programs(run.config.get("simulator.name"), run.config.get("algo.agent"))
        except ValueError as error:
            raise ReportError(f"{run.id}: {error}") from error


def refuse_stale(run: RunDirectory, protocol: schema.Protocol) -> None:
    """Raise ReportError unless a run's test is complete and uses the current scenarios."""
    why = stale(run, protocol)
    if why != "":
        raise ReportError(
            f"{run.path}: {why or f'no test by protocol {protocol.name}'}; type auvbench evaluate {run.path} "
            f"protocol={protocol.name}"
        )
