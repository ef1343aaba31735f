"""The parts of a study's README that are computed: between markers, so that what a person wrote around them stays."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from auvbench.analysis.model import RunRecord
from auvbench.analysis.prose import counted
from auvbench.errors import UserError
from auvbench.reporting.tables.markdown import escape
from auvbench.scheduling.estimate import duration
from auvbench.untrusted import reading

SHOWN_VERSIONS = ("auvbench", "python", "torch", "stable-baselines3", "numpy", "numba")


def fill(path: Path, title: str, blocks: Mapping[str, str]) -> str:
    """The text of a README with its computed blocks renewed.

    Args:
        path: the README; where it is missing, one with the blocks alone is begun.
        title: of a new one.
        blocks: text by the name of the block.

    Raises:
        UserError: the file is there and a block's markers are not, or not in their order.
    """
    if not path.exists():
        parts = [f"# {title}", *(_block(name, text) for name, text in blocks.items())]
        return "\n\n".join(parts) + "\n"
    text = reading.text(path)
    for name, content in blocks.items():
        begin, end = _markers(name)
        if text.count(begin) != 1 or text.count(end) != 1 or text.index(begin) > text.index(end):
            raise UserError(
                f"{path}: the block {name} has no place: put the lines {begin} and {end} where it belongs"
            )
        head, rest = text.split(begin)
        text = head + _block(name, content) + rest.split(end)[1]
    return text


def _markers(name: str) -> tuple[str, str]:
    return f"<!-- begin: {name} -->", f"<!-- end: {name} -->"


def _block(name: str, text: str) -> str:
    begin, end = _markers(name)
    return f"{begin}\n{text.strip()}\n{end}"


def provenance(runs: Sequence[RunRecord], command: str) -> str:
    """How the numbers came about: runs, machines, time, versions and the command, as a Markdown list."""
    manifests = [run.manifest for run in runs]
    wall = sum(float(m.get("wall_time_s") or 0.0) for m in manifests)
    core = sum(float(m.get("wall_time_s") or 0.0) * _threads(m) for m in manifests)
    days = sorted(str(m[key])[:10] for m in manifests for key in ("started", "ended") if m.get(key))
    steps = sum(int(m.get("steps") or 0) for m in manifests)
    lines = [
        f"{counted(len(runs), 'run')}, {steps:,} environment steps of training",
        f"trained in {duration(wall)}, one run after another; {duration(core)} of processor cores",
        f"machine: {_tally(_machine(m) for m in manifests)}",
        f"versions: {_tally(_versions(m) for m in manifests)}",
        f"source: {_tally(_commit(m) for m in manifests)}",
    ]
    if days:
        lines.append(f"dates: {days[0]}" + (f" to {days[-1]}" if days[-1] != days[0] else ""))
    items = "\n".join(f"* {escape(line)}" for line in lines)
    return f"{items}\n\nThe runs were copied, and all between markers computed from the copies, by\n\n    {command}"


def _threads(manifest: Mapping[str, Any]) -> int:
    host = manifest.get("host")
    threads = host.get("threads") if isinstance(host, Mapping) else 1
    return threads if isinstance(threads, int) else 1


def _machine(manifest: Mapping[str, Any]) -> str:
    host = manifest.get("host")
    host = host if isinstance(host, Mapping) else {}
    return f"{host.get('cpu', 'unknown processor')}, {host.get('cores', '?')} cores"


def _versions(manifest: Mapping[str, Any]) -> str:
    versions = manifest.get("versions")
    versions = versions if isinstance(versions, Mapping) else {}
    return ", ".join(f"{name} {versions.get(name, '?')}" for name in SHOWN_VERSIONS)


def _commit(manifest: Mapping[str, Any]) -> str:
    git = manifest.get("git")
    git = git if isinstance(git, Mapping) else {}
    commit = str(git.get("commit") or "")
    if not re.fullmatch(r"[0-9a-f]{40}", commit):
        return "an installed package"
    return f"commit {commit[:12]}{', changed' if git.get('dirty') else ''}"


def _tally(names: Any) -> str:
    """'a (3 runs), b (1 run)', or 'a' alone."""
    found = Counter(names)
    if len(found) == 1:
        return str(next(iter(found)))
    return "; ".join(f"{name} ({counted(n, 'run')})" for name, n in found.most_common())
