"""What a study found, as a preset: `best.yaml`, which becomes `algo=NAME` in ./conf/algo."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import yaml

from auvbench import __version__
from auvbench.config.tuning import STREAM
from auvbench.runs import provenance
from auvbench.runs.files import write_atomic
from auvbench.tuning.folder import Plan


def name_of(plan: Plan) -> str:
    """How runs and tables call the preset."""
    name = str(plan.base["algo"]["name"])
    return f"{plan.name}_tuned" if plan.name == name else plan.name


def write(path: Path, plan: Plan, algo: Mapping[str, Any], *, trials: int, steps: int, evidence: str) -> str:
    """Writes the preset; returns its text.

    Args:
        path: of the file.
        plan: of the study.
        algo: the plain values that were found.
        trials: that were begun.
        steps: environment steps of training behind them.
        evidence: a line on what they gained, for the header.
    """
    now = datetime.now(UTC).date().isoformat()
    name = name_of(plan)
    searched = [dimension.key.partition(".")[2] for dimension in plan.dimensions]
    head = [
        f"# {name}: found by {plan.command or 'auvbench tune'}",
        f"# on {now} with auvbench {_version()}: {trials} trials, {steps:,} environment steps of training, scenarios of",
        f"# protocol={plan.protocol.name} (seed {plan.protocol.seed}, {plan.protocol.episodes} episodes); no test was looked at.",
        f"# {evidence}",
        f"# Searched: {', '.join(searched)}.",
        f"# To use it: cp {path} conf/algo/{name}.yaml, then algo={name}.",
    ]
    values = {key: value for key, value in algo.items() if key not in ("name", "agent", "tuned")}
    body = {
        "defaults": [f"/{algo['agent']}_schema@_here_", "_self_"],
        "name": name,
        "agent": algo["agent"],
        **values,
        "tuned": {
            "study": plan.name,
            "protocol": plan.protocol.name,
            "scenarios": STREAM,
            "seed": plan.protocol.seed,
            "trials": trials,
            "steps": steps,
            "version": __version__,
            "date": now,
        },
    }
    text = "\n".join(head) + "\n" + yaml.dump(body, Dumper=_Dumper, sort_keys=False, width=100)
    write_atomic(path, text.encode())
    return text


def _version() -> str:
    """`0.1.0`, of a checkout `0.1.0 (commit 1a2b3c4d5e6f)`, and `, modified` where files differ from it."""
    git = provenance.git()
    if not git["commit"]:
        return __version__
    return f"{__version__} (commit {git['commit'][:12]}{', modified' if git['dirty'] else ''})"


class _Dumper(yaml.SafeDumper):
    """Short lists in one line, and floats that YAML reads as floats: 1.0e-05, not 1e-05."""


def _list(dumper: yaml.SafeDumper, items: list[Any]) -> yaml.Node:
    return dumper.represent_sequence("tag:yaml.org,2002:seq", items, flow_style=True)


_Dumper.add_representer(list, _list)
