"""Complete a composed configuration: add the types of what it chose by name, and the keys that name its
packages.

The YAML files of auvbench start from a schema. A package's `algo/NAME.yaml` has only values and comments; its
values are typed here, by the schema of its spec. A package's parts get the key `package` (name and version of
the installed package), and agents the key `learns`. The keys are part of a run's identity: another version is
another run.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from omegaconf import DictConfig, OmegaConf, open_dict

from auvbench.config import algorithms, rewards, schema, simulators, tasks
from auvbench.errors import ConfigError
from auvbench.registry import AGENTS, LAUNCHERS, REWARDS, SIMULATORS, TASKS, Kind
from auvbench.untrusted.text import short

COMPUTE: tuple[Kind[Any], ...] = (AGENTS, TASKS, REWARDS, SIMULATORS)
"""Kinds that are a group of a configuration and change the result of a run."""
CONFIGS = (
    algorithms.AgentConfig,
    tasks.TaskConfig,
    rewards.RewardConfig,
    simulators.SimulatorConfig,
)
"""Configuration classes of packages' parts that change the result of a run."""


def complete(config: DictConfig, *, frozen: bool = False) -> DictConfig:
    """Return a composed configuration with the types and the added keys of installed packages.

    Args:
        config: composed configuration; auvbench's own parts do not change.
        frozen: whether it belongs to an existing run, whose packages must be installed in the recorded
            version.

    Raises:
        ConfigError: a key is unknown or missing, a type is wrong, or the package cannot be used.
        OmegaConfBaseException: the same mistakes, for `compose.translate`.
    """
    # Reading a run does not need the launcher that started it.
    for kind in COMPUTE if frozen else (*COMPUTE, LAUNCHERS):
        key, _, named_by = kind.key.partition(".")
        node = config.get(key)
        chosen = node.get(named_by) if isinstance(node, DictConfig) else None
        if not isinstance(node, DictConfig) or not isinstance(chosen, str):
            continue
        release = str(node.get("package") or "")
        found = kind.find(chosen)
        if (found is None and chosen not in kind.own and release) or (
            found and frozen and release != found.release
        ):
            raise kind.missing(chosen, release)
        if found is None:
            continue
        spec = kind.enter(found)
        added: dict[str, Any] = {"package": found.release}
        if isinstance(spec, algorithms.AgentSpec):
            added["learns"] = spec.learns
        with open_dict(config):
            config[key] = _typed(spec.keys, key, node, added)
    return config


def _typed(kind: type, key: str, node: DictConfig, added: Mapping[str, Any]) -> DictConfig:
    """Return the values of a group with the types of its schema, and the added keys."""
    values: dict[str, Any] = {str(name): value for name, value in OmegaConf.to_container(node).items()}  # type: ignore[union-attr]
    for name, value in added.items():
        if values.get(name) not in (None, value):
            raise ConfigError(f"{key}.{name}={short(values[name])}: auvbench sets it ({value}); leave it out")
    for name, hint in schema.keys(kind).items():  # 1e6 is a whole number
        if hint in (int, int | None) and isinstance(values.get(name), float):
            number = schema.whole(str(values[name]))
            values[name] = values[name] if number is None else number
    root = OmegaConf.create({key: OmegaConf.structured(kind)})
    OmegaConf.set_struct(root, True)
    typed = OmegaConf.select(OmegaConf.merge(root, {key: values | dict(added)}), key)
    assert isinstance(typed, DictConfig)
    return typed


def releases(config: Any) -> dict[str, str]:
    """Return the versions of the packages of a configuration (typed or plain) by name, for a manifest."""
    found = {}
    for kind in COMPUTE:
        group = kind.key.partition(".")[0]
        node = config.get(group) if isinstance(config, Mapping) else getattr(config, group)
        package = node.get("package") if isinstance(node, Mapping) else getattr(node, "package", None)
        if package:
            name, _, version = str(package).partition("==")
            found[name] = version
    return found
