"""The best settings of a study as a preset: `best.yaml`, to copy into ./conf/algo."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import yaml

from auvbench import __version__
from auvbench.config.tuning import STREAM
from auvbench.runs import provenance
from auvbench.runs.atomic_io import write_atomic
from auvbench.tuning.folder import Plan


def name_of(plan: Plan) -> str:
    """Return the preset's name in runs and tables."""
    name = str(plan.base["algo"]["name"])
    return f"{plan.name}_tuned" if plan.name == name else plan.name


def write(path: Path, plan: Plan, algo: Mapping[str, Any], *, trials: int, steps: int, evidence: str) -> None:
    """Write the preset.

    Args:
        path: of the file.
        plan: of the study.
        algo: plain values of the best settings.
        trials: how many have begun.
        steps: environment steps of training in the search.
        evidence: a sentence about the gain.
    """
    today = datetime.now(UTC).date().isoformat()
    name = name_of(plan)
    searched = [dimension.key.partition(".")[2] for dimension in plan.dimensions]
    head = [
        f"{name}: found by {plan.command or 'auvbench tune'}",
        f"on {today} with auvbench {_version()}: {trials} trials, {steps:,} environment steps of training, scenarios of",
        f"protocol={plan.protocol.name} (seed {plan.protocol.seed}, {plan.protocol.episodes} episodes), none of a test.",
        evidence,
        f"Searched: {', '.join(searched)}.",
        f"To use it: cp {path} conf/algo/{name}.yaml, then algo={name}.",
    ]
    body = {
        "defaults": [f"/{algo['agent']}_schema@_here_", "_self_"],
        "name": name,
        "agent": algo["agent"],
        **{key: value for key, value in algo.items() if key not in ("name", "agent", "tuned")},
        "tuned": {
            "study": plan.name,
            "protocol": plan.protocol.name,
            "scenarios": STREAM,
            "seed": plan.protocol.seed,
            "trials": trials,
            "steps": steps,
            "version": __version__,
            "date": today,
        },
    }
    text = "".join(f"# {' '.join(line.split())}\n" for line in head)
    write_atomic(path, (text + yaml.dump(body, Dumper=_Dumper, sort_keys=False, width=100)).encode())


def _version() -> str:
    """Return `0.1.0`, or `0.1.0 (commit 1a2b3c4d5e6f, modified)` in a checkout."""
    git = provenance.git()
    if not git["commit"]:
        return __version__
    return f"{__version__} (commit {git['commit'][:12]}{', modified' if git['dirty'] else ''})"


class _Dumper(yaml.SafeDumper):
    """Write lists in one line."""


def _list(dumper: yaml.SafeDumper, items: list[Any]) -> yaml.Node:
    return dumper.represent_sequence("tag:yaml.org,2002:seq", items, flow_style=True)


_Dumper.add_representer(list, _list)
