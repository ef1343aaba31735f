"""Declare the runs of an experiment before they are created."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from auvbench.config import folders, schema
from auvbench.config.compose import compose
from auvbench.config.validate import evaluate_config
from auvbench.errors import ConfigError, closest
from auvbench.runs import declared
from auvbench.runs.declared import Declared

UNDISTURBED = "nominal"
"""Name of the condition that a report shows by default"""


def completed(analysis: schema.Analysis) -> Declared:
    """Return the declaration of an analysis, without runs.

    The scenario seed comes from the protocol. The conditions and episodes come from the protocol if the analysis gives none.

    Raises:
        ConfigError: the protocol or a condition is unknown.
    """
    protocols = folders.options("protocol")
    if analysis.protocol not in protocols:
        raise ConfigError(f"analysis.protocol={analysis.protocol}: {closest(analysis.protocol, protocols)}")
    protocol = evaluate_config(compose("evaluate", [f"protocol={analysis.protocol}"])).protocol
    names = [condition.name for condition in protocol.conditions]
    for name in analysis.conditions or []:
        if name not in names:
            raise ConfigError(f"analysis.conditions={name}: {closest(name, names)}")
    usual = sorted(names, key=lambda name: name != UNDISTURBED)
    return Declared(
        analysis.measure,
        analysis.baseline,
        analysis.margin,
        analysis.seeds,
        analysis.protocol,
        tuple(analysis.conditions or usual),
        analysis.episodes or protocol.episodes,
        protocol.seed,
    )


def declare_all(
    analyses: Mapping[Path, Declared], configs: Mapping[Path, Mapping[str, Any]], now: str
) -> dict[Path, str]:
    """Declare runs in the folders of their experiments; return the digests that the runs' manifests must record, by run folder.

    Args:
        analyses: analysis by run folder; runs without an analysis are left out.
        configs: resolved configuration by run folder.
        now: time in UTC, ISO 8601.

    Raises:
        OSError, UserError: see `declared.declare`.
    """
    digests: dict[Path, str] = {}
    groups: dict[tuple[Path, str], list[Path]] = {}
    for run, analysis in analyses.items():
        groups.setdefault((run.parent, analysis.digest), []).append(run)
    for (folder, _), runs in groups.items():
        declaration = declared.declare(folder, analyses[runs[0]], _by_subject(runs, configs), now)
        for run in runs:
            if (stage := declaration.stage_of(run.name)) is not None:
                digests[run] = stage[1]
    return digests


def _by_subject(runs: Sequence[Path], configs: Mapping[Path, Mapping[str, Any]]) -> dict[str, list[str]]:
    """Return the ids of runs by vehicle and task."""
    ids: dict[str, list[str]] = {}
    for run in runs:
        config = configs[run]
        subject = declared.subject(config["vehicle"]["name"], config["task"]["name"])
        ids.setdefault(subject, []).append(run.name)
    return ids
