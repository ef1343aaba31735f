"""The analysis that an experiment declares before its runs, as a file in the experiment's folder.

`analysis.yaml` lies in the folder of the runs, and above the copies of a published study. The manifest of each run
carries its digest from the moment the run is made, so a report can tell an analysis that was declared before the first run.
It is no part of a run's identity: one run may serve several analyses.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any

import yaml

from auvbench.errors import UserError, closest
from auvbench.record import PRIMARY, measure_names
from auvbench.runs.atomic_io import write_atomic
from auvbench.runs.identity import digest_of
from auvbench.untrusted import reading, typed_json
from auvbench.untrusted.text import short
from auvbench.untrusted.typed_json import Name, Range

FILE = "analysis.yaml"
KEY = "analysis"
"""of a configuration, and of a manifest, which has the digest"""
REPORT = "report"
"""key of a published analysis: other options of the report that made the shipped tables"""
SMALLEST = 1e-12
"""margin"""
HEADER = "# The analysis that auvbench report uses for these runs; docs/report.md explains the keys.\n"


@dataclass(frozen=True, slots=True)
class Declared:
    """A declared analysis: the primary measure, the baseline, the margin and the planned training seeds."""

    measure: Name
    baseline: Name | None = None
    margin: Annotated[float, Range(SMALLEST)] | None = None
    """in the measure's unit, percentage points for a rate; None is the report's default"""
    seeds: Annotated[int, Range(1)] | None = None
    report: dict[str, Any] = field(default_factory=dict)
    """other options of a report; no part of the digest"""

    @property
    def digest(self) -> str:
        """16 hexadecimal digits of what was declared."""
        return digest_of({name: getattr(self, name) for name in DECLARED}, 16)


DECLARED = tuple(f.name for f in fields(Declared) if f.name != REPORT)


def write(folder: Path, analysis: Declared) -> None:
    """Write the analysis into a folder, unless this very one is there.

    Raises:
        OSError: it cannot be written.
    """
    content = {key: value for key, value in asdict(analysis).items() if value or key in DECLARED}
    data = (HEADER + yaml.safe_dump(content, sort_keys=False)).encode()
    path = folder / FILE
    if not path.is_file() or path.read_bytes() != data:
        write_atomic(path, data)


def read(path: Path) -> Declared:
    """Return the analysis in a file.

    Raises:
        UserError: it cannot be read, or an entry is unknown or wrong.
    """
    try:
        found = reading.yaml_value(reading.content(path))
        analysis = typed_json.convert(found, Declared)
    except (OSError, ValueError) as error:
        raise UserError(f"{path}: {short(error)}") from error
    known = [*DECLARED, REPORT]
    for key in found:
        if key not in known:
            raise UserError(f"{path}: unknown key {short(repr(key), 40)}; {closest(str(key), known)}")
    measures = (PRIMARY, *measure_names())
    if analysis.measure not in measures:
        raise UserError(f"{path}: measure {analysis.measure!r}: {closest(analysis.measure, measures)}")
    return analysis


def find(paths: Iterable[Path]) -> list[tuple[Path, Declared]]:
    """Return the analyses declared for the runs under some paths, with their files.

    A path may be a run, the folder of an experiment or of a published study, or a folder above them.

    Raises:
        UserError: one of the files is wrong.
    """
    files: dict[Path, None] = {}
    for path in paths:
        folders = [path, path.parent] if (path / "manifest.json").is_file() else [path]
        folders += [folder.parent for folder in folders if folder.name == "runs"]
        if not any((folder / FILE).is_file() for folder in folders) and path.is_dir():
            folders += sorted(child for child in path.iterdir() if child.is_dir())
        files |= dict.fromkeys(f.resolve() for folder in folders if (f := folder / FILE).is_file())
    return [(file, read(file)) for file in files]
