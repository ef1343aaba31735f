"""What varied among runs becomes part of the agent: runs that were trained differently are no seeds of one another."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from auvbench.analysis.effects import run_learns
from auvbench.analysis.model import RunRecord
from auvbench.analysis.training import has_training
from auvbench.runs.identity import NEUTRAL

SEEDS = ("seed", "train.evaluate_every", *NEUTRAL)
"""keys in which the seeds of one agent may differ: they do not change what was to be learned"""

DESCRIPTIVE = ("source", "sources", "unit", "title", "remarks", "comment")
"""last parts of the keys of a vehicle sheet that only describe its numbers"""

OF_LEARNING = ("train.", "reward.", "noise.", "disturbance.")
"""beginnings of keys that mean nothing to a controller that learns nothing: a protocol brings its own of these"""


def refined(
    groups: Iterable[Sequence[RunRecord]], keys: Mapping[str, str], pooled: Iterable[str] = ()
) -> dict[str, str]:
    """The keys of a grouping, by their short names, and as many more as tell apart what varied within its groups.

    A folder of choices counts as one (`disturbance` for all that differs in `disturbance.*`) where its name differs.

    Args:
        groups: the runs that `keys` put together.
        keys: configuration keys by short name.
        pooled: keys that may differ because pooling over them was asked for.
    """
    excused = {*keys.values(), *pooled}
    found = dict(keys)
    parts = [list(group) for group in groups]
    while varying := _varying(parts, excused):
        key = min(varying, key=lambda k: (not k.endswith(".name"), -varying[k], k))
        found[key.removesuffix(".name")] = key
        excused.add(key)
        parts = [part for group in parts for part in _split(group, key)]
    return found


def differing(group: Sequence[RunRecord], excused: Iterable[str] = ()) -> dict[str, list[str]]:
    """Values by key of everything in which runs of a group differ and that changes what is learned."""
    if len(group) < 2:
        return {}
    first, excused = group[0].config, set(excused)
    suspects = {
        key
        for run in group[1:]
        for key in first.keys() | run.config.keys()
        if key not in excused and run.config.get(key) != first.get(key)
    }
    found = {}
    for key in sorted(suspects):
        values = {str(run.config.get(key)) for run in group if _matters(key, run)}
        if len(values) > 1:
            found[key] = sorted(values)
    return found


def _varying(groups: Iterable[Sequence[RunRecord]], excused: set[str]) -> dict[str, int]:
    """In how many of the groups each key varies."""
    found: dict[str, int] = {}
    for group in groups:
        for key in differing(group, excused):
            found[key] = found.get(key, 0) + 1
    return found


def _split(group: Sequence[RunRecord], key: str) -> list[list[RunRecord]]:
    parts: dict[str, list[RunRecord]] = {}
    for run in group:
        parts.setdefault(str(run.config.get(key)), []).append(run)
    return list(parts.values())


def _matters(key: str, run: RunRecord) -> bool:
    if any(key == seed or key.startswith(f"{seed}.") for seed in SEEDS):
        return False
    if key.startswith(OF_LEARNING) and not trained(run):
        return False
    return not (key.startswith("vehicle.") and key.rpartition(".")[2] in DESCRIPTIVE)


def trained(run: RunRecord) -> bool:
    """Whether the run is a training; a controller has nothing to learn."""
    return run_learns(run) or has_training(run)


def level(value: Any) -> Any:
    """A value of the configuration as a level of a factor: a list (noise.sensor) as its text, to look it up by."""
    return str(value) if isinstance(value, list) else value
