"""The configuration of agents and simulators that installed packages bring: their schemas, and the keys added to them.

A package's `algo/NAME.yaml` holds its values and the comments that explain them; the class behind its entry point holds
their types and ranges as `Config`, a dataclass below `AgentConfig` (`SimulatorConfig`). Two keys are written when a
configuration is composed, and are not typed: `package`, name and version of what was installed then, and `learns`.
So they are part of a run's configuration and of its identity: another version is another run.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from omegaconf import DictConfig, OmegaConf, open_dict
from omegaconf.errors import OmegaConfBaseException

from auvbench.config import plugins
from auvbench.config.agents import AGENTS
from auvbench.config.algorithms import Tuned
from auvbench.config.overrides import whole
from auvbench.config.schema import name as path_name
from auvbench.config.schema import number
from auvbench.config.simulators import CAPABILITIES, Capabilities, InstalledSimulator
from auvbench.errors import ConfigError
from auvbench.untrusted.text import short


@dataclass(kw_only=True)
class AgentConfig:
    """What the `algo` configuration of an agent of an installed package has; keys of its own come in a subclass."""

    name: str = path_name()
    agent: str = path_name()
    n_envs: int = number(1, 65_536)
    package: str
    learns: bool
    tuned: Tuned | None = None  # where its values were searched for


SimulatorConfig = InstalledSimulator


@dataclass(frozen=True, slots=True)
class Group:
    """A question of the configuration that installed packages may answer."""

    key: str  # of the configuration
    named_by: str  # the key below it that names the entry point
    points: str  # the group of entry points
    own: Iterable[str]  # names that auvbench has itself
    base: type  # of the schemas


GROUPS = (
    Group("algo", "agent", plugins.AGENTS, AGENTS, AgentConfig),
    Group("simulator", "name", plugins.SIMULATORS, CAPABILITIES, SimulatorConfig),
)


def complete(config: DictConfig, *, frozen: bool = False) -> DictConfig:
    """A composed configuration with types, and with the added keys, for what installed packages bring.

    Args:
        config: composed; groups that auvbench has itself are left as they are.
        frozen: it is that of a run: the package must be installed in the version that it names.

    Raises:
        ConfigError: a key is unknown or missing, a type is wrong, or the package cannot be used.
        OmegaConfBaseException: as above, for `compose.translate`.
    """
    for group in GROUPS:
        node = config.get(group.key)
        chosen = node.get(group.named_by) if isinstance(node, DictConfig) else None
        if isinstance(chosen, str) and isinstance(node, DictConfig):
            typed = _completed(group, chosen, node, frozen)
            if typed is not None:
                with open_dict(config):
                    config[group.key] = typed
    return config


def _completed(group: Group, chosen: str, node: DictConfig, frozen: bool) -> DictConfig | None:
    release = str(node.get("package") or "")
    found = plugins.find(group.points, chosen, group.own)
    if found is None:
        if chosen not in group.own and release:
            raise plugins.missing(group.points, chosen, release)
        return None
    if frozen and release != found.release:
        raise plugins.missing(group.points, chosen, release)
    thing = plugins.load(found)
    schema = schema_of(found, thing, group.base)
    added: dict[str, Any] = {"package": found.release}
    if group.points == plugins.AGENTS:
        added["learns"] = learns(found, thing)
    plain = OmegaConf.to_container(node)
    assert isinstance(plain, dict)
    for key, value in added.items():
        if key in plain and plain[key] is not None and plain[key] != value:
            raise ConfigError(
                f"{group.key}.{key}={short(plain[key])}: is written by itself ({value}); leave it out"
            )
    values = _whole_numbers(schema, {str(key): value for key, value in plain.items()})
    root = OmegaConf.create({group.key: OmegaConf.structured(schema)})
    OmegaConf.set_struct(root, True)
    merged = OmegaConf.merge(root, {group.key: values | added})
    typed = OmegaConf.select(merged, group.key)
    assert isinstance(typed, DictConfig)
    return typed


def _whole_numbers(schema: type, values: dict[str, Any]) -> dict[str, Any]:
    """1e6 is a whole number where the schema wants one."""
    wanted = {
        f.name for f in dataclasses.fields(schema) if str(f.type) in ("int", "int | None", "<class 'int'>")
    }
    found = dict(values)
    for key in wanted & found.keys():
        if isinstance(found[key], float) and (number := whole(str(found[key]))) is not None:
            found[key] = number
    return found


def schema_of(one: plugins.Declared, thing: Any, base: type) -> type:
    """The dataclass with the types and ranges of a configuration: `Config` of what the entry point names.

    Raises:
        ConfigError: it is none, or not one below `base`.
    """
    found = getattr(thing, "Config", base)
    if not (isinstance(found, type) and issubclass(found, base) and dataclasses.is_dataclass(found)):
        raise ConfigError(
            f"{plugins.KEYS[one.group]}={one.name}: Config of {one.value} in {one.release} must be a dataclass below "
            f"auvbench.plugin.{'AgentConfig' if base is AgentConfig else 'SimulatorConfig'}"
        )
    try:
        OmegaConf.structured(found)
    except (OmegaConfBaseException, TypeError, ValueError) as error:
        raise ConfigError(
            f"{plugins.KEYS[one.group]}={one.name}: Config of {one.value} in {one.release} is no schema: "
            f"{plugins.describe_error(error)}"
        ) from error
    return found


LEARNER = ("save", "load")
EXACT = ("state", "restore")


def learns(one: plugins.Declared, thing: Any) -> bool:
    """Whether what an entry point names learns: it has a method `learn`.

    Raises:
        ConfigError: it cannot be called, or lacks what such an agent needs.
    """
    if not callable(thing):
        raise ConfigError(
            f"algo.agent={one.name}: {one.value} of {one.release} is a {type(thing).__name__}; it must be a class, or a "
            "function, that makes an agent from a configuration and a vehicle"
        )
    if not callable(getattr(thing, "learn", None)):
        return False
    needed = LEARNER + (EXACT if getattr(thing, "exact_resume", None) else ())
    lacking = [name for name in needed if not callable(getattr(thing, name, None))]
    if not isinstance(getattr(thing, "exact_resume", None), bool):
        lacking.append("exact_resume, True or False")
    if lacking:
        raise ConfigError(
            f"algo.agent={one.name}: {one.value} of {one.release} learns and lacks {', '.join(lacking)} "
            "(auvbench.agents.base.Learner)"
        )
    return True


def capabilities(simulator: InstalledSimulator) -> Capabilities:
    """What a simulator of an installed package says that it can.

    Raises:
        ConfigError: it says nothing.
    """
    thing = thing_of(plugins.SIMULATORS, simulator.name, simulator.package)
    found = getattr(thing, "capabilities", None)
    if not isinstance(found, Capabilities):
        raise ConfigError(
            f"simulator.name={simulator.name}: its class in {simulator.package} lacks capabilities, an "
            "auvbench.plugin.Capabilities"
        )
    return found


def thing_of(group: str, name: str, release: str) -> Any:
    """What the entry point behind a typed configuration names.

    Raises:
        ConfigError: its package is not installed in that version, or cannot be imported.
    """
    found = plugins.find(group, name)
    if found is None or found.release != release:
        raise plugins.missing(group, name, release)
    return plugins.load(found)


def releases(config: Any) -> dict[str, str]:
    """Versions of the packages behind a typed configuration, by name, for a manifest."""
    given = (str(getattr(node, "package", "")) for node in (config.algo, config.simulator))
    return dict(release.split("==", 1) for release in given if "==" in release)


def releases_of(config: Mapping[str, Any]) -> list[str]:
    """The packages behind a plain configuration, with their versions."""
    nodes = (config.get(group.key) for group in GROUPS)
    return [str(node["package"]) for node in nodes if isinstance(node, Mapping) and node.get("package")]
