"""Compute the identity of a run from its configuration: runs with the same configuration have the same directory.

The identity is a readable prefix and a short hash of the resolved configuration, without the keys that cannot
change the result.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from typing import Any

from auvbench.config.algorithms import learns
from auvbench.config.algorithms.residual import BASES
from auvbench.untrusted.text import short

SCHEMA_VERSION = 1
"""Version of the run directory's layout and of the configuration's meaning; part of every hash."""

OPERATIONAL = (
    "simulator.threads",
    "simulator.namespace",
    "simulator.timeout",
    "train.checkpoint",
    "train.progress",
    "train.log",
)
"""Keys that affect only how a run is executed. A resumed run takes their values from the latest command."""

NEUTRAL = (
    "name",
    "output",
    "launcher",
    "analysis",
    "algo.path",
    "world.bottom.file",
    *OPERATIONAL,
    *(f"algo.residual.{base}.{label}" for base in BASES for label in ("name", "n_envs", "tuned")),
)
"""Keys that cannot change a run's result: the run's folder, launcher and analysis, the `OPERATIONAL` keys, paths of files
whose digest is in the configuration, and labels of a residual learner's controller.
"""

LATER: dict[str, Any] = {
    "task.time_limit": None,
    "task.observation": ["yaw_error", "position_error", "previous_action"],
    "task.block_packages": {},
    "task.history": 1,
    "task.range": None,
    "task.tilt": None,
    "algo.horizon_s": None,
    "algo.tuned": None,
    "algo.tuned.cpu_s": None,
    "algo.n_steps": 1,
    "algo.updates": "sb3",
    **{
        f"{prefix}.{name}": value
        for prefix in ("algo", "algo.residual.mppi")
        for name, value in (("clearance", 0.5), ("clearance_weight", 20.0), ("contact_weight", 100.0))
    },
    "reward.fine": 0.0,
    "reward.fine_length": 1.0,
    "train.evaluate_every": 0,
    "disturbance.waves": {
        "height": 0.0,
        "period": 7.5,
        "spectrum": "jonswap",
        "direction": None,
        "spreading": 2.0,
    },
    "algo.heading_integral_time": None,
    "world": {"name": "open"},
    "world.moving": 0.0,
    "world.speed": 0.2,
    "world.bottom_depth": None,
    "sensors.usbl.vehicles": 8,
    "sensors.dvl.water_track": False,
    "sensors.dvl.water_rate": 2.0,
    "sensors.dvl.water_noise": 1.5,
    "sensors.dvl.water_near": 1.5,
    "sensors.dvl.water_far": 4.5,
    "sensors.heading.thrusters": 0.0,
    "sensors": {"name": "none"},
    "navigation.dvl_scale": False,
    "navigation.heading_bias": False,
    "navigation": {"name": "truth"},
    "filter": {"name": "none"},
    "filter.tilt": None,
    **{f"algo.residual.{base}": None for base in BASES},
    **{f"algo.residual.{base}.heading_integral_time": None for base in ("pid", "alos")},
}
"""Keys that later versions added, each with the value that keeps the behaviour of earlier versions. A key with this value
is left out of the hash, so that older runs keep their ids.
"""

REPLACED = {"task.time_limit": "task.max_steps", "algo.horizon_s": "algo.gamma"}
"""Keys that, when set, replace another key; the value of the replaced key is left out of the hash."""

DESCRIPTIVE = ("source", "sources", "unit", "title", "remarks", "comment")
"""Entries of a vehicle sheet that only describe the sheet's numbers; for example, another citation does not change the vehicle."""


def relevant(config: Mapping[str, Any]) -> dict[str, Any]:
    """Return the part of a resolved configuration that determines the result."""
    values = _without_neutral(config, "")
    if isinstance(values.get("vehicle"), dict):
        values["vehicle"] = without_descriptions(values["vehicle"])
    for key, unchanged in LATER.items():
        *groups, name = key.split(".")
        node: Any = values
        for group in groups:
            node = node.get(group) if isinstance(node, dict) else None
        if not isinstance(node, dict):
            continue
        if node.get(name, unchanged) == unchanged:
            node.pop(name, None)
        elif key in REPLACED:
            node.pop(REPLACED[key].partition(".")[2], None)
    algo = values.get("algo")
    if isinstance(algo, dict) and not learns(algo, unknown=True):
        values.pop("train", None)  # An agent that does not learn ignores the training budget.
    return values


def _without_neutral(node: Mapping[str, Any], prefix: str) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for key, value in node.items():
        path = f"{prefix}{key}"
        if path in NEUTRAL:
            continue
        values[str(key)] = _without_neutral(value, f"{path}.") if isinstance(value, Mapping) else value
    return values


def without_descriptions(node: Any) -> Any:
    """Return a vehicle sheet without its citations and units: only what changes the physics."""
    if isinstance(node, Mapping):
        return {key: without_descriptions(value) for key, value in node.items() if key not in DESCRIPTIVE}
    if isinstance(node, list):
        return [without_descriptions(value) for value in node]
    return node


def digest(config: Mapping[str, Any]) -> str:
    """Return eight hexadecimal digits of the SHA-256 of the relevant configuration."""
    return digest_of({"schema_version": SCHEMA_VERSION, "config": relevant(config)}, 8)


def digest_of(value: Any, digits: int) -> str:
    """Return the first `digits` hexadecimal digits of the SHA-256 of a plain value's canonical JSON."""
    canonical = json.dumps(_numbers(value), sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(canonical.encode()).hexdigest()[:digits]


def _numbers(node: Any) -> Any:
    """Convert whole floats to integers, so that the values `1` and `1.0` of a key give the same run id."""
    if isinstance(node, dict):
        return {key: _numbers(value) for key, value in node.items()}
    if isinstance(node, list):
        return [_numbers(value) for value in node]
    if isinstance(node, float) and node.is_integer():
        return int(node)
    return node


DEFAULT_VEHICLE = "bluerov2"
"""Vehicle whose name is not part of run ids: the default of conf/train.yaml when run ids were introduced"""

DEFAULT_TASK = "waypoint"


def run_id(config: Mapping[str, Any]) -> str:
    """Return the id `{algorithm}-k{K}-f{frequency}-s{seed}-{hash}`, for example ppo-k1-f10-s42-1b2c3d4e.

    If the vehicle or the task is not the default one, its name follows the algorithm: ppo-rexrov-k1-f10-s42-5a6b7c8d.
    """
    head = "-".join([str(config["algo"]["name"]), *_names(config)])
    k, frequency = (f"{float(value):g}" for value in (config["reward"]["k"], config["step"]["frequency"]))
    return f"{head}-k{k}-f{frequency}-s{config['seed']}-{digest(config)}"


def _names(config: Mapping[str, Any]) -> list[str]:
    """Return the names of vehicle and task that an id contains: only names other than the defaults, in plain characters."""
    names = []
    for group, usual in (("vehicle", DEFAULT_VEHICLE), ("task", DEFAULT_TASK)):
        node = config.get(group)
        name = node.get("name") if isinstance(node, Mapping) else None
        if name not in (None, usual):
            names.append(re.sub(r"[^\w.-]", "_", str(name)))
    return names


def mismatch(config: Mapping[str, Any], id: str) -> str:
    """Return why a configuration does not belong to the run with this id; '' if it belongs to the run."""
    try:
        actual = run_id(config)
    except (ArithmeticError, AttributeError, KeyError, RecursionError, TypeError, ValueError) as error:
        # An edited file may contain anything.
        return f"it has no id ({short(f'{type(error).__name__}: {error}')})"
    return "" if actual == id else f"its id is {short(actual)}"


def first_interpolation(config: Mapping[str, Any]) -> str:
    """Return the first value with an interpolation `${...}` in a configuration, as `KEY is VALUE`; '' without an interpolation."""
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
