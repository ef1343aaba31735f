"""What a reader needs to judge and repeat the numbers of runs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from auvbench.analysis.records import RunRecord

Facts = list[tuple[str, tuple[str, ...]]]
"""titles, and the different values of the runs"""


def facts(runs: Sequence[RunRecord]) -> Facts:
    """Return vehicles, simulators, machines, versions and commits of the runs; without those that no run has."""
    versions, commits, hosts = (
        [found for run in runs if (found := run.manifest.get(key))] for key in ("versions", "git", "host")
    )
    packages = sorted({str(name) for found in versions for name in found})
    found = [
        ("Vehicle", distinct(run.config.get("vehicle.name") for run in runs)),
        ("Simulator", distinct(run.config.get("simulator.name") for run in runs)),
        ("Versions", tuple(f"{n} {' and '.join(distinct(v.get(n) for v in versions))}" for n in packages)),
        ("Source", distinct(_commit(git) for git in commits)),
        ("Hosts", distinct(f"{host.get('cpu')}, {host.get('cores')} cores" for host in hosts)),
    ]
    return [(name, values) for name, values in found if values]


def _commit(git: Mapping[str, Any]) -> str:
    commit = str(git.get("commit") or "")[:12]
    return f"commit {commit}{' with local changes' if git.get('dirty') else ''}" if commit else ""


def distinct(values: Iterable[Any]) -> tuple[str, ...]:
    """Return the different values as sorted text, without missing ones."""
    return tuple(sorted({str(value) for value in values if value is not None and value != ""}))
