"""Check the values of a configuration: the range of each field, then rules that span several fields."""

from __future__ import annotations

import dataclasses
import decimal
import math
import re
from collections.abc import Mapping
from typing import Any, TypeVar

from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import MissingMandatoryValue

from auvbench.config import algorithms, navigation, rewards, schema, simulators, tasks
from auvbench.config.disturbances import asking
from auvbench.config.fields import below, require, show
from auvbench.errors import ConfigError, closest
from auvbench.registry import AGENTS
from auvbench.untrusted.text import short

T = TypeVar("T")

MOST_STEPS = 10_000_000
"""largest number of agent steps of an episode"""

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._+-]*")


def validate_fields(config: Any, prefix: str = "") -> None:
    """Check a schema dataclass and all nested schemas.

    Raises:
        ConfigError: the message names the key, the value, and the valid range or the closest valid name.
    """
    names = [field.name for field in dataclasses.fields(config)]
    for extra in vars(config).keys() - set(names):  # `+key=value` bypasses Hydra's struct flag
        raise ConfigError(f"{prefix}{extra}: unknown key; {closest(extra, names)}")
    for field in dataclasses.fields(config):
        key = f"{prefix}{field.name}"
        value = getattr(config, field.name)
        if dataclasses.is_dataclass(value):
            validate_fields(value, f"{key}.")
        elif value is not None:
            check_value(key, value, field.metadata)
        elif not any(word in str(field.type) for word in ("None", "Any", "Optional")):
            raise ConfigError(f"{key}=null: a value is missing")


def check_value(key: str, value: Any, rule: Mapping[str, Any]) -> None:
    """Check a value against the metadata of its field.

    Raises:
        ConfigError: see `validate_fields`.
    """
    if isinstance(value, float) and not math.isfinite(value):
        raise ConfigError(f"{key}={value}: must be a finite number")
    if "choices" in rule and value not in (choices := rule["choices"]()):
        raise ConfigError(f"{key}={value}: unknown; {closest(str(value), choices)}")
    if "name" in rule and not _NAME.fullmatch(str(value)):
        raise ConfigError(
            f"{key}={value!r}: must be a plain name (letters, digits, dots, dashes, underscores, +), since it names a folder"
        )
    if "low" in rule:
        low, high, open_low = rule["low"], rule["high"], rule["open_low"]
        if value < low or (open_low and value == low) or value > high:
            raise ConfigError(f"{key}={show(value)}: must be {_range(low, high, open_low)}")


def _range(low: float, high: float, open_low: bool) -> str:
    lower = f"{'more than' if open_low else 'at least'} {limit(low, least=True)}"
    upper = f"at most {limit(high, least=False)}"
    if math.isinf(high):
        return lower
    return upper if math.isinf(low) else f"{lower} and {upper}"


def limit(value: float, *, least: bool, digits: int = 12) -> str:
    """Return the limit of a range as text: an int in full, a float rounded to the inside of the range.

    >>> limit(2 * math.pi, least=False, digits=6), limit(2**32 - 1, least=False, digits=6), limit(0.5, least=True)
    ('6.28318', '4294967295', '0.5')
    """
    if isinstance(value, int):
        return str(value)
    rounding = decimal.ROUND_CEILING if least else decimal.ROUND_FLOOR
    inside = decimal.Context(prec=digits, rounding=rounding).create_decimal(decimal.Decimal(repr(value)))
    return f"{float(inside):.{digits}g}"


def structured(config: DictConfig, kind: type[T], key: str = "") -> T:
    """Return a composed configuration, or its part `key`, as a schema dataclass with checked values.

    Raises:
        ConfigError: a value is missing or out of range.
    """
    node = config[key] if key else config
    prefix = f"{key}." if key else ""
    required = (field.name for field in dataclasses.fields(kind) if _has_no_default(field))  # type: ignore[arg-type]
    if isinstance(node, DictConfig) and (
        removed := next((name for name in required if name not in node), "")
    ):
        raise ConfigError(f"{prefix}{removed}: a value is missing")
    try:
        typed = OmegaConf.to_object(node)
    except MissingMandatoryValue as error:
        missing = min(f"{prefix}{name}" for name in OmegaConf.missing_keys(node))
        hint = "; algo=ppo chooses an algorithm" if missing.startswith("algo.") else ""
        raise ConfigError(f"{missing}: a value is missing{hint}") from error
    if not isinstance(typed, kind):
        raise ConfigError(f"{key or 'this'}: is not a {kind.__name__}; start from the file in conf/")
    for group, types in (
        ("algo", algorithms.Algorithm | algorithms.AgentConfig),
        ("simulator", simulators.Simulator),
        ("task", tasks.Task),
        ("reward", rewards.Reward),
    ):
        answer = getattr(typed, group, None) if isinstance(typed, schema.TrainConfig) else None
        if answer is not None and not (dataclasses.is_dataclass(answer) and isinstance(answer, types)):
            agent = str(answer.get("agent", "")) if isinstance(answer, dict) else ""
            unknown = f".agent={short(agent)}: unknown; {closest(agent, AGENTS.own)}" if agent else ""
            raise ConfigError(
                f"{group}{unknown or f': its file must start from a schema (see conf/{group})'}"
            )
    validate_fields(typed, prefix)
    return typed


def _has_no_default(field: dataclasses.Field[Any]) -> bool:
    return field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING


def resolved(config: DictConfig) -> dict[str, Any]:
    """Return the values of a composed configuration as plain Python objects, with interpolations resolved."""
    plain = OmegaConf.to_container(config, resolve=True, throw_on_missing=True)
    assert isinstance(plain, dict)
    return {str(key): value for key, value in plain.items()}


def train_config(config: DictConfig) -> schema.TrainConfig:
    """Check the configuration of a run and return it as a typed object.

    Raises:
        ConfigError: a value is out of range or missing, or contradicts another.
    """
    typed = structured(config, schema.TrainConfig)
    check_across(typed)
    return typed


def evaluate_config(config: DictConfig) -> schema.EvaluateConfig:
    """Check the configuration of a test and return it as a typed object.

    Raises:
        ConfigError: a value is out of range or missing.
    """
    typed = structured(config, schema.EvaluateConfig)
    evaluate_protocol(typed.protocol)
    return typed


def evaluate_protocol(protocol: schema.Protocol) -> None:
    """Check a protocol and its conditions.

    Raises:
        ConfigError: a value is out of range, the protocol has no condition, or two conditions have the same
            name.
    """
    validate_fields(protocol, "protocol.")
    names = [condition.name for condition in protocol.conditions]
    if not names:
        raise ConfigError("protocol.conditions: at least one condition is needed")
    for index, condition in enumerate(protocol.conditions):
        key, name = f"protocol.conditions[{index}]", condition.name
        validate_fields(condition, f"{key}.")
        plain = re.fullmatch(r"[A-Za-z0-9.+=-]+", name)
        require(bool(plain), f"{key}.name", repr(name), "have only letters, digits and . + - =")
        require(names.count(name) == 1, f"{key}.name", name, "be unique")


def check_across(config: schema.TrainConfig) -> None:
    """Check rules that span several keys.

    Raises:
        ConfigError: a value contradicts another.
    """
    task, noise, frequency = config.task, config.noise, config.step.frequency
    _task(task)
    rewards.check_reward(task.name, config.reward.name)
    config.reward.check()
    for name in ("position", "yaw", "command"):
        span = getattr(noise, name)
        below(f"noise.{name}.low", span.low, f"noise.{name}.high", span.high)
    limit = schema.step_limit(task, frequency)
    if not 1 <= limit <= MOST_STEPS:
        raise ConfigError(
            f"task.time_limit={task.time_limit:g}: is {limit} steps at {frequency:g} Hz; must be from "
            f"{1 / frequency:g} to {MOST_STEPS / frequency:g} s"
        )
    task.check_length(frequency)
    for part, factor in config.disturbance.factors():
        with asking(part, factor, "check"):
            factor.check(f"disturbance.{part}")
    simulators.check_disturbance(config.simulator, config.disturbance)
    simulators.check_world(config.simulator, config.world)
    simulators.check_filter(config.simulator, config.filter)
    config.world.check()
    tasks.check_solids(task, config.world)
    if task.team > 1:
        _check_team(config)
    navigation.check(config)
    vehicles_free = config.train.evaluate_every == 0 or not simulators.is_served(config.simulator)
    what = (
        f"be 0 with simulator={config.simulator.name}: a validation during training would interrupt the "
        "training episodes of the server's vehicles"
    )
    require(vehicles_free, "train.evaluate_every", config.train.evaluate_every, what)
    config.algo.check()


def _check_team(config: schema.TrainConfig) -> None:
    """Refuse a team of several vehicles if the simulator, the agent or the world allows only one vehicle in an episode."""
    able = {
        f"simulator={config.simulator.name}": simulators.capabilities(config.simulator).teams,
        f"algo={config.algo.name}": config.algo.agent not in AGENTS.own or AGENTS[config.algo.agent].teams,
        f"world={config.world.name}": not config.world.solid,
    }
    for part, fits in able.items():
        if not fits:
            raise ConfigError(
                f"task.vehicles={config.task.team}: {part} allows one vehicle in an episode; type task.vehicles=1, or another "
                f"{part.partition('=')[0]}"
            )


def _task(task: tasks.Task) -> None:
    """Check rules that span several keys of `task`."""
    for key in ("start", "waypoint_low", "waypoint_high", "station", "centre", "dock"):
        value = getattr(task, key, None)
        fits = value is None or (len(value) == 3 and all(map(math.isfinite, value)))
        require(fits, f"task.{key}", value, "be three finite numbers [x, y, z] in m")
    low, high = task.depth_low, task.depth_high
    below("task.depth_low", low, "task.depth_high", high, strictly=True)
    for key in ("start", "station", "centre", "dock"):
        point = getattr(task, key, None)
        inside = point is None or low <= point[2] <= high
        require(inside, f"task.{key}", point, "have a z within the depth limits")
    for key in ("size", "speed", "start"):
        low_key, high_key = f"{key}_low", f"{key}_high"
        if hasattr(task, low_key):
            below(f"task.{low_key}", getattr(task, low_key), f"task.{high_key}", getattr(task, high_key))
    task.check()
    tasks.check_observation(task)
