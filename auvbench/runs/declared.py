"""Store the analysis that an experiment declares before its runs, as a file in the experiment's folder.

`analysis.yaml` is in the folder of the runs and in the folder of a published study. It names the measure,
baseline, margin, protocol, conditions and every run. The runs are listed in stages: runs that are declared later form
a new stage with its own date. When a run is created, its manifest records the digest of the declaration at this
time. A report can therefore tell what was declared before the first run. The declaration is not part of a
run's identity: a run may belong to several analyses.

Declarations that earlier versions of auvbench wrote name only the measure, baseline, margin and number of seeds.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from itertools import accumulate
from pathlib import Path
from typing import Annotated, Any

import yaml

from auvbench.errors import UserError, closest
from auvbench.record import PRIMARY, measure_names
from auvbench.runs import history
from auvbench.runs.atomic_io import make_folder, write_atomic
from auvbench.runs.identity import DEFAULT_TASK, digest_of
from auvbench.untrusted import path_safety, reading, typed_json
from auvbench.untrusted.text import short
from auvbench.untrusted.typed_json import Count, Name, Range

FILE = "analysis.yaml"
LOCK = ".analysis.lock"
KEY = "analysis"
"""Key of the analysis in a configuration, and key of the analysis digest in a manifest"""
REPORT, ROWS = "report", "rows"
SMALLEST = 1e-12
"""Smallest valid margin, in the measure's unit"""
HEADER = "# The analysis that auvbench report uses for these runs; docs/report.md explains the keys.\n"


@dataclass(frozen=True, slots=True)
class Stage:
    """Runs that were declared at the same time."""

    declared: Name
    """Time in UTC, ISO 8601"""
    runs: dict[Name, list[Name]]
    """Ids of the runs by vehicle and task (`subject`)"""


@dataclass(frozen=True, slots=True)
class Declared:
    """A declared analysis."""

    measure: Name
    baseline: Name | None = None
    margin: Annotated[float, Range(SMALLEST)] | None = None
    """Margin in the measure's unit, percentage points for a rate; None: the report's default"""
    seeds: Annotated[int, Range(1)] | None = None
    """Planned number of training seeds"""
    protocol: Name | None = None
    """Evaluation protocol; None if an earlier version of auvbench wrote the declaration"""
    conditions: tuple[Name, ...] = ()
    """Conditions of the protocol; the verdicts are about the first condition"""
    episodes: Annotated[int, Range(1)] | None = None
    """Test episodes per condition"""
    scenario_seed: Count | None = None
    rows: tuple[Stage, ...] = ()
    report: dict[str, Any] = field(default_factory=dict)
    """Other options of the report; not part of the digest"""

    @property
    def names_runs(self) -> bool:
        """Return whether the declaration names its runs, protocol and conditions; False if an earlier version of auvbench wrote it."""
        return self.protocol is not None

    @property
    def digest(self) -> str:
        """Return the digest of everything that was declared: 16 hexadecimal digits."""
        return self.digests[-1]

    @property
    def digests(self) -> list[str]:
        """Return, for each stage, the digest of the declaration up to this stage; a single digest if the declaration names no runs."""
        if not self.names_runs:
            return [digest_of({name: getattr(self, name) for name in EARLIER}, 16)]
        base = {name: getattr(self, name) for name in (*EARLIER, *LATER)} | {
            "conditions": list(self.conditions)
        }
        stages = accumulate(([asdict(stage)] for stage in self.rows), initial=[])
        digests = [digest_of({**base, ROWS: rows}, 16) for rows in stages]
        return digests[1:] or digests

    def stage_of(self, run: str) -> tuple[Stage, str] | None:
        """Return the stage in which a run was declared, with the digest up to this stage; None if the run is not declared."""
        for stage, digest in zip(self.rows, self.digests, strict=False):
            if any(run in ids for ids in stage.runs.values()):
                return stage, digest
        return None

    def ids(self, subject: str | None = None) -> set[str]:
        """Return the ids of all declared runs, or only the runs of one `subject`."""
        return {
            id
            for stage in self.rows
            for key, ids in stage.runs.items()
            if subject in (None, key)
            for id in ids
        }

    def extends(self, other: Declared) -> bool:
        """Return whether this declaration equals `other`, or adds later stages to it."""
        return other.digest in self.digests


EARLIER = ("measure", "baseline", "margin", "seeds")
"""Fields of every declaration, including declarations that earlier versions of auvbench wrote"""
LATER = ("protocol", "conditions", "episodes", "scenario_seed")
KNOWN = tuple(f.name for f in fields(Declared))


def subject(vehicle: object, task: object) -> str:
    """Return the name of a vehicle and task for a table of their runs, e.g. 'rexrov' or 'rexrov, task docking'."""
    return str(vehicle) if task == DEFAULT_TASK else f"{vehicle}, task {task}"


def write(folder: Path, analysis: Declared) -> None:
    """Write the analysis into a folder, unless the folder already has it.

    Raises:
        OSError: the file cannot be written.
    """
    always = (*EARLIER, *LATER) if analysis.names_runs else EARLIER
    values = asdict(analysis)
    content = {key: _plain(values[key]) for key in KNOWN if key in always or values[key]}
    data = (HEADER + yaml.safe_dump(content, sort_keys=False)).encode()
    path = folder / FILE
    if not path.is_file() or path.read_bytes() != data:
        write_atomic(path, data)


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def declare(folder: Path, analysis: Declared, runs: Mapping[str, Sequence[str]], now: str) -> Declared:
    """Declare runs in a folder before they are created; return the declaration with all its stages.

    Runs that the analysis in the folder already declares keep their stage; new runs form a new stage. A different analysis
    replaces the analysis in the folder.

    Args:
        folder: folder of the experiment.
        analysis: analysis without stages.
        runs: ids of runs by `subject`.
        now: time in UTC, ISO 8601.

    Raises:
        OSError: the file cannot be written.
        UserError: the existing analysis file is invalid, or the lock file is a symbolic link.
    """
    import filelock

    make_folder(folder)
    try:
        lock = path_safety.child(folder, LOCK)
    except ValueError as error:
        raise UserError(str(error)) from error
    with filelock.FileLock(lock, thread_local=False):
        existing = read(folder / FILE) if (folder / FILE).is_file() else None
        if existing is not None and replace(existing, rows=(), report={}) == replace(
            analysis, rows=(), report={}
        ):
            analysis = existing
        declared = analysis.ids()
        new = {key: fresh for key, ids in runs.items() if (fresh := [id for id in ids if id not in declared])}
        if new:
            analysis = replace(analysis, rows=(*analysis.rows, Stage(now, new)))
        write(folder, analysis)
        if new:
            history.append(folder, history.Line(now, history.DECLARED, analysis=analysis.digest))
    return analysis


def read(path: Path) -> Declared:
    """Return the analysis in a file.

    Raises:
        UserError: the file cannot be read, or an entry is unknown or wrong.
    """
    try:
        document = reading.yaml_value(reading.content(path))
        analysis = typed_json.convert(document, Declared)
    except (OSError, ValueError) as error:
        raise UserError(f"{path}: {short(error)}") from error
    for key in document:
        if key not in KNOWN:
            raise UserError(f"{path}: unknown key {short(repr(key), 40)}; {closest(str(key), KNOWN)}")
    measures = (PRIMARY, *measure_names())
    if analysis.measure not in measures:
        raise UserError(f"{path}: measure {analysis.measure!r}: {closest(analysis.measure, measures)}")
    if analysis.names_runs and not (analysis.conditions and analysis.rows):
        raise UserError(
            f"{path}: protocol is {analysis.protocol!r}, so conditions and rows must not be empty"
        )
    return analysis


def find(paths: Iterable[Path]) -> list[tuple[Path, Declared]]:
    """Return the analyses declared for the runs under some paths, with their files.

    A path may be a run, the folder of an experiment or of a published study, or a folder above them.

    Raises:
        UserError: an analysis file is wrong.
    """
    files: dict[Path, None] = {}
    for path in paths:
        folders = [path, path.parent] if (path / "manifest.json").is_file() else [path]
        folders += [folder.parent for folder in folders if folder.name == "runs"]
        if not any((folder / FILE).is_file() for folder in folders) and path.is_dir():
            folders += sorted(child for child in path.iterdir() if child.is_dir())
        files |= dict.fromkeys(f.resolve() for folder in folders if (f := folder / FILE).is_file())
    return [(file, read(file)) for file in files]
