"""A protocol: which scenarios an agent meets, and the fingerprint that tells whether two agents met the same."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from omegaconf import OmegaConf

from auvbench.config import schema
from auvbench.config.compose import typed
from auvbench.envs.batch import Batch, at_frequency
from auvbench.errors import ConfigError
from auvbench.runs.identity import digest_of, without_descriptions


@dataclass(frozen=True, slots=True)
class Circumstance:
    """One condition of a protocol as one run meets it."""

    name: str
    config: schema.TrainConfig
    """the run's configuration with the test's frequency and the condition's overrides"""
    fixed_frequency: bool
    """whether the protocol fixes the frequency, or the run's own is used"""


def circumstances(protocol: schema.Protocol, config: dict[str, Any]) -> list[Circumstance]:
    """The conditions of a protocol for a run's resolved configuration.

    Raises:
        ConfigError: an override names an unknown key or a wrong value.
    """
    return [_circumstance(protocol, condition, config) for condition in protocol.conditions]


def _circumstance(
    protocol: schema.Protocol, condition: schema.Condition, config: dict[str, Any]
) -> Circumstance:
    node = OmegaConf.create(config)
    for override in condition.overrides:
        key, separator, value = override.partition("=")
        if not separator:
            raise ConfigError(f"protocol {protocol.name}, {condition.name}: {override!r} is not key=value")
        OmegaConf.update(node, key, OmegaConf.create(f"value: {value}").value)
    frequency = condition.frequency or protocol.frequency
    result = typed(node)
    if frequency is not None:
        result = at_frequency(result, frequency)
    return Circumstance(condition.name, result, frequency is not None)


def fingerprint(protocol: schema.Protocol, circumstances: list[Circumstance]) -> str:
    """16 hexadecimal digits: equal if and only if two agents met the same scenarios.

    Covers what is drawn (starts, waypoints) and what it is drawn for: task, noise, disturbances, vehicle,
    simulator, and the frequency where the protocol fixes it. Rewards do not enter.
    """
    parts: list[Any] = [protocol.name, protocol.episodes, protocol.seed]
    hasher = hashlib.sha256()
    for circumstance in circumstances:
        config = circumstance.config
        parts.append(
            [
                circumstance.name,
                asdict(config.task),
                asdict(config.noise),
                _plain(config.disturbance),
                without_descriptions(config.vehicle),
                {"name": config.simulator.name, "max_step": config.simulator.max_step},
                config.step.frequency if circumstance.fixed_frequency else None,
            ]
        )
        batch = Batch(config, protocol.episodes, seed=protocol.seed, test=True, autoreset=False)
        batch.task.assign(np.arange(protocol.episodes))
        batch.reset()
        hasher.update(batch.task.F.tobytes())
    hasher.update(digest_of(parts, 64).encode())
    return hasher.hexdigest()[:16]


def _plain(value: Any) -> Any:
    return asdict(value) if hasattr(value, "__dataclass_fields__") else json.loads(json.dumps(value))
