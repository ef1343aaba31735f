"""A run is its configuration: the same configuration is the same directory.

The identity is a readable prefix and a short hash of the resolved configuration without the keys that cannot
change the result.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator, Mapping
from typing import Any

from auvbench.config.agents import learns
from auvbench.config.algorithms import BASES
from auvbench.untrusted.text import short

SCHEMA_VERSION = 1
"""Of the run directory's layout and of the meaning of its configuration; part of every hash."""

OPERATIONAL = (
    "simulator.threads",
    "simulator.namespace",
    "simulator.timeout",
    "train.checkpoint",
    "train.progress",
)
"""Keys that say how a run is carried out. A run that goes on takes them from the latest command."""

NEUTRAL = (
    "name",
    "output",
    "launcher",
    "analysis",
    "algo.path",
    *OPERATIONAL,
    *(f"algo.residual.{base}.{label}" for base in BASES for label in ("name", "n_envs", "tuned")),
)
"""Keys that cannot change a run's result: its place, its launcher, its analysis, how it is carried out, and the labels of
the controller to which a residual learner adds."""

LATER: dict[str, Any] = {
    "task.time_limit": None,
    "task.observation": ["yaw_error", "position_error", "previous_action"],
    "task.history": 1,
    "algo.horizon_s": None,
    "algo.tuned": None,
    "train.evaluate_every": 0,
    "disturbance.waves": {
        "height": 0.0,
        "period": 7.5,
        "spectrum": "jonswap",
        "direction": None,
        "spreading": 2.0,
    },
    **{f"algo.residual.{base}": None for base in BASES},
}
"""Keys that came after runs had been made, with the value under which nothing changes: with it they do not count, so
that a run keeps its id."""

REPLACED = {"task.time_limit": "task.max_steps", "algo.horizon_s": "algo.gamma"}
"""Keys that, where they are set, take the place of another, whose value then changes nothing."""

_DESCRIPTIVE = ("source", "sources", "unit", "title", "remarks", "comment")
"""Entries of a vehicle sheet that describe numbers; a better citation is not another vehicle."""


def is_operational(key: str) -> bool:
    """Return whether a dotted key is in `OPERATIONAL` or below one of its keys.

    >>> is_operational("train.checkpoint.keep"), is_operational("train.total_steps")
    (True, False)
    """
    return any(key == known or key.startswith(f"{known}.") for known in OPERATIONAL)


def relevant(config: Mapping[str, Any]) -> dict[str, Any]:
    """The part of a resolved configuration that determines the result."""
    kept = _without_neutral(config, "")
    if isinstance(kept.get("vehicle"), dict):
        kept["vehicle"] = without_descriptions(kept["vehicle"])
    for key, unchanged in LATER.items():
        *groups, name = key.split(".")
        node: Any = kept
        for group in groups:
            node = node.get(group) if isinstance(node, dict) else None
        if not isinstance(node, dict):
            continue
        if node.get(name, unchanged) == unchanged:
            node.pop(name, None)
        elif key in REPLACED:
            node.pop(REPLACED[key].partition(".")[2], None)
    algo = kept.get("algo")
    if isinstance(algo, dict) and not learns(algo, unknown=True):
        kept.pop("train", None)  # nothing to learn: the budget changes nothing
    return kept


def _without_neutral(node: Mapping[str, Any], prefix: str) -> dict[str, Any]:
    kept: dict[str, Any] = {}
    for key, value in node.items():
        path = f"{prefix}{key}"
        if path in NEUTRAL:
            continue
        kept[str(key)] = _without_neutral(value, f"{path}.") if isinstance(value, Mapping) else value
    return kept


def without_descriptions(node: Any) -> Any:
    """A vehicle sheet without its citations and units: what changes the physics."""
    if isinstance(node, Mapping):
        return {key: without_descriptions(value) for key, value in node.items() if key not in _DESCRIPTIVE}
    if isinstance(node, list):
        return [without_descriptions(value) for value in node]
    return node


def digest(config: Mapping[str, Any]) -> str:
    """Eight hexadecimal digits of the SHA-256 of the relevant configuration."""
    return digest_of({"schema_version": SCHEMA_VERSION, "config": relevant(config)}, 8)


def digest_of(value: Any, digits: int) -> str:
    """The first hexadecimal digits of the SHA-256 of a plain value as canonical JSON."""
    canonical = json.dumps(_numbers(value), sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(canonical.encode()).hexdigest()[:digits]


def _numbers(node: Any) -> Any:
    """Whole floats as integers, so that `1` and `1.0` typed for the same key are the same run."""
    if isinstance(node, dict):
        return {key: _numbers(value) for key, value in node.items()}
    if isinstance(node, list):
        return [_numbers(value) for value in node]
    if isinstance(node, float) and node.is_integer():
        return int(node)
    return node


DEFAULT_VEHICLE = "bluerov2"
"""That of conf/train.yaml when ids were defined: an id names no other vehicle than one that differs from it."""

DEFAULT_TASK = "waypoint"


def run_id(config: Mapping[str, Any]) -> str:
    """`{algorithm}-k{K}-f{frequency}-s{seed}-{hash}`, e.g. ppo-k1-f10-s42-1b2c3d4e, ppo-rexrov-k1-f10-s42-5a6b7c8d.

    Vehicle and task stand behind the algorithm where they are not the default ones.
    """
    vehicle = _vehicle(config)
    return _id(config, f"{config['algo']['name']}{f'-{vehicle}' if vehicle else ''}")


def earlier_id(config: Mapping[str, Any]) -> str:
    """The id that the same run had before ids named vehicles: what such runs are still called."""
    return _id(config, str(config["algo"]["name"]))


def _id(config: Mapping[str, Any], head: str) -> str:
    return (
        f"{head}-k{_short(config['reward']['k'])}-f{_short(config['step']['frequency'])}"
        f"-s{config['seed']}-{digest(config)}"
    )


def _vehicle(config: Mapping[str, Any]) -> str:
    """Vehicle and task as an id has them: '' for the default ones, and nothing that a folder's name cannot hold."""
    found = []
    for group, usual in (("vehicle", DEFAULT_VEHICLE), ("task", DEFAULT_TASK)):
        node = config.get(group)
        name = node.get("name") if isinstance(node, Mapping) else None
        if name not in (None, usual):
            found.append(re.sub(r"[^\w.-]", "_", str(name)))
    return "-".join(found)


def _short(value: float) -> str:
    return f"{float(value):g}"


_SHOWN = ("reward.k", "step.frequency", "seed")
"""The keys whose values an id shows behind algorithm and vehicle, in its order."""

_ID = re.compile(r"(.+)-k(.+)-f(.+)-s(.+)-[0-9a-f]{8}", re.DOTALL)


def mismatch(config: Mapping[str, Any], id: str) -> str:
    """What tells a configuration from that of the run with this id, in words; empty where it is that run's."""
    try:
        found, earlier = run_id(config), earlier_id(config)
    except (ArithmeticError, AttributeError, KeyError, RecursionError, TypeError, ValueError):
        return _defect(config)  # an edited file may hold anything
    if id in (found, earlier):
        return ""
    mine, named = _ID.fullmatch(found), _ID.fullmatch(id)
    if mine is None or named is None:
        return f"its id would be {found}, and the folder's name is none (was the folder renamed?)"
    differing = _heads(str(config["algo"]["name"]), _vehicle(config), named[1])
    for key, there, name in zip(_SHOWN, mine.groups()[1:], named.groups()[1:], strict=True):
        if there != name:
            differing.append(f"{key} is {there} in it and {name} in the folder's name")
    return ", ".join(differing) or "a value that the folder's name does not show was edited"


def _heads(algo: str, vehicle: str, named: str) -> list[str]:
    """How algorithm and vehicle differ from what stands before the K of a folder's name."""
    if named in (
        algo,
        f"{algo}-{vehicle}",
    ):  # the first: the name of the folder is older than vehicles in names
        return []
    if named.startswith(f"{algo}-"):
        there = named.removeprefix(f"{algo}-")
        return [f"vehicle.name is {vehicle or DEFAULT_VEHICLE} in it and {there} in the folder's name"]
    there = named.removesuffix(f"-{vehicle}") if vehicle else named
    return [f"algo.name is {algo} in it and {there} in the folder's name"]


def _defect(config: Mapping[str, Any]) -> str:
    """Why a configuration has no id."""
    for key in ("algo.name", *_SHOWN):
        node: Any = config
        for part in key.split("."):
            if not isinstance(node, Mapping) or part not in node:
                return f"{key} is missing"
            node = node[part]
        if key in ("reward.k", "step.frequency") and not isinstance(node, int | float):
            return f"{key} is {node!r}, which is no number"
    for key, value in _leaves(config, ""):
        try:
            json.dumps(value, allow_nan=False)
        except (TypeError, ValueError):
            return (
                f"{key} is {value}, which no configuration holds (valid: finite numbers, text, true, false)"
            )
    return "it holds what no configuration holds"


def _leaves(node: Any, path: str) -> Iterator[tuple[str, Any]]:
    if isinstance(node, Mapping | list):
        children = node.items() if isinstance(node, Mapping) else enumerate(node)
        for key, value in children:
            yield from _leaves(value, f"{path}.{key}" if path else str(key))
    else:
        yield path, node


def first_interpolation(config: Mapping[str, Any]) -> str:
    """Return the first text that would be resolved, as `key is text`; empty without one."""
    waiting: list[tuple[str, Any]] = [("", config)]
    while waiting:
        path, node = waiting.pop()
        if isinstance(node, Mapping):
            waiting += [(f"{path}.{key}" if path else str(key), child) for key, child in node.items()]
        elif isinstance(node, list):
            waiting += [(f"{path}[{index}]", child) for index, child in enumerate(node)]
        elif isinstance(node, str) and "${" in node:
            return f"{short(path)} is {short(repr(node), 60)}"
    return ""
