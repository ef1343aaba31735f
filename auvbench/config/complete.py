"""Complete a composed configuration: add types to the values of installed packages, and keys that name the packages.

The YAML files of auvbench start from a schema. A package's file, such as `algo/NAME.yaml`, has only values and comments;
this module gives the values the types in the schema of the package's spec. If a package provides the part that a group
chooses, the group gets the key `package` (name and version of the installed package). The group of an agent also gets the
key `learns`, and a task that observes blocks of packages gets the key `block_packages`. These keys are part of a run's
identity: a run with another version of a package is another run.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from omegaconf import DictConfig, OmegaConf, open_dict
from omegaconf.errors import ConfigKeyError

from auvbench.config import algorithms, navigation, ranges, rewards, schema, simulators, tasks
from auvbench.errors import ConfigError
from auvbench.registry import AGENTS, BLOCKS, DISTURBANCES, LAUNCHERS, REWARDS, SIMULATORS, TASKS, Kind
from auvbench.untrusted.text import short

DISTURBANCE = frozenset(field.name for field in dataclasses.fields(schema.Disturbance))
"""Keys of `disturbance` that every configuration has."""
COMPUTE: tuple[Kind[Any], ...] = (AGENTS, TASKS, REWARDS, SIMULATORS)
"""Kinds of parts that change a run's result; the run's configuration has one group for each of these kinds."""
CONFIGS = (
    algorithms.AgentConfig,
    tasks.TaskConfig,
    rewards.RewardConfig,
    simulators.SimulatorConfig,
)
"""Base classes of the configurations of packages' agents, tasks, rewards and simulators."""


def complete(config: DictConfig, *, frozen: bool = False) -> DictConfig:
    """Add the types and the keys of installed packages to a composed configuration, and return the configuration.

    Args:
        config: composed configuration; groups of auvbench's own parts keep their keys and types.
        frozen: whether the configuration belongs to an existing run, whose packages must be installed in the
            recorded version.

    Raises:
        ConfigError: a key is unknown or missing, a type is wrong, or the package cannot be used.
        OmegaConfBaseException: OmegaConf found one of these mistakes; `compose.translate` turns it into a ConfigError.
    """
    # Reading a run does not need the launcher that started it.
    for kind in COMPUTE if frozen else (*COMPUTE, LAUNCHERS):
        key, _, named_by = kind.key.partition(".")
        node = config.get(key)
        chosen = node.get(named_by) if isinstance(node, DictConfig) else None
        if not isinstance(node, DictConfig) or not isinstance(chosen, str):
            continue
        release = str(node.get("package") or "")
        point = kind.find(chosen)
        if (point is None and chosen not in kind.own and release) or (
            point and frozen and release != point.release
        ):
            raise kind.missing(chosen, release)
        if point is None:
            continue
        spec = kind.enter(point)
        added: dict[str, Any] = {"package": point.release}
        if isinstance(spec, algorithms.AgentSpec):
            added["learns"] = spec.learns
        with open_dict(config):
            config[key] = _typed(spec.keys, key, node, added)
    _complete_blocks(config, frozen)
    _complete_sensors(config)
    _complete_disturbance(config, frozen=frozen)
    return config


def _complete_blocks(config: DictConfig, frozen: bool) -> None:
    """Register the packages' blocks that `task.observation` names; write each package's release to `task.block_packages`.

    Remove the key `task.block_packages` if no package provides a block.

    Raises:
        ConfigError: a block's package is not installed, or the configuration already has other values in `task.block_packages`.
    """
    task = config.get("task")
    if not isinstance(task, DictConfig):
        return
    packages = task.get("block_packages")
    recorded = {str(k): str(v) for k, v in packages.items()} if isinstance(packages, DictConfig) else {}
    chosen: dict[str, str] = {}
    for name in task.get("observation") or ():
        point, release = BLOCKS.find(str(name)), recorded.get(str(name), "")
        if (point is None and release) or (point and frozen and release != point.release):
            raise BLOCKS.missing(str(name), release)
        if point is not None:
            BLOCKS.enter(point)
            chosen[str(name)] = point.release
    _complete_ranges(task)
    if recorded and recorded != chosen:
        raise ConfigError(
            f"task.block_packages={short(recorded)}: auvbench sets it ({short(chosen)}); leave it out"
        )
    with open_dict(task):
        task.pop("block_packages", None)
        if chosen:
            task.block_packages = chosen


def _complete_ranges(task: DictConfig) -> None:
    """Remove the keys of range sensors whose blocks are not in the observation; remove `task.range` if no key remains."""
    own = task.get("range")
    if not isinstance(own, DictConfig):
        with open_dict(task):
            task.pop("range", None)
        return
    observed = {ranges.key_of(str(name)) for name in task.get("observation") or ()}
    with open_dict(own):
        for key in [key for key in own if key not in observed]:
            own.pop(key)
    with open_dict(task):
        if not own:
            task.pop("range")


def _complete_sensors(config: DictConfig) -> None:
    """Remove the keys of navigation sensors that the vehicle does not have."""
    own = config.get("sensors")
    if isinstance(own, DictConfig):
        with open_dict(own):
            for name in [name for name in navigation.SENSORS if name in own and own[name] is None]:
                own.pop(name)


def _complete_disturbance(config: DictConfig, *, frozen: bool) -> None:
    """Give each disturbance that is not in `DISTURBANCE` its types and, if a package provides it, the key `package`.

    Raises:
        ConfigError: the value of a disturbance is not a group of keys, or its package cannot be used.
        ConfigKeyError: a disturbance is unknown.
    """
    node = config.get("disturbance")
    more = [str(name) for name in node if name not in DISTURBANCE] if isinstance(node, DictConfig) else []
    if not isinstance(node, DictConfig) or not more:
        return
    schemas: dict[str, type] = {}
    values: dict[str, Any] = {str(name): value for name, value in OmegaConf.to_container(node).items()}  # type: ignore[union-attr]
    for name in more:
        point, own = DISTURBANCES.find(name), values[name]
        release = str(own.get("package") or "") if isinstance(own, dict) else ""
        if point is None and name not in DISTURBANCES.own:
            raise DISTURBANCES.missing(name, release) if release else _unknown(name, own)
        if point and frozen and release != point.release:
            raise DISTURBANCES.missing(name, release)
        schemas[name] = (DISTURBANCES[name] if point is None else DISTURBANCES.enter(point)).keys
        key = f"disturbance.{name}"
        if not isinstance(own, dict):
            raise ConfigError(f"{key}={short(own)}: must have keys: {', '.join(schema.keys(schemas[name]))}")
        added = {"package": point.release} if point else {}
        values[name] = _values(schemas[name], key, own, added)
    kind = schema.with_disturbances(tuple(schemas.items()))
    with open_dict(config):
        config["disturbance"] = _merged(kind, "disturbance", values)


def _unknown(name: str, own: Any) -> ConfigKeyError:
    """Return the error for an unknown disturbance; `compose.translate` turns the error into a message.

    Args:
        name: key below `disturbance`.
        own: value of the key; if it is a mapping, the error names the first key inside it.
    """
    key = f"disturbance.{name}"
    while isinstance(own, dict) and own:
        last, own = next(iter(own.items()))
        key += f".{last}"
    error = ConfigKeyError(key)
    error.full_key = key
    return error


def _typed(kind: type, key: str, node: DictConfig, added: Mapping[str, Any]) -> DictConfig:
    """Return a group with its values, the added keys and the types of the schema `kind`."""
    values: dict[str, Any] = {str(name): value for name, value in OmegaConf.to_container(node).items()}  # type: ignore[union-attr]
    return _merged(kind, key, _values(kind, key, values, added))


def _values(kind: type, key: str, values: dict[str, Any], added: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of a group with the added keys; a float such as 1e6 becomes an int if the schema asks for an int.

    Raises:
        ConfigError: the group already has another value for an added key.
    """
    for name, value in added.items():
        if values.get(name) not in (None, value):
            raise ConfigError(f"{key}.{name}={short(values[name])}: auvbench sets it ({value}); leave it out")
    for name, hint in schema.keys(kind).items():  # YAML reads 1e6 as a float
        if hint in (int, int | None) and isinstance(values.get(name), float):
            number = schema.whole(str(values[name]))
            values[name] = values[name] if number is None else number
    return values | dict(added)


def _merged(kind: type, key: str, values: dict[str, Any]) -> DictConfig:
    """Return the values as a configuration that has the types of the schema `kind`."""
    root = OmegaConf.create({key: OmegaConf.structured(kind)})
    OmegaConf.set_struct(root, True)
    typed = OmegaConf.select(OmegaConf.merge(root, {key: values}), key)
    assert isinstance(typed, DictConfig)
    return typed


def releases(config: Any) -> dict[str, str]:
    """Return the versions of the packages that a configuration (typed or plain) uses, by package name, for the manifest."""
    versions = {}

    def value(node: Any, key: str) -> Any:
        return node.get(key) if isinstance(node, Mapping) else getattr(node, key, None)

    disturbance = value(config, "disturbance") or {}
    parts = [value(config, kind.key.partition(".")[0]) for kind in COMPUTE]
    parts += (disturbance if isinstance(disturbance, Mapping) else vars(disturbance)).values()
    for node in parts:
        blocks = value(node, "block_packages")
        for release in (value(node, "package"), *(blocks.values() if isinstance(blocks, Mapping) else ())):
            if release:
                name, _, version = str(release).partition("==")
                versions[name] = version
    return versions
