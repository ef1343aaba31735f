"""Resolve the conditions of a protocol for a run, and compute the fingerprint of their scenarios."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

import numpy as np
from omegaconf import DictConfig, OmegaConf, open_dict
from omegaconf.errors import OmegaConfBaseException

from auvbench.config import complete, schema
from auvbench.config.compose import once_for_all_seeds, option, typed, with_groups
from auvbench.config.filters import unfiltered
from auvbench.config.navigation import NONE, truth
from auvbench.config.simulators import is_served
from auvbench.config.worlds import open_water
from auvbench.envs.simulator_factory import at_frequency
from auvbench.errors import ConfigError, VehicleError
from auvbench.evaluation import reference, sealed
from auvbench.evaluation.rollout import batch_of, embedded
from auvbench.registry import DISTURBANCES, TASKS
from auvbench.runs.identity import digest_of, relevant, without_descriptions
from auvbench.vehicles import sheet
from auvbench.vehicles.vehicle_model import VehicleModel

OBSERVED = ("position_frame", "observation", "block_packages", "history", "preview")
"""task keys that belong to the agent, not to the scenario"""
KEPT = (*OBSERVED, "vehicles")
"""task keys that a test takes from the run: the agent's keys, and the size of a team, on which the observation depends"""
SENSORS = "task.range."
"""prefix of the keys of range sensors. A test takes these keys from the run, but a protocol may change them so that a sensor fails"""
WITHIN = {"noise", "disturbance"}
"""groups that a condition may change without resolving the other groups again"""


@dataclass(frozen=True, slots=True)
class ResolvedCondition:
    """A condition of a protocol for one run."""

    name: str
    config: schema.TrainConfig
    """configuration of the environments: the run's configuration with the overrides of protocol and condition, and
    with the step frequency of the test
    """
    fixed_frequency: bool
    """whether the protocol fixes the step frequency; otherwise the test uses the run's frequency"""


def resolve_conditions(protocol: schema.Protocol, config: dict[str, Any]) -> list[ResolvedCondition]:
    """Return the conditions of a protocol for a run's resolved configuration.

    Task, noise and disturbance come from the protocol, not from the run's training. A condition is left out if
    the policy cannot control its vehicle: the vehicle has other actuators than the run's vehicle, or actuators
    of the same name that act in opposite directions. A sealed protocol also leaves out conditions with an error.

    Raises:
        ConfigError: an override names an unknown key or a wrong value, or the protocol does not fit the run's task.
    """
    return once_for_all_seeds(
        repr(protocol),
        config,
        lambda: _resolved(protocol, config),
        lambda conditions, own: [
            replace(condition, config=replace(condition.config, **own)) for condition in conditions
        ],
    )


def _resolved(protocol: schema.Protocol, config: dict[str, Any]) -> list[ResolvedCondition]:
    trained = sheet.load(config["vehicle"])
    # Load the packages of the run's options, before the options are resolved.
    complete.complete(OmegaConf.create(config), frozen=True)
    if isinstance(protocol, sealed.Protocol):
        protocol.refuse_task(str(config["task"]["name"]))
    base = _resolve(protocol, (), config, f"protocol {protocol.name}")
    configs = []
    for condition in protocol.conditions:
        where = f"protocol {protocol.name}, condition {condition.name}"
        if isinstance(condition, sealed.Condition):
            try:
                resolved = _changed(protocol, condition, config, where)
            except (ConfigError, VehicleError):
                continue  # `left_out` gives the reason
        elif _groups(condition) <= WITHIN:
            resolved = _with_disturbance(base, condition, where)
        else:
            resolved = _resolve(protocol, condition.overrides, config, where)
        frequency = condition.frequency or protocol.frequency
        if frequency is not None:
            resolved = at_frequency(resolved, frequency)
            _check_length(resolved, where)
        if resolved.vehicle == config["vehicle"] or _wired_alike(trained, sheet.load(resolved.vehicle)):
            configs.append(ResolvedCondition(condition.name, resolved, frequency is not None))
    return configs


def _changed(
    protocol: schema.Protocol, condition: sealed.Condition, config: dict[str, Any], where: str
) -> schema.TrainConfig:
    """Return a run's configuration for a condition that may change the vehicle."""
    vehicle = condition.vehicle(config["vehicle"])
    return typed(_composed(protocol, condition.overrides, {**config, "vehicle": vehicle}, where))


def left_out(
    protocol: sealed.Protocol, conditions: Sequence[ResolvedCondition], config: dict[str, Any]
) -> list[str]:
    """Return a line for each condition of a sealed protocol in which a run cannot be tested, with the reason."""
    met = {condition.name for condition in conditions}
    lines = []
    for condition in protocol.conditions:
        if condition.name in met or not isinstance(condition, sealed.Condition):
            continue
        reason = "its actuators differ from the actuators of the run's vehicle"
        try:
            _changed(protocol, condition, config, condition.name)
        except (ConfigError, VehicleError) as error:
            reason = str(error)
        lines.append(f"condition {condition.name}: {reason}")
    return lines


def _check_length(config: schema.TrainConfig, where: str) -> None:
    """Check the length of episodes at the frequency of the protocol."""
    try:
        config.task.check_length(config.step.frequency)
    except ConfigError as error:
        raise ConfigError(f"{where}: {error}") from None


def _wired_alike(first: VehicleModel, second: VehicleModel) -> bool:
    """Return whether two vehicles have the same actuators, and each actuator acts in the same direction on both vehicles."""
    if first.actuators != second.actuators:
        return False
    forces, moments = (first.allocation * second.allocation).reshape(2, 3, -1).sum(axis=1)
    return bool((forces >= 0.0).all() and (moments >= 0.0).all())


def _groups(condition: schema.Condition) -> set[str]:
    return {re.split(r"[.=]", override)[0] for override in condition.overrides}


def _with_disturbance(
    base: schema.TrainConfig, condition: schema.Condition, where: str
) -> schema.TrainConfig:
    """Return the configuration `base` of a protocol with a condition's noise and disturbances."""
    node = OmegaConf.create({group: asdict(getattr(base, group)) for group in _groups(condition)})
    for override in condition.overrides:
        _set(node, override, where)
    values: dict[str, Any] = OmegaConf.to_container(node, resolve=True)  # type: ignore[assignment]
    return with_groups(base, values)


def _composed(
    protocol: schema.Protocol, overrides: Sequence[str], config: dict[str, Any], where: str
) -> DictConfig:
    """Apply the overrides of a protocol, then `overrides`, to a run's configuration, without checking the types of values."""
    usual = {"world": asdict(open_water()), "navigation": asdict(truth()), "sensors": {"name": NONE}}
    node = OmegaConf.create({**usual, "filter": asdict(unfiltered()), **config})
    for override in [*protocol.overrides, *overrides]:
        _set(node, override, where)
        if override.startswith("task="):
            _give_sensors(node, config["task"].get("range"))
    # The observation belongs to the agent, not to the scenario.
    for key in KEPT:
        if key in config["task"] and (key in node.task or key == "block_packages"):
            OmegaConf.update(node, f"task.{key}", config["task"][key], force_add=True)
    return node


def _resolve(
    protocol: schema.Protocol, overrides: Sequence[str], config: dict[str, Any], where: str
) -> schema.TrainConfig:
    """Apply the overrides of a protocol, then `overrides`, to a run's configuration, and check the types of values."""
    node = _composed(protocol, overrides, config, where)
    try:
        return typed(node)
    except ConfigError as error:
        if node.task.name == config["task"]["name"]:
            own = "protocol=own tests a run in its own task, noise and disturbances"
            raise ConfigError(f"{where}: {error}; {own}") from error
        raise ConfigError(
            f"{where}: tests task={node.task.name}, but the run has task={config['task']['name']}: {error}"
        ) from error


def _give_sensors(node: DictConfig, own: Any) -> None:
    """Replace a task's range sensors by the run's range sensors `own`; remove them if the run has none."""
    with open_dict(node.task):
        node.task.pop("range", None)
        if own:
            node.task.range = own


def _set(node: DictConfig, override: str, where: str) -> None:
    key, separator, value = override.partition("=")
    if not separator:
        raise ConfigError(f"{where}: {override!r} is not key=value")
    # task=same means the run's task with the values in the task's file, instead of the values of the run's training.
    value = str(node.task.name) if (key, value) == ("task", "same") else value
    if not _of_other_tasks(node, key):
        _apply(node, key, value, where)


def _apply(node: DictConfig, key: str, value: str, where: str) -> None:
    """Set a group to an option, or a key to a value."""
    if "." not in key and isinstance(node.get(key), DictConfig):
        node[key] = option(key, value)
        return
    try:
        if OmegaConf.select(node, key, throw_on_missing=True) is None and not _has(node, key):
            raise ConfigError(f"{where}: {key}: unknown key")
        OmegaConf.update(node, key, OmegaConf.create(f"value: {value}").value)
    except OmegaConfBaseException as error:
        raise ConfigError(f"{where}: {key}={value}: {str(error).splitlines()[0]}") from error


def _of_other_tasks(node: DictConfig, key: str) -> bool:
    """Return whether an override has no effect on this run, because only other tasks or agents have its key.

    `task.station` only applies to the station-keeping task, and `task.range.ping1d.dropout` only to agents that
    observe this sensor.
    """
    sensor = ".".join(key.split(".")[:3])
    if key.startswith(SENSORS) and sensor != key:
        return OmegaConf.select(node, sensor) is None
    group, _, name = key.partition(".")
    return (
        group == "task"
        and name not in node.task
        and any(name == field.name for task in TASKS.own for field in fields(TASKS[task].keys))
    )


def _has(node: DictConfig, key: str) -> bool:
    parent, _, last = key.rpartition(".")
    holder = OmegaConf.select(node, parent) if parent else node
    return isinstance(holder, DictConfig) and last in holder


def fingerprint(protocol: schema.Protocol, conditions: list[ResolvedCondition]) -> str:
    """Return 16 hexadecimal digits that are equal for two agents if and only if their scenarios and physics are equal.

    The digest covers the drawn values (starts, waypoints), the configuration from which they are drawn (task,
    noise, disturbances, vehicle, simulator, a fixed frequency), and outcomes of the present code (`reference`). It
    does not cover rewards and names. The 200 episodes of `thesis` are the first 200 of `test`, but the two
    fingerprints differ, because the numbers of episodes differ.
    """
    return digest_of(fingerprint_parts(protocol, conditions), 16)


def fingerprint_parts(protocol: schema.Protocol, conditions: list[ResolvedCondition]) -> dict[str, str]:
    """Return two parts of a fingerprint, 16 digits each: `scenarios`, and the scenarios' `outcomes` with the present code."""
    return {
        "scenarios": digest_of([_drawn(protocol, c) for c in conditions], 16),
        "outcomes": digest_of([_played(c) for c in conditions], 16),
    }


def as_played(conditions: list[ResolvedCondition], clocks: Mapping[str, str]) -> list[ResolvedCondition]:
    """Return the conditions; in a condition of a served simulator, replace the clock by the clock of its test.

    `clocks` maps the name of a condition to the clock by which a server counted the condition's steps.
    """
    return [
        replace(c, config=replace(c.config, simulator=replace(c.config.simulator, clock=clocks[c.name])))
        if c.name in clocks and is_served(c.config.simulator)
        else c
        for c in conditions
    ]


_NO_ROWS = ("threads", "namespace", "timeout")
"""keys of a simulator that only affect where and how it runs, and never change a row"""

# Cached digests of drawn scenarios and of reference plays: the runs of a grid have the same scenarios.
_draws: dict[str, str] = {}
_plays: dict[str, str] = {}


def _physics(condition: ResolvedCondition) -> dict[str, Any]:
    """Return all values that a scenario is drawn from and simulated with."""
    config = condition.config
    # The fingerprint contains the time limit in seconds only if it is set, so that older fingerprints stay valid.
    limit = "time_limit" if config.task.time_limit is None else "max_steps"
    # For the same reason, leave out an unset largest tilt, and inactive disturbances that were added later.
    factors = config.disturbance.factors()
    calm = [name for name, factor in factors if DISTURBANCES[name].added and not factor.active]
    level = ("tilt",) if getattr(config.task, "tilt", None) is None else ()
    task = {
        key: value
        for key, value in asdict(config.task).items()
        if key not in (*OBSERVED, "range", limit, *level)
    }
    return {
        "task": task,
        "noise": asdict(config.noise),
        "disturbance": {key: value for key, value in asdict(config.disturbance).items() if key not in calm},
        "vehicle": without_descriptions(config.vehicle),
        "simulator": {key: value for key, value in asdict(config.simulator).items() if key not in _NO_ROWS},
        "frequency": config.step.frequency if condition.fixed_frequency else None,
        # As in a run's identity, leave out keys that were added later, if their values have no effect.
        **(relevant({"world": asdict(config.world)}) if config.world.solid else {}),
    }


def _played(condition: ResolvedCondition) -> str:
    """Return the digest of a condition's reference play (`reference`)."""
    key = digest_of(_physics(condition), 64)
    if key not in _plays:
        frequency = condition.config.step.frequency if condition.fixed_frequency else None
        _plays[key] = reference.digest(condition.config, frequency)
    return _plays[key]


def _drawn(protocol: schema.Protocol, condition: ResolvedCondition) -> str:
    """Return a digest of the drawn scenarios."""
    content = {
        "episodes": protocol.episodes,
        "seed": protocol.seed,
        "condition": condition.name,
        **_physics(condition),
    }
    changed = [
        *protocol.overrides,
        *(o for c in protocol.conditions if c.name == condition.name for o in c.overrides),
    ]
    if sensors := [override for override in changed if override.startswith(SENSORS)]:
        content["sensors"] = sensors
    if protocol.scenarios != "test":
        content["scenarios"] = protocol.scenarios
    key = digest_of(content, 64)
    if key not in _draws:
        # Draws do not depend on the simulator.
        drawn, episodes = embedded(condition.config), np.arange(protocol.episodes)
        batch = batch_of(protocol.scenarios, drawn, episodes, protocol.seed)
        batch.reset()
        # Round the values to 1e-9 (a nanometre), because their last bits may differ between machines.
        scenarios = np.round(batch.task.scenario(), 9) + 0.0
        _draws[key] = hashlib.sha256(key.encode() + scenarios.tobytes()).hexdigest()
    return _draws[key]
