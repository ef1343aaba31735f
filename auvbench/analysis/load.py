"""Read run directories for a report, and name the problems that keep runs or evaluations out of the tables.

A damaged run does not stop the reading: `load` returns the readable runs, and a `Problem` for each damaged run.
docs/runs.md describes the directories, and docs/protocol.md the CSV files.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from auvbench.analysis.archive import RUNS, Archive, is_archive
from auvbench.analysis.damage import Damage, is_name, named
from auvbench.analysis.evaluations import check_belongs, disagreement, evaluation_of
from auvbench.analysis.formatting import listed
from auvbench.analysis.grouping import agents
from auvbench.analysis.records import Problem, RunRecord
from auvbench.analysis.sources import PublishedRun, RunFolder, RunSource
from auvbench.config.folders import options
from auvbench.errors import ConfigError, ReportError, closest
from auvbench.registry import TASKS
from auvbench.runs import integrity, progress, status
from auvbench.runs import run_filter as filters
from auvbench.runs.directory import RunDirectory, as_words, folders_of_runs
from auvbench.runs.identity import LATER
from auvbench.untrusted import reading
from auvbench.untrusted.columns import LARGEST
from auvbench.untrusted.path_safety import is_plain
from auvbench.untrusted.text import short

__all__ = ["agents", "available_protocols", "load", "readable_runs", "require"]

NAMED = 3
"""largest number of problems to name in the error of a report without a usable run"""

NUMBERS = (
    "reward.k",
    "step.frequency",
    "task.goal_radius",
    "task.depth_low",
    "task.depth_high",
    "task.max_steps",
)
"""configuration keys that a report calculates with or sorts by"""


_Read = tuple[RunRecord | None, list[Problem]]
"""a run (None if it cannot be used) and its problems"""


def load(
    paths: Iterable[str | Path], protocol: str | Sequence[str] = "test", where: Sequence[str] = ()
) -> tuple[list[RunRecord], list[Problem]]:
    """Return all runs under some paths, with their evaluations by the given protocols.

    Args:
        paths: run directories, or folders that contain them.
        protocol: names of the protocols whose evaluations are read. A complete run that was not tested by the
            first protocol is a problem; tests by the other protocols may be missing.
        where: terms that a run must match, as in `auvbench.runs.run_filter`: ["vehicle=rexrov",
            "reward.k=1,40"].

    Returns:
        Runs sorted by id, including failed and unfinished ones (without evaluations), and the problems.

    Raises:
        RunError: a path does not exist, or is a file that does not belong to a run.
        ReportError: no run under the paths is readable.
        UserError: a term of `where` has a key or value that no run has.
    """
    protocols = (protocol,) if isinstance(protocol, str) else tuple(protocol)
    problems: list[Problem] = []
    records = _readable(paths, problems)
    if not records:
        details = f": {problems[0].where}: {problems[0].message}" if problems else ""
        raise ReportError(f"no run under {', '.join(map(str, paths))}{details}")
    records = _with_later_keys(records)
    if where:
        records = filters.select(records, filters.parse(where), _facts)
    read = [_with_evaluations(run, protocols) for run in records]
    runs = _collect(_one_per_id(read, protocols[0]), problems)
    return runs, problems


def readable_runs(paths: Iterable[str | Path]) -> list[RunRecord]:
    """Return all readable runs under some paths, without their evaluations."""
    return _readable(paths, [])


def _readable(paths: Iterable[str | Path], problems: list[Problem]) -> list[RunRecord]:
    """Return the readable runs, and add the problems of unreadable runs to `problems`."""
    sources = list(_directories(paths, problems))
    runs = _collect((_read_run(source) for source in sources if not is_archive(source)), problems)
    for study in filter(is_archive, sources):
        runs += _collect(_read_study(study), problems)
    return runs


def _facts(run: RunRecord) -> dict[str, Any]:
    experiment = run.directory.absolute().parent.name
    return {**run.config, "state": run.state, "id": run.id, "experiment": experiment}


def _collect(read: Iterable[_Read], problems: list[Problem]) -> list[RunRecord]:
    """Return the runs, and add their problems to `problems`."""
    runs = []
    for run, run_problems in read:
        problems += run_problems
        if run is not None:
            runs.append(run)
    return runs


def _with_later_keys(runs: Sequence[RunRecord]) -> list[RunRecord]:
    """Give runs of earlier auvbench versions the configuration keys that later versions introduced.

    A run gets a key if another run of the same algorithm and task has it. The added value has no effect, so that
    runs of both versions can be seeds of one agent.
    """
    unchanged = filters.flat(LATER)
    kinds = [(run.config.get("algo.name"), run.config.get("task.name")) for run in runs]
    keys_of: dict[Any, set[str]] = {}
    for run, kind in zip(runs, kinds, strict=True):
        keys_of.setdefault(kind, set()).update(unchanged.keys() & run.config.keys())
    return [
        replace(run, config={**{key: unchanged[key] for key in keys_of[kind]}, **run.config})
        for run, kind in zip(runs, kinds, strict=True)
    ]


def available_protocols(runs: Iterable[RunRecord]) -> list[str]:
    """Return the names of the protocols by which at least one run was tested."""
    return sorted({name for run in runs for name in run.source.protocols()})


def require(runs: Sequence[RunRecord], problems: Sequence[Problem], protocol: str) -> None:
    """Raise an error if no run has a usable evaluation by a protocol.

    Raises:
        ReportError: no run has a usable evaluation; the error names the available protocols, or the first problems.
    """
    if any(protocol in run.evaluations for run in runs):
        return
    protocols = available_protocols(runs)
    if not protocols and protocol not in (available := options("protocol")):
        raise ReportError(f"--protocol {protocol}: no such protocol; {closest(protocol, available)}")
    if protocols and protocol not in protocols:
        raise ReportError(
            f"none of the {len(runs)} runs was evaluated by protocol {protocol!r}; {closest(protocol, protocols)}"
        )
    untested = [
        run.directory
        for run in runs
        if run.state == "complete" and not run.source.published and protocol not in run.source.protocols()
    ]
    if untested and not any(problem.kind in ("damaged", "foreign") for problem in problems):
        argument = "" if protocol == "test" else f" protocol={protocol}"
        none = "the run was not" if len(runs) == 1 else f"none of the {len(runs)} runs was"
        raise ReportError(
            f"{none} tested by protocol {protocol!r}; type auvbench evaluate {as_words(untested)}{argument}"
        )
    reasons = listed([f"{p.where}: {p.message}" for p in problems], NAMED)
    raise ReportError(
        f"none of the {len(runs)} runs has a usable evaluation by protocol {protocol!r}: {reasons}"
    )


def _directories(paths: Iterable[str | Path], problems: list[Problem]) -> Iterator[Path]:
    resolved: set[Path] = set()
    for path in map(Path, paths):
        folders = list(folders_of_runs(path, is_archive))
        for folder in folders:
            if not is_archive(folder) and not (folder / "manifest.json").is_file():
                problems.append(Problem(str(folder), "damaged", "config.yaml without a manifest.json"))
            elif (real := folder.resolve()) not in resolved:
                resolved.add(real)
                yield folder
        if not folders:
            problems.append(
                Problem(str(path), "missing", "the folder contains no run (no folder with a manifest.json)")
            )


def _read_run(directory: Path) -> _Read:
    try:
        with named("manifest.json"):
            manifest = integrity.read(directory / "manifest.json", integrity.Manifest)
        with named("config.yaml"):
            config = reading.yaml_value(reading.content(directory / "config.yaml"))
        run = _record(RunFolder(directory), manifest, config)
        if run.state == "running":
            at = status.of(RunDirectory(directory), manifest)
            newest = progress.newest(progress.read(directory), manifest)
            run = replace(run, state=str(at.state), manifest=manifest | newest)
        return run, []
    except Damage as damage:
        return None, [Problem(str(directory), damage.kind, str(damage))]


def _read_study(folder: Path) -> list[_Read]:
    """Return the runs of a published study."""
    try:
        archive = Archive(folder)
    except Damage as damage:
        return [(None, [Problem(str(folder), damage.kind, str(damage))])]
    results: list[_Read] = []
    for name in archive.ids():
        try:
            with named(f"{RUNS}: manifest of {short(name, 60)}"):
                manifest = integrity.checked(archive.document(name, "manifest"), integrity.Manifest)
            config = archive.document(name, "config")
            archive.summaries(name)
            results.append((_record(PublishedRun(archive, name), manifest, config), []))
        except (Damage, ValueError) as damage:
            kind = getattr(damage, "kind", "damaged")
            results.append((None, [Problem(f"{folder}: {name}", kind, str(damage))]))
    return results


def _record(source: RunSource, manifest: dict[str, Any], config: Any) -> RunRecord:
    if not is_name(manifest["id"]) or not is_plain(manifest["id"]):
        raise Damage(f"manifest.json: id must be a valid file name, got {_brief(manifest['id'])}")
    if source.published and manifest["id"] != source.directory.name:
        raise Damage(f"manifest.json belongs to the run {_brief(manifest['id'])}", "foreign")
    flat = _flattened(config)
    if release := flat.get("task.package"):
        try:  # the installed release of the package describes the metrics, even if the run used another release
            name = str(flat.get("task.name"))
            if (spec := TASKS.find(name)) is None:
                raise TASKS.missing(name, str(release))
            TASKS.enter(spec)
        except ConfigError as error:
            raise Damage(str(error), "missing") from error
    if wrong := disagreement(manifest, config):
        raise Damage(wrong)
    return RunRecord(
        id=manifest["id"],
        source=source,
        state=manifest["state"],
        seed=manifest["seed"],
        config=flat,
        manifest=manifest,
    )


def _flattened(config: Any) -> dict[str, Any]:
    """Return a configuration by dotted keys, after checking the types of the values that labels and groups need.

    Raises:
        Damage: the configuration is empty, or a value has the wrong type.
    """
    if not isinstance(config, dict):
        raise Damage("config.yaml is empty")
    with named("config.yaml"):  # flattening fails for a YAML anchor that contains itself
        flat = filters.flat(config)
    if not is_name(algo := flat.get("algo.name")):
        raise Damage(
            f"config.yaml is not a run's configuration (algo.name must be a name; it is {_brief(algo)})"
        )
    for key, value in flat.items():
        if _is_name_of_a_choice(key) and value is not None and not isinstance(value, str):
            raise Damage(f"config.yaml: {short(key, 60)} must be a name, got {_brief(value)}")
        if isinstance(value, str) and value and _is_shown(key) and not is_name(value):
            raise Damage(
                f"config.yaml: {short(key, 60)} must be one short line of visible characters, got {_brief(value)} "
                f"({len(value):,} characters)"
            )
    for key in NUMBERS:
        value = flat.get(key)
        if value is not None and (type(value) not in (int, float) or not abs(value) <= LARGEST):
            raise Damage(f"config.yaml: {key} must be a number of plausible size, got {_brief(value)}")
    return flat


def _is_name_of_a_choice(key: str) -> bool:
    """Return whether a key names the chosen option of a configuration group: algo.name, task.name, vehicle.name."""
    return key.endswith(".name") and key.count(".") == 1


def _is_shown(key: str) -> bool:
    """Return whether a report may show the key's text; long texts of sheets (sources, remarks) and paths are not shown."""
    return key in ("vehicle.name", "vehicle.title") or not key.startswith(
        ("vehicle.", "output", "launcher.", "algo.path")
    )


def _brief(value: Any) -> str:
    return "absent" if value is None else short(repr(value), 40)


def _one_per_id(read: Sequence[_Read], protocol: str) -> Iterator[_Read]:
    """Yield one run per id, sorted by id; of several copies of a run, yield only the most complete copy.

    These criteria choose the copy, the most important first: it is complete; it was tested by the protocol; it has
    tests by more protocols; it is a run directory, not part of a published study; it ended last; its folder is
    the last by name.

    A duplicate problem names each copy that was not chosen. Other problems of these copies are not reported,
    because the run is in the tables.
    """
    by_id: dict[str, list[tuple[RunRecord, list[Problem]]]] = {}
    for run, problems in read:
        if run is not None:
            by_id.setdefault(run.id, []).append((run, problems))
    for _, copies in sorted(by_id.items()):
        copies.sort(
            key=lambda copy: (
                copy[0].state == "complete",
                protocol in copy[0].evaluations,
                len(copy[0].evaluations),
                not copy[0].source.published,
                str(copy[0].manifest.get("ended") or ""),
                str(copy[0].directory),
            )
        )
        *duplicates, (counts, problems) = copies
        for copy, _ in duplicates:
            message = (
                f"two copies of one run: the report uses {counts.directory} and ignores {copy.directory}"
            )
            problems = [*problems, Problem(copy.id, "duplicate", message)]
        yield counts, problems


def _with_evaluations(run: RunRecord, protocols: Sequence[str]) -> _Read:
    """Return the run with its evaluations; a failed or unfinished run gets none."""
    if run.state != "complete":
        return run, [_why_not(run)]
    evaluations = {}
    problems = []
    for name in protocols:
        if name not in run.source.protocols():
            if name == protocols[0]:
                hint = f"auvbench evaluate {run.directory} protocol={name}"
                problems.append(Problem(run.id, "missing", f"no evaluation by protocol {name}: {hint}"))
            continue
        try:
            evaluation = evaluation_of(run, name)
            check_belongs(run.manifest, evaluation)
            evaluations[name] = evaluation
        except Damage as damage:
            problems.append(Problem(run.id, damage.kind, f"evaluation {name}: {damage}"))
    return replace(run, evaluations=evaluations), problems


def _why_not(run: RunRecord) -> Problem:
    manifest = run.manifest
    if run.state == "failed":
        error = manifest["error"] or {}
        at = f" at step {error['step']:,}" if error.get("step") is not None else ""
        return Problem(run.id, "failed", f"failed{at}: {error.get('message', 'no message')}")
    steps, total = manifest["steps"], manifest["total_steps"]
    share = f" at {steps:,} of {total:,} steps" if total else ""
    hint = (
        "report again when it is complete"
        if run.state == "running"
        else "repeat its `auvbench train` command to finish it"
    )
    return Problem(run.id, "unfinished", f"{run.state}{share}: {hint}")
