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
    """Write the plain values of the best settings as a preset; `evidence` is a sentence about their gain."""
    today = datetime.now(UTC).date().isoformat()
    git = provenance.git()
    commit = f" (commit {git['commit'][:12]}{', modified' if git['dirty'] else ''})" if git["commit"] else ""
    name = name_of(plan)
    searched = [dimension.key.partition(".")[2] for dimension in plan.dimensions]
    head = [
        f"{name}: found by {plan.command or 'auvbench tune'}",
        f"on {today} with auvbench {__version__}{commit}: {trials} trials, {steps:,} environment steps of training, scenarios of",
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
    write_atomic(
        path, (text + yaml.safe_dump(body, sort_keys=False, width=100, default_flow_style=None)).encode()
    )
