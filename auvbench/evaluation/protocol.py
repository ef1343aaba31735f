"""A protocol: which scenarios an agent meets, and the fingerprint that tells whether two agents met the same."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, is_dataclass, replace
from typing import Any

import numpy as np
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from auvbench.config import schema
from auvbench.config.compose import option, typed
from auvbench.config.simulators import Fossen, Ros2
from auvbench.envs.chosen import at_frequency
from auvbench.errors import ConfigError
from auvbench.evaluation import reference
from auvbench.evaluation.rollout import batch_of
from auvbench.runs.identity import digest_of, without_descriptions
from auvbench.vehicles import sheet


@dataclass(frozen=True, slots=True)
class Circumstance:
    """One condition of a protocol as one run meets it."""

    name: str
    config: schema.TrainConfig
    """of the environments: the run's configuration with the test's frequency and the condition's overrides"""
    fixed_frequency: bool
    """whether the protocol fixes the frequency, or the run's own is used"""


def circumstances(protocol: schema.Protocol, config: dict[str, Any]) -> list[Circumstance]:
    """The conditions of a protocol for a run's resolved configuration.

    Task, noise and disturbance are the protocol's, whatever the run was trained with.

    Conditions on a vehicle with other actuators than the run's are left out: its policy cannot act there.

    Raises:
        ConfigError: an override names an unknown key or a wrong value.
    """
    actuators = sheet.load(config["vehicle"]).actuators
    found = []
    for condition in protocol.conditions:
        circumstance = _circumstance(protocol, condition, config)
        vehicle = circumstance.config.vehicle
        if vehicle == config["vehicle"] or sheet.load(vehicle).actuators == actuators:
            found.append(circumstance)
    return found


def _circumstance(
    protocol: schema.Protocol, condition: schema.Condition, config: dict[str, Any]
) -> Circumstance:
    node = OmegaConf.create(config)
    for override in [*protocol.overrides, *condition.overrides]:
        key, separator, value = override.partition("=")
        where = f"protocol {protocol.name}, condition {condition.name}"
        if not separator:
            raise ConfigError(f"{where}: {override!r} is not key=value")
        _apply(node, key, value, where)
    # How the observation is written down is the agent's affair, not the scenario's.
    node.task.position_frame = config["task"]["position_frame"]
    frequency = condition.frequency or protocol.frequency
    result = typed(node)
    if frequency is not None:
        result = at_frequency(result, frequency)
    return Circumstance(condition.name, result, frequency is not None)


def _apply(node: DictConfig, key: str, value: str, where: str) -> None:
    """`group=option` puts the option's whole configuration in place, `key=value` one value."""
    if "." not in key and isinstance(node.get(key), DictConfig):
        node[key] = option(key, value)
        return
    try:
        if OmegaConf.select(node, key, throw_on_missing=True) is None and not _has(node, key):
            raise ConfigError(f"{where}: {key}: unknown key")
        OmegaConf.update(node, key, OmegaConf.create(f"value: {value}").value)
    except OmegaConfBaseException as error:
        raise ConfigError(f"{where}: {key}={value}: {str(error).splitlines()[0]}") from error


def _has(node: DictConfig, key: str) -> bool:
    parent, _, last = key.rpartition(".")
    holder = OmegaConf.select(node, parent) if parent else node
    return isinstance(holder, DictConfig) and last in holder


def fingerprint(protocol: schema.Protocol, circumstances: list[Circumstance]) -> str:
    """16 hexadecimal digits: equal if and only if two agents met the same scenarios, played by the same physics.

    Covers what is drawn (starts, waypoints) and what it is drawn for: task, noise, disturbances, vehicle,
    simulator, and the frequency where the protocol fixes it; and what the code makes of it (`reference`). Rewards
    and names do not enter: the first 200 episodes of `test` are the 200 of `thesis`, but 500 and 200 episodes are
    not the same test.
    """
    parts = fingerprint_parts(protocol, circumstances)
    return digest_of({name: parts[name] for name in ("scenarios", "outcomes")}, 16)


def fingerprint_parts(protocol: schema.Protocol, circumstances: list[Circumstance]) -> dict[str, str]:
    """Return what the fingerprint is made of, 16 digits each: the scenarios, and their outcomes by today's code.

    `ends`, how episodes end, is compared before an evaluation is reused. It is no part of the fingerprint itself, which
    published results have without it.
    """
    played = [_reference(c) for c in circumstances]
    return {
        "scenarios": digest_of([_condition_fingerprint(protocol, c) for c in circumstances], 16),
        "outcomes": digest_of([outcomes for outcomes, _ in played], 16),
        "ends": digest_of([ends for _, ends in played], 16),
    }


def _reference(circumstance: Circumstance) -> tuple[str, str]:
    """Return both digests of what is played in this condition; conditions and runs that play the same share them."""
    config = circumstance.config
    frequency = config.step.frequency if circumstance.fixed_frequency else None
    key = digest_of(
        {
            "task": _task(config.task),
            "noise": asdict(config.noise),
            "disturbance": _plain(config.disturbance),
            "vehicle": without_descriptions(config.vehicle),
            "simulator": asdict(config.simulator),
            "frequency": frequency,
        },
        64,
    )
    if key not in _played:
        _played[key] = reference.digest(config, frequency), reference.ends(config, frequency)
    return _played[key]


_WHERE = ("threads", "namespace", "timeout")
"""Of a simulator's configuration: where and how it runs, which changes no row."""


def as_played(conditions: list[Circumstance], clocks: Mapping[str, str]) -> list[Circumstance]:
    """The conditions with the clock that each was played by, where the configuration left it to the server.

    Args:
        conditions: of a test.
        clocks: by condition, for those that went over ROS 2.
    """
    return [
        replace(c, config=replace(c.config, simulator=replace(c.config.simulator, clock=clocks[c.name])))
        if c.name in clocks and isinstance(c.config.simulator, Ros2)
        else c
        for c in conditions
    ]


def _condition_fingerprint(protocol: schema.Protocol, circumstance: Circumstance) -> str:
    config = circumstance.config
    meant = {
        "episodes": protocol.episodes,
        "seed": protocol.seed,
        "condition": circumstance.name,
        "task": _task(config.task),
        "noise": asdict(config.noise),
        "disturbance": _plain(config.disturbance),
        "vehicle": without_descriptions(config.vehicle),
        "simulator": {key: value for key, value in asdict(config.simulator).items() if key not in _WHERE},
        "frequency": config.step.frequency if circumstance.fixed_frequency else None,
    }
    if protocol.scenarios != "test":
        meant["scenarios"] = protocol.scenarios
    key = digest_of(meant, 64)
    if key not in _drawn:
        # What is drawn does not depend on who integrates, and the embedded simulator is there at once.
        drawn = replace(config, simulator=Fossen(name="fossen", max_step=0.01, threads=1))
        batch = batch_of(protocol.scenarios, drawn, protocol.episodes, protocol.seed)
        batch.task.assign(np.arange(protocol.episodes))
        batch.reset()
        # Rounded to a nanometre: another machine may have another last bit.
        scenarios = np.round(batch.task.F, 9) + 0.0
        _drawn[key] = hashlib.sha256(key.encode() + scenarios.tobytes()).hexdigest()
    return _drawn[key]


def _task(task: schema.Task) -> dict[str, Any]:
    """What of the task makes a scenario; a limit in seconds only where there is one, as before there could be."""
    left_out = {"position_frame"} | ({"time_limit"} if task.time_limit is None else {"max_steps"})
    return {key: value for key, value in asdict(task).items() if key not in left_out}


# A thousand runs of one grid meet the same scenarios: they are drawn once.
_drawn: dict[str, str] = {}
_played: dict[str, tuple[str, str]] = {}


def _plain(value: Any) -> Any:
    if is_dataclass(value) and not isinstance(value, type):
        return asdict(value)
    return json.loads(json.dumps(value))
