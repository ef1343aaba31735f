"""The configuration of what installed packages bring: its schemas, and the keys added to them.

A package's `algo/NAME.yaml` holds its values and the comments that explain them; the class behind its entry point holds
their types and ranges as `Config`, a dataclass below `AgentConfig`, and the `TaskSpec` or `RewardSpec`
behind it as `schema`. Composing adds the key `package`, name and version of the installed package, and to agents
`learns`. They are part of a run's identity: another version is another run. A task enters the registries of tasks and
metrics when it is composed.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from omegaconf import DictConfig, OmegaConf, open_dict
from omegaconf.errors import OmegaConfBaseException

from auvbench import metrics, record
from auvbench.config import plugins, rewards, schema, tasks
from auvbench.config.algorithms import AGENTS, Tuned
from auvbench.errors import ConfigError, closest
from auvbench.untrusted.text import short


@dataclass(kw_only=True)
class AgentConfig:
    """The `algo` configuration of an agent of an installed package; a subclass has keys of its own."""

    name: str = schema.name()
    agent: str = schema.name()
    n_envs: int = schema.number(1, 65_536)
    package: str
    learns: bool
    tuned: Tuned | None = None  # where its values were searched for


OWN = {
    plugins.AGENTS: tuple(AGENTS),
    plugins.TASKS: tasks.OWN,
    plugins.REWARDS: tuple(rewards.SCHEMAS),
}
"""names of auvbench's own, by group of entry points"""
_BASES: dict[str, tuple[str, type]] = {
    plugins.AGENTS: ("Config", AgentConfig),
    plugins.TASKS: ("schema", tasks.TaskConfig),
    plugins.REWARDS: ("schema", rewards.RewardConfig),
}
"""by group: the attribute that holds the schema, and the base class of the schema"""
CONFIGS = tuple(kind for _, kind in _BASES.values())


def complete(config: DictConfig, *, frozen: bool = False) -> DictConfig:
    """Return a composed configuration with the types and the added keys of installed packages.

    Args:
        config: composed; what is of auvbench itself is left as it is.
        frozen: it is that of a run: the package must be installed in the version that it names.

    Raises:
        ConfigError: a key is unknown or missing, a type is wrong, or the package cannot be used.
        OmegaConfBaseException: as above, for `compose.translate`.
    """
    for group, own in OWN.items():
        key, _, named_by = plugins.KEYS[group].partition(".")
        node = config.get(key)
        chosen = node.get(named_by) if isinstance(node, DictConfig) else None
        if not isinstance(chosen, str):
            continue
        release = str(node.get("package") or "")
        found = plugins.find(group, chosen, own)
        if (found is None and chosen not in own and release) or (
            found and frozen and release != found.release
        ):
            raise plugins.missing(group, chosen, release)
        if found is not None:
            with open_dict(config):
                config[key] = _completed(found, key, node)
    return config


def _completed(found: plugins.Declared, key: str, node: DictConfig) -> DictConfig:
    thing = plugins.load(found)
    kind = _schema_of(found, thing)
    if found.group in (plugins.TASKS, plugins.REWARDS):
        enter(found)
    added: dict[str, Any] = {"package": found.release}
    if found.group == plugins.AGENTS:
        added["learns"] = _learns(found, thing)
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
    typed = OmegaConf.select(OmegaConf.merge(root, {key: values | added}), key)
    assert isinstance(typed, DictConfig)
    return typed


def _schema_of(one: plugins.Declared, thing: Any) -> type:
    """Return `Config` of an entry point's object, a dataclass with types and ranges.

    Raises:
        ConfigError: it is no such dataclass.
    """
    attribute, base = _BASES[one.group]
    found = getattr(thing, attribute, base)
    try:
        if isinstance(found, type) and issubclass(found, base) and dataclasses.is_dataclass(found):
            OmegaConf.structured(found)
            return found
        reason = ""
    except (OmegaConfBaseException, TypeError, ValueError) as error:
        reason = f" ({plugins.describe_error(error)})"
    raise one.error(f"has a {attribute} that is no dataclass below auvbench.plugin.{base.__name__}{reason}")


def enter(found: plugins.Declared) -> None:
    """Enter the task or the reward of an installed package into the registries.

    Raises:
        ConfigError: what it declares cannot be used.
    """
    spec = plugins.load(found)
    kind = tasks.TaskSpec if found.group == plugins.TASKS else rewards.RewardSpec
    if not isinstance(spec, kind):
        raise found.error(f"is a {type(spec).__name__}; it must be an auvbench.plugin.{kind.__name__}")
    if spec.name != found.name:
        raise found.error(f"has the name {short(repr(spec.name))}; it must be that of its entry point")
    if isinstance(spec, rewards.RewardSpec):
        _check_reward(found, spec)
        rewards.REWARDS[spec.name] = spec
    elif tasks.TASKS.get(spec.name) is not spec:
        _check_task(found, spec)
        try:
            metrics.add(spec.name, spec.metrics)
        except ValueError as error:
            raise found.error(str(error)) from None
        tasks.TASKS[spec.name] = spec
        record.forget()


def _check_reward(one: plugins.Declared, spec: rewards.RewardSpec) -> None:
    keys = {key: hint for key, hint in schema.keys(spec.schema).items() if key not in ("name", "package")}
    for key, hint in keys.items():
        if hint not in (int, float):
            raise one.error(f"has the parameter {key}, which is no number: int or float")
    if len(keys) > rewards.PARAMETERS:
        raise one.error(f"has {len(keys)} parameters; at most {rewards.PARAMETERS} fit")


def _check_task(one: plugins.Declared, spec: tasks.TaskSpec) -> None:
    for what, values, known in (
        ("block", spec.blocks, tasks.BLOCKS),
        ("outcome", spec.outcomes, record.OUTCOMES),
    ):
        for value in values:
            if value not in known:
                raise one.error(f"declares the {what} {short(repr(value))}; {closest(str(value), known)}")
    for metric in spec.metrics:
        column = isinstance(metric, metrics.Metric) and metric.kind in ("episode", "scenario")
        if not column or not re.fullmatch(r"[a-z]\w*", metric.name) or not metric.low < metric.high:
            raise one.error(f"declares {short(repr(metric))} as a metric; make it by auvbench.plugin.column")
    own = tuple(metric.measure for metric in spec.metrics if metric.better)
    ranks = (*record.measure_names(), *own)
    if spec.primary not in ranks:
        raise one.error(
            f"is ranked by {short(repr(spec.primary))}, which is no measure; {closest(spec.primary, ranks)}"
        )


def enter_task(name: str, release: str) -> None:
    """Enter the task of a run that is read, so that its metrics have titles, units and ranges; any version does.

    Raises:
        ConfigError: its package is not installed, or cannot be used.
    """
    found = plugins.find(plugins.TASKS, name, OWN[plugins.TASKS])
    if found is None:
        raise plugins.missing(plugins.TASKS, name, release)
    enter(found)


def forget() -> None:
    """Remove what `enter` entered and clear what is cached: for tests, and for programs that install packages."""
    for name in set(tasks.TASKS) - set(tasks.OWN):
        del tasks.TASKS[name]
        metrics.drop(name)
    rewards.REWARDS.clear()
    record.forget()
    plugins.forget()


def _learns(one: plugins.Declared, thing: Any) -> bool:
    """Return whether an entry point's object learns: it has a method `learn`.

    Raises:
        ConfigError: it cannot be called, or lacks what a learner needs.
    """
    if not callable(thing):
        raise one.error(f"is a {type(thing).__name__}; it must be a class or a function that makes an agent")
    if not callable(getattr(thing, "learn", None)):
        return False
    exact = getattr(thing, "exact_resume", None)
    needed = ("save", "load", "state", "restore") if exact else ("save", "load")
    lacking = [name for name in needed if not callable(getattr(thing, name, None))]
    lacking += [] if isinstance(exact, bool) else ["exact_resume, True or False"]
    if lacking:
        raise one.error(f"learns and lacks {', '.join(lacking)} (auvbench.agents.base.Learner)")
    return True


def agent_of(name: str, release: str) -> Any:
    """Return the object behind the entry point of an agent.

    Raises:
        ConfigError: its package is not installed in that version, or cannot be imported.
    """
    found = plugins.find(plugins.AGENTS, name)
    if found is None or found.release != release:
        raise plugins.missing(plugins.AGENTS, name, release)
    return plugins.load(found)


def releases(config: Any) -> dict[str, str]:
    """Return the versions of the packages behind a configuration, typed or plain, by name, for a manifest."""
    found = {}
    for key in plugins.KEYS.values():
        group = key.partition(".")[0]
        node = config.get(group) if isinstance(config, Mapping) else getattr(config, group)
        package = node.get("package") if isinstance(node, Mapping) else getattr(node, "package", None)
        if package:
            name, _, version = str(package).partition("==")
            found[name] = version
    return found
