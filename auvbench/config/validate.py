"""Values: each field against the range that the schema states with its type, then what spans several fields."""

from __future__ import annotations

import dataclasses
import math
import re
from typing import Any

from omegaconf import DictConfig, OmegaConf

from auvbench.config import algorithms, disturbance, plugins, schema, simulators
from auvbench.config.agents import AGENTS
from auvbench.config.time_units import step_limit
from auvbench.errors import ConfigError, closest
from auvbench.untrusted.text import short

MOST_STEPS = 10_000_000
"""of an episode"""

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._+-]*")


def validate_fields(config: Any, prefix: str = "") -> None:
    """Checks a schema dataclass and everything below it.

    Raises:
        ConfigError: names the key, the value and the valid range or the closest name.
    """
    names = [field.name for field in dataclasses.fields(config)]
    for extra in vars(config).keys() - set(names):  # `+key=value` gets past Hydra's struct flag
        raise ConfigError(f"{prefix}{extra}: unknown key; {closest(extra, names)}")
    for field in dataclasses.fields(config):
        key = f"{prefix}{field.name}"
        value = getattr(config, field.name)
        if dataclasses.is_dataclass(value):
            validate_fields(value, f"{key}.")
        elif value is not None:
            _check_value(key, value, dict(field.metadata))
        elif not any(word in str(field.type) for word in ("None", "Any", "Optional")):
            raise ConfigError(f"{key}=null: a value is missing")


def _check_value(key: str, value: Any, rule: dict[str, Any]) -> None:
    if isinstance(value, float) and not math.isfinite(value):
        raise ConfigError(f"{key}={value}: must be a finite number")
    if "choices" in rule and value not in rule["choices"]:
        raise ConfigError(f"{key}={value}: unknown; {closest(str(value), rule['choices'])}")
    if "name" in rule and not _NAME.fullmatch(str(value)):
        raise ConfigError(
            f"{key}={value!r}: must be a plain name (letters, digits, dots, dashes, underscores), since it names a folder"
        )
    if "low" in rule:
        low, high, open_low = rule["low"], rule["high"], rule["open_low"]
        if value < low or (open_low and value == low) or value > high:
            raise ConfigError(f"{key}={_show(value)}: must be {_range(low, high, open_low)}")


def _show(value: Any) -> str:
    return f"{value:.12g}" if isinstance(value, float) else str(value)


def _range(low: float, high: float, open_low: bool) -> str:
    lower = f"{'more than' if open_low else 'at least'} {low:.12g}"
    upper = f"at most {high:.12g}"
    if math.isinf(high):
        return lower
    return upper if math.isinf(low) else f"{lower} and {upper}"


def train_config(config: DictConfig) -> schema.TrainConfig:
    """The typed configuration of a run, its values checked.

    Raises:
        ConfigError: a value is out of range, missing, or at odds with another.
    """
    if isinstance(config.get("algo"), DictConfig) and OmegaConf.is_missing(config.algo, "agent"):
        raise ConfigError("algo: a value is missing; algo=ppo chooses an algorithm")
    missing = sorted(str(key) for key in OmegaConf.missing_keys(config))
    if missing:
        raise ConfigError(f"{missing[0]}: a value is missing")
    typed = OmegaConf.to_object(config)
    if not isinstance(typed, schema.TrainConfig):
        raise ConfigError("this is no training configuration")
    if not dataclasses.is_dataclass(typed.algo):
        agent = typed.algo.get("agent") if isinstance(typed.algo, dict) else None
        if agent is not None and agent not in AGENTS:
            known = [*AGENTS, *(one.name for one in plugins.declared(plugins.AGENTS))]
            raise ConfigError(f"algo.agent={short(agent)}: unknown; {closest(str(agent), known)}")
        raise ConfigError(
            "algo: name an algorithm, e.g. algo=ppo; its file must start from a schema (see conf/algo)"
        )
    if not isinstance(typed.simulator, simulators.Simulator):
        raise ConfigError(
            "simulator: name one, e.g. simulator=fossen; its file must start from a schema (see conf/simulator)"
        )
    validate_fields(typed)
    _across(typed)
    return typed


def again(config: schema.TrainConfig) -> schema.TrainConfig:
    """Checks the algorithm of a configuration, the rest of which was checked before.

    Raises:
        ConfigError: a value is out of range, or at odds with another.
    """
    validate_fields(config.algo, "algo.")
    _across(config)
    return config


def evaluate_config(config: DictConfig) -> schema.EvaluateConfig:
    """The typed configuration of a test, its values checked.

    Raises:
        ConfigError: a value is out of range or missing.
    """
    missing = sorted(str(key) for key in OmegaConf.missing_keys(config))
    if missing:
        raise ConfigError(f"{missing[0]}: a value is missing")
    typed = OmegaConf.to_object(config)
    assert isinstance(typed, schema.EvaluateConfig)
    validate_fields(typed)
    evaluate_protocol(typed.protocol)
    return typed


def evaluate_protocol(protocol: schema.Protocol) -> None:
    """Checks a protocol and its conditions.

    Raises:
        ConfigError: a value is out of range, or there is no condition, or two have one name.
    """
    validate_fields(protocol, "protocol.")
    names = [condition.name for condition in protocol.conditions]
    if not names:
        raise ConfigError("protocol.conditions: at least one condition is needed")
    for index, condition in enumerate(protocol.conditions):
        validate_fields(condition, f"protocol.conditions[{index}].")
        if not re.fullmatch(r"[A-Za-z0-9.+=-]+", condition.name):
            raise ConfigError(
                f"protocol.conditions[{index}].name={condition.name!r}: must be letters, digits, dots, dashes, ="
            )
        if names.count(condition.name) > 1:
            raise ConfigError(f"protocol.conditions: the name {condition.name!r} occurs twice")


def _across(config: schema.TrainConfig) -> None:
    task = config.task
    for key in ("start", "waypoint_low", "waypoint_high"):
        value = getattr(task, key)
        if len(value) != 3 or not all(math.isfinite(v) for v in value):
            raise ConfigError(f"task.{key}={value}: must be three finite numbers [x, y, z] in m")
    if task.depth_low >= task.depth_high:
        raise ConfigError(
            f"task.depth_low={task.depth_low:g}: must be below task.depth_high={task.depth_high:g}"
        )
    for axis, low, high in zip("xyz", task.waypoint_low, task.waypoint_high, strict=True):
        if low > high:
            raise ConfigError(f"task.waypoint_low={task.waypoint_low}: {axis} exceeds task.waypoint_high")
    if not task.depth_low <= task.start[2] <= task.depth_high:
        raise ConfigError(f"task.start={task.start}: z must lie within the depth limits")
    for name in ("position", "yaw", "command"):
        span = getattr(config.noise, name)
        if span.low > span.high:
            raise ConfigError(
                f"noise.{name}.low={span.low:g}: must be at most noise.{name}.high={span.high:g}"
            )
    limit = step_limit(task, config.step.frequency)
    if not 1 <= limit <= MOST_STEPS:
        raise ConfigError(
            f"task.time_limit={task.time_limit:g}: is {limit} steps at {config.step.frequency:g} Hz; must be from "
            f"{1 / config.step.frequency:g} to {MOST_STEPS / config.step.frequency:g} s there"
        )
    disturbance.validate_disturbance(config.disturbance)
    simulators.check_disturbance(config.simulator, config.disturbance)
    _algorithm(config.algo)


def _algorithm(algo: algorithms.Algorithm) -> None:
    """What spans several keys of `algo`."""
    if isinstance(algo, algorithms.OnPolicy):
        rollout = algo.n_steps * algo.n_envs
        if rollout % algo.batch_size:
            raise ConfigError(
                f"algo.batch_size={algo.batch_size}: must divide algo.n_steps x algo.n_envs = {rollout}"
            )
        if rollout < 2:
            raise ConfigError(
                f"algo.n_steps=1: with one environment {algo.agent.upper()} needs at least 2 steps"
            )
    if isinstance(algo, algorithms.TRPO) and algo.n_steps * algo.n_envs < 2 * algo.sub_sampling_factor:
        raise ConfigError(
            f"algo.sub_sampling_factor={algo.sub_sampling_factor}: must leave at least 2 of the "
            f"algo.n_steps x algo.n_envs = {algo.n_steps * algo.n_envs} samples"
        )
    if isinstance(algo, algorithms.TRPO) and algo.line_search_shrinking_factor == 1.0:
        raise ConfigError("algo.line_search_shrinking_factor=1: must be less than 1, or no step gets shorter")
    if isinstance(algo, algorithms.Network):
        for key in ("net_arch", "critic_net_arch"):
            if not all(width > 0 for width in getattr(algo, key, ())):
                raise ConfigError(f"algo.{key}={getattr(algo, key)}: widths must be at least 1")
    if isinstance(algo, algorithms.OffPolicy):
        if algo.gradient_steps == 0:
            raise ConfigError(
                "algo.gradient_steps=0: must be at least 1, or -1 for as many as environment steps"
            )
        if algo.buffer_size < algo.n_envs:
            raise ConfigError(
                f"algo.buffer_size={algo.buffer_size}: must be at least algo.n_envs={algo.n_envs}"
            )
    if isinstance(algo, algorithms.Entropy):
        _number_or_auto("algo.ent_coef", algo.ent_coef)
        _number_or_auto("algo.target_entropy", algo.target_entropy)
    if isinstance(algo, algorithms.TQC) and algo.top_quantiles_to_drop_per_net >= algo.n_quantiles:
        raise ConfigError(
            f"algo.top_quantiles_to_drop_per_net={algo.top_quantiles_to_drop_per_net}: must be less than "
            f"algo.n_quantiles={algo.n_quantiles}"
        )
    if isinstance(algo, algorithms.CrossQ) and algo.batch_size < 2:
        raise ConfigError("algo.batch_size=1: batch normalisation needs at least 2 samples")
    residual = getattr(algo, "residual", None)
    if isinstance(residual, algorithms.Residual) and residual.pid.agent != "pid":
        raise ConfigError(f"algo.residual.pid.agent={residual.pid.agent}: must be pid")


def _number_or_auto(key: str, value: str) -> None:
    body = value.removeprefix("auto").removeprefix("_")
    if value == "auto":
        return
    try:
        float(body)
    except ValueError:
        raise ConfigError(f"{key}={value}: must be auto, auto_<initial value> or a number") from None
