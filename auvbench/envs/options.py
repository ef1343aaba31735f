"""`reset(options=...)`: where an episode starts and where it is to go, instead of what is drawn."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.config import tasks
from auvbench.errors import ConfigError, closest

Floats = NDArray[np.float64]

NAMES = ("pose", "waypoint", "distance")


def check_names(options: Mapping[str, Any] | None, *more: str) -> Mapping[str, Any]:
    """Return the options after a check of their names.

    Raises:
        ConfigError: a name is unknown.
    """
    given = options or {}
    for name in given:
        if name not in (*NAMES, *more):
            raise ConfigError(f"options[{name!r}]: unknown; {closest(str(name), (*NAMES, *more))}")
    return given


def places(options: Mapping[str, Any], count: int, task: tasks.Task, bounds: Floats) -> dict[str, Any]:
    """Return where `count` environments start and go, as arguments of `Batch.reset`: pose, waypoint, distance.

    Args:
        options: `pose` (7,) for all or (count, 7): x, y, z in m and a quaternion w, x, y, z, which is normalised; or
            (3,), (4,): x, y, z, and yaw in rad. `waypoint` (3,) or (count, 3) in m, or `distance`, one number or
            (count,) in m, to which the drawn waypoint is moved; of the waypoint task alone.
        count: of environments.
        task: its depth limits hold.
        bounds: (3,) m, of the position error that the observation space admits.

    Raises:
        ConfigError: a shape is another, a number is not finite or out of range, or a waypoint and a distance are given.
    """
    pose = None if options.get("pose") is None else _pose(options["pose"], count, task)
    if not isinstance(task, tasks.Waypoint):
        for name in ("waypoint", "distance"):
            if options.get(name) is not None:
                raise ConfigError(
                    f"options[{name!r}]: task={task.name} has its own reference; give pose alone"
                )
        return {"pose": pose}
    start = np.asarray([task.start]) if pose is None else pose[:, :3]
    waypoint, distance = options.get("waypoint"), options.get("distance")
    if waypoint is not None and distance is not None:
        raise ConfigError("options['distance']: the waypoint is given already; give one of the two")
    if waypoint is not None:
        waypoint = _rows("waypoint", _numbers("waypoint", waypoint), (3,), count, "x, y, z in m")
        away = np.abs(waypoint - start).max(0)
        if (away > bounds).any():
            raise ConfigError(
                f"options['waypoint']: is {_show(away)} m from the start; the observation reaches {_show(bounds)} m"
            )
    if distance is not None:
        distance = _rows("distance", _numbers("distance", distance), (), count, "m")
        for value in distance:
            if not 0.0 < value <= bounds.min():
                raise ConfigError(
                    f"options['distance']={value:g}: must be more than 0 and at most {bounds.min():g} m"
                )
    return {"pose": pose, "waypoint": waypoint, "distance": distance}


def _pose(value: Any, count: int, task: tasks.Task) -> Floats:
    given = _numbers("pose", value)
    if given.shape[-1:] in ((3,), (4,)):
        yaw = given[..., 3:].sum(-1)
        zero = np.zeros_like(yaw)
        quaternion = np.stack([np.cos(yaw / 2), zero, zero, np.sin(yaw / 2)], axis=-1)
        given = np.concatenate([given[..., :3], quaternion], axis=-1)
    rows = _rows("pose", given, (7,), count, "x, y, z in m and a quaternion w, x, y, z")
    norm = np.linalg.norm(rows[:, 3:], axis=1)
    if (norm < 1e-6).any():
        raise ConfigError("options['pose']: its quaternion is 0; (1, 0, 0, 0) is level, facing east")
    rows[:, 3:] /= norm[:, None]
    for z in rows[:, 2]:
        if not task.depth_low <= z <= task.depth_high:
            raise ConfigError(
                f"options['pose']: z = {z:g} m must lie within {task.depth_low:g} and {task.depth_high:g} m"
            )
    return rows


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
