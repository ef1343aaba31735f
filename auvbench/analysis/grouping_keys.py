"""Keys that tell agents apart: what varied among runs becomes part of the agent.

Runs of one table met the same test, so the task, noise and disturbances of their configurations only say what they were
trained with. A controller that learns nothing has no use for them: its runs that differ in nothing else are one agent.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from auvbench.analysis.effects import run_learns
from auvbench.analysis.labels import is_fixed
from auvbench.analysis.recorded import has_training
from auvbench.analysis.records import RunRecord
from auvbench.runs.identity import DESCRIPTIVE, NEUTRAL

SEEDS = ("seed", "train.evaluate_every", *NEUTRAL)
"""keys in which the seeds of one agent may differ: they do not change what was to be learned"""

OF_LEARNING = ("train.", "reward.")
"""beginnings of keys that mean nothing to a controller that learns nothing"""


def refined(
    groups: Iterable[Sequence[RunRecord]],
    keys: Mapping[str, str],
    frequency_fixed: bool = True,
) -> dict[str, str]:
    """Return the keys of a grouping, and as many more as tell apart what varied within its groups, by short name.

    A folder of choices counts as one (`disturbance` for all that differs in `disturbance.*`) where its name differs.

    Args:
        groups: the runs that `keys` put together.
        keys: configuration keys by short name.
        frequency_fixed: whether the test has one step frequency for all.
    """
    excused = set(keys.values())
    found = dict(keys)
    parts = [list(group) for group in groups]
    while varying := _varying(parts, excused, frequency_fixed):
        key = min(varying, key=lambda k: (not k.endswith(".name"), -varying[k], k))
        found[key.removesuffix(".name")] = key
        excused.add(key)
        parts = [part for group in parts for part in _split(group, key)]
    return found


def _varying(groups: Iterable[Sequence[RunRecord]], excused: set[str], frequency_fixed: bool) -> Counter[str]:
    """Return in how many of the groups each key varies."""
    found = Counter[str]()
    for group in groups:
        first = group[0].config
        suspects = {
            key
            for run in group[1:]
            for key in first.keys() | run.config.keys()
            if key not in excused and run.config.get(key) != first.get(key)
        }
        for key in suspects:
            values = {str(run.config.get(key)) for run in group if matters(key, run, frequency_fixed)}
            found[key] += len(values) > 1
    return +found


def _split(group: Sequence[RunRecord], key: str) -> list[list[RunRecord]]:
    parts: dict[str, list[RunRecord]] = {}
    for run in group:
        parts.setdefault(str(run.config.get(key)), []).append(run)
    return list(parts.values())


def matters(key: str, run: RunRecord, frequency_fixed: bool = True) -> bool:
    """Return whether a key changes what the run's agent does in the test."""
    if any(key == seed or key.startswith(f"{seed}.") for seed in SEEDS):
        return False
    if not trained(run) and (key.startswith(OF_LEARNING) or is_fixed(key, frequency_fixed)):
        return False
    return not (key.startswith("vehicle.") and key.rpartition(".")[2] in DESCRIPTIVE)


def trained(run: RunRecord) -> bool:
    """Whether the run is a training; a controller has nothing to learn."""
    return run_learns(run) or has_training(run)


def level(value: Any) -> Any:
    """A value of the configuration as a level of a factor: a list (noise.sensor) as its text, to look it up by."""
    return str(value) if isinstance(value, list) else value
