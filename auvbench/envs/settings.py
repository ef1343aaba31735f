"""Read the settings of an environment in Python: its configuration, and `reset(options=...)`.

A configuration is composed from overrides and from keywords for the usual overrides, and cached. The options replace
the drawn start and goal of an episode.
"""

from __future__ import annotations

import copy
import dataclasses
import operator
import shlex
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from auvbench.config import schema, tasks
from auvbench.errors import ConfigError, closest
from auvbench.registry import TASKS

if TYPE_CHECKING:
    from auvbench.envs.batch import Batch

Floats = NDArray[np.float64]


Overrides = str | Sequence[str]

STEPS = 1000
"""`max_episode_steps` of the registered ids, as in the original study"""

KEYS = {
    "task": "task",
    "vehicle": "vehicle",
    "k": "reward.k",
    "frequency": "step.frequency",
    "noise": "noise",
    "disturbance": "disturbance",
    "world": "world",
    "sensors": "sensors",
    "navigation": "navigation",
    "filter": "filter",
}
"""Configuration key of each keyword argument of an environment."""

OPTIONS = ("pose", "waypoint", "distance")
"""Options of `reset`"""


def configuration(
    config: schema.TrainConfig | None = None,
    overrides: Overrides = (),
    conf: str | Path | None = None,
    **keywords: Any,
) -> schema.TrainConfig:
    """Return the configuration of an environment: `config` if given, else a configuration composed from the package's files.

    Args:
        config: complete configuration; if it is given, all other arguments must be left out.
        overrides: overrides as on the command line: a sequence, or one string with spaces between them.
        conf: folder that is searched before the package's files, e.g. with your own vehicle in `<conf>/vehicle/`.
            Unlike the command line, Python does not search `./conf` by default.
        keywords: values for the keywords of KEYS; None has no effect. `overrides` take precedence.

    Raises:
        ConfigError: a keyword, a key, a type or a value is wrong, or there is no folder `conf`.
    """
    for key in keywords:
        if key not in KEYS:
            raise ConfigError(f"{key}: unknown keyword; {closest(key, KEYS)}")
    lines = split(overrides)
    lines = [f"{KEYS[key]}={value}" for key, value in keywords.items() if value is not None] + lines
    if config is not None:
        if lines or conf is not None:
            raise ConfigError(
                f"config: is a complete configuration; leave out {(lines or [f'conf={conf}'])[0]}"
            )
        return config
    if conf is None:
        return copy.deepcopy(_composed(tuple(lines)))
    folder = Path(conf)
    if not folder.is_dir():
        raise ConfigError(f"conf={conf}: no such folder")
    return _compose(lines, folder)


def split(overrides: Overrides) -> list[str]:
    """Return overrides as a list.

    Raises:
        ConfigError: an override is not a text.
    """
    lines = shlex.split(overrides) if isinstance(overrides, str) else list(overrides)
    for line in lines:
        if not isinstance(line, str):
            raise ConfigError(f"overrides: {line!r} is not a text; an override is written 'reward.k=40'")
    return lines


def refuse_team(config: schema.TrainConfig) -> None:
    """Raise ConfigError for a task with a team; interfaces whose episodes have only one vehicle call this function."""
    if config.task.team > 1:
        raise ConfigError(
            f"task.vehicles={config.task.team}: this interface has one vehicle in an episode; use auvbench.parallel_env or "
            "auvbench.envs.sb3.make, or task.vehicles=1"
        )


@lru_cache(maxsize=256)
def _composed(overrides: tuple[str, ...]) -> schema.TrainConfig:
    """Return a composed configuration from a cache. Composing takes tenths of a second, and the package's files do not
    change.
    """
    return _compose(overrides, None)


def _compose(overrides: Sequence[str], folder: Path | None) -> schema.TrainConfig:
    from auvbench.config.compose import compose
    from auvbench.config.validate import train_config

    return train_config(compose("train", overrides, folder=folder))


def limited(config: schema.TrainConfig, steps: int | None) -> schema.TrainConfig:
    """Return the configuration with another step limit per episode. None and STEPS, which Gymnasium passes by default,
    change nothing; -1 sets the limit to 10 million steps.

    Raises:
        ConfigError: the limit is less than 1 but not -1, or too small for the task.
    """
    if steps is None or steps == STEPS:
        return config
    most = 10_000_000
    if steps != -1 and not 1 <= steps <= most:
        raise ConfigError(f"max_episode_steps={steps}: must be from 1 to {most}, or -1 for no limit")
    task = dataclasses.replace(config.task, max_steps=most if steps == -1 else int(steps), time_limit=None)
    if steps != -1:
        try:
            task.check_length(config.step.frequency)
        except ConfigError as error:
            raise ConfigError(f"max_episode_steps={steps}: {error}") from None
    return dataclasses.replace(config, task=task)


def folded(seed: Any) -> int:
    """Return a seed of 32 bits: the seed itself below 2^32, otherwise its hash (NumPy's SeedSequence).

    Raises:
        ConfigError: the seed is negative or not a whole number.
    """
    try:
        number = operator.index(seed)
    except TypeError:
        raise ConfigError(f"seed={seed!r}: must be a whole number") from None
    if number < 0:
        raise ConfigError(f"seed={number}: must be at least 0")
    return number if number < 1 << 32 else int(np.random.SeedSequence(number).generate_state(1)[0])


def spaces_of(batch: Batch) -> tuple[spaces.Box, spaces.Box]:
    """Return the observation space (n_obs,) and the action space (n_u,) of one environment of the batch."""
    high = batch.task.spec.bounds
    n_u = len(batch.vehicle.actuators)
    return spaces.Box(-high, high, dtype=np.float32), spaces.Box(-1.0, 1.0, (n_u,), dtype=np.float32)


def check_options(options: Mapping[str, Any] | None, *more: str) -> Mapping[str, Any]:
    """Return the options after a check of their names.

    Raises:
        ConfigError: a name is unknown.
    """
    checked = options or {}
    for name in checked:
        if name not in (*OPTIONS, *more):
            raise ConfigError(f"options[{name!r}]: unknown; {closest(str(name), (*OPTIONS, *more))}")
    return checked


def places(options: Mapping[str, Any], count: int, task: tasks.Task, bounds: Floats) -> dict[str, Any]:
    """Return starts and goals of `count` environments as arguments of `Batch.reset`: pose, waypoint, distance.

    Args:
        options: options by name, each as one value for all environments or with `count` rows. `pose`: x, y, z in m and a
            quaternion w, x, y, z, which is normalised (7,); or x, y, z and yaw in rad (4,); or only x, y, z (3,). For tasks
            with a free goal, `waypoint`: x, y, z in m (3,); or `distance`: distance in m to which the drawn waypoint is
            moved.
        count: number of environments.
        task: task with the depth limits.
        bounds: largest position errors (3,) of the observation space, m.

    Raises:
        ConfigError: a shape is wrong, a number is not finite or out of range, or both waypoint and distance are
            given.
    """
    pose = None if options.get("pose") is None else _pose(options["pose"], count, task)
    if not TASKS[task.name].free_goal:
        for name in ("waypoint", "distance"):
            if options.get(name) is not None:
                raise ConfigError(
                    f"options[{name!r}]: task={task.name} has its own reference; give only pose"
                )
        return {"pose": pose}
    fixed: Any = task
    start = np.asarray([fixed.start]) if pose is None else pose[:, :3]
    waypoint, distance = options.get("waypoint"), options.get("distance")
    if waypoint is not None and distance is not None:
        raise ConfigError("options['distance']: leave it out, since options['waypoint'] is given")
    if waypoint is not None:
        waypoint = _rows("waypoint", _numbers("waypoint", waypoint), (3,), count, "x, y, z in m")
        away = np.abs(waypoint - start).max(0)
        if (away > bounds).any():
            raise ConfigError(
                f"options['waypoint']: is {_show(away)} m from the start; must be at most {_show(bounds)} m, the bounds of the observation"
            )
        _within_depths("waypoint", waypoint, task)
    if distance is not None:
        distance = _rows("distance", _numbers("distance", distance), (), count, "m")
        for value in distance:
            if not 0.0 < value <= bounds.min():
                raise ConfigError(
                    f"options['distance']={value:g}: must be more than 0 and at most {bounds.min():g} m"
                )
    return {"pose": pose, "waypoint": waypoint, "distance": distance}


def _pose(value: Any, count: int, task: tasks.Task) -> Floats:
    poses = _numbers("pose", value)
    if poses.shape[-1:] in ((3,), (4,)):
        yaw = poses[..., 3:].sum(-1)
        zero = np.zeros_like(yaw)
        quaternion = np.stack([np.cos(yaw / 2), zero, zero, np.sin(yaw / 2)], axis=-1)
        poses = np.concatenate([poses[..., :3], quaternion], axis=-1)
    rows = _rows("pose", poses, (7,), count, "x, y, z in m and a quaternion w, x, y, z")
    norm = np.linalg.norm(rows[:, 3:], axis=1)
    if (norm < 1e-6).any():
        raise ConfigError("options['pose']: its quaternion is 0; (1, 0, 0, 0) is level, facing east")
    rows[:, 3:] /= norm[:, None]
    _within_depths("pose", rows, task)
    return rows


def _within_depths(name: str, rows: Floats, task: tasks.Task) -> None:
    for z in rows[:, 2]:
        if not task.depth_low <= z <= task.depth_high:
            raise ConfigError(
                f"options[{name!r}]: z = {z:g} m must be within {task.depth_low:g} and {task.depth_high:g} m"
            )


def _show(values: Floats) -> str:
    return "(" + ", ".join(f"{value:g}" for value in values) + ")"


def _numbers(name: str, value: Any) -> Floats:
    try:
        numbers = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise ConfigError(f"options[{name!r}]={value!r}: must be numbers") from None
    if not np.isfinite(numbers).all():
        raise ConfigError(f"options[{name!r}]={value!r}: must be finite numbers")
    return numbers


def _rows(name: str, value: Floats, shape: tuple[int, ...], count: int, what: str) -> Floats:
    if value.shape not in (shape, (count, *shape)):
        raise ConfigError(
            f"options[{name!r}]: has shape {value.shape}; must be {shape} or {(count, *shape)}: {what}"
        )
    return np.array(np.broadcast_to(value, (count, *shape)))
