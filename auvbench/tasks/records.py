"""Define the NumPy records of episodes and of parameters; only this module knows their layout.

An episode is a record of a structured array; parameters are a structured array of one row. Compiled functions and
Python read fields by name: `e.distance`, `p.tolerance`. The first fields are the same in every task. Functions that all
tasks share are therefore compiled only once, for a view of these fields.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.config import schema
from auvbench.dynamics.compiled import INTERPRETED as INTERPRETED
from auvbench.errors import AgentError

Floats = NDArray[np.float64]
Fields = Sequence[tuple[Any, ...]]
Record = Any
"""Record of a structured array: an episode `e`, or parameters `p`"""

_SUMS: Fields = (
    ("reference", "f8", (3,)),  # m, present reference position
    ("start", "f8", (3,)),  # m
    ("start_yaw", "f8"),  # rad
    ("distance", "f8"),  # m, present distance to the reference
    ("initial_distance", "f8"),  # m
    ("reward_sum", "f8"),
    ("deviation_sum", "f8"),  # m
    ("deviation_squared_sum", "f8"),  # m^2
    ("command_norm_sum", "f8"),  # N
    ("energy", "f8"),  # J
    ("path_length", "f8"),  # m
    ("change_sum", "f8"),  # sum of the norms of the normalised action's changes
    ("depth_margin", "f8"),  # m, smallest distance to a depth limit so far
    ("position", "f8", (3,)),  # m, position of the vehicle after the last finished step
)
"""Fields of every task; sums are over the steps of the episode"""
_YAW: Fields = (
    ("reference_yaw", "f8"),  # rad
    ("reference_velocity", "f8", (3,)),  # m/s, world axes
    ("error_squared_sum", "f8"),  # m^2
    ("yaw_error_squared_sum", "f8"),  # rad^2
    ("counted", "f8"),  # number of steps in these two sums
)
"""fields of tasks whose reference has its own yaw; 0 in other tasks"""
BELIEF: Fields = (
    ("position_sd", "f8", (3,)),  # m
    ("specific_force", "f8", (3,)),  # m/s2
    ("sensor_age", "f8", (3,)),  # s, ages of the last readings of DVL, depth sensor and compass
)
"""Further fields of a believed episode, which blocks of the estimate read"""
LOST = 1000.0
"""Largest position error of an estimate that has not diverged, m; the bounds of the observation include this error"""
_GOAL: Fields = (("goal", "f8", (3,)),)
"""Field of tasks that offer the block `goal_error`: position of the goal, m"""
_COUNTERS: Fields = (
    ("steps", "i8"),
    ("episode", "i8"),
    ("environment", "i8"),
    ("outcome", "i8"),  # -1 during the episode, otherwise an index into record.OUTCOMES
    ("seed", "i8"),  # seed of the episode's draws, 0 .. 2^32 - 1
)
_STEP: Fields = (
    ("last_distance", "f8"),  # m, distance after the previous step
    (
        "yaw_error",
        "f8",
    ),  # rad, the reference's yaw minus the vehicle's yaw; for a reference without a yaw, the bearing to it minus the vehicle's yaw
    ("detour", "f8"),  # m, from the reference to the goal; 0 unless the task writes it
    ("to_go", "f8"),  # m, distance + detour, for rewards
)
"""fields that each step writes before it reads them"""


@cache
def _interned(fields: tuple[tuple[Any, ...], ...]) -> np.dtype[Any]:
    """Return the same dtype object for equal fields.

    numba looks up the type in each call, and finds a dtype object that it has seen before ten times faster.
    """
    return np.dtype([*fields], align=True)


def _interned_type(dtype: np.dtype[Any]) -> np.dtype[Any]:
    """Return a record type without the class `Row`, as compiled functions need it."""
    return _interned(tuple(_fields(dtype)))


def _fields(dtype: np.dtype[Any]) -> Fields:
    return [(name, dtype[name].base, dtype[name].shape) for name in dtype.names or ()]


EPISODE = _interned_type(np.dtype([*_SUMS, *_YAW, *_GOAL, *_COUNTERS, *_STEP]))
"""the fields that every episode has"""

PARAMETERS: Mapping[str, str] = {
    "depth_low": "f8",  # m
    "depth_high": "f8",  # m
    "max_steps": "i8",
    "duration": "f8",  # s, agent step
    "body_frame": "i8",  # 1: position error in the body frame
    "position_noise_low": "f8",  # m
    "position_noise_high": "f8",  # m
    "yaw_noise_low": "f8",  # rad
    "yaw_noise_high": "f8",  # rad
    "command_noise_low": "f8",
    "command_noise_high": "f8",
    "both_signs": "i8",  # 1: noise of random sign
    "has_yaw": "i8",  # 1: the reference has its own yaw; 0: the reference's bearing replaces its yaw
    "history": "i8",  # number of stacked observations
}
"""the parameters that every task and every reward has"""
_COMMON = _interned_type(np.dtype(list(PARAMETERS.items())))

_SHARED_KEYS = {
    "name",
    "package",
    "observation",
    "block_packages",
    "range",
    "time_limit",
    "position_frame",
    *PARAMETERS,
}


class Row(np.void):  # type: ignore[misc]
    """Record with its fields as attributes. A field hides an array's method of the same name: `p.size`, `e.mean`."""

    def __getattribute__(self, name: str) -> Any:
        field = np.void.__getattribute__(self, "dtype").fields.get(name)
        if field is None:
            return np.void.__getattribute__(self, name)
        return np.void.__getattribute__(self, "getfield")(*field[:2])

    def __setattr__(self, name: str, value: Any) -> None:
        field = np.void.__getattribute__(self, "dtype").fields.get(name)
        if field is None:
            raise AttributeError(f"a record has no field {name}")
        np.void.__getattribute__(self, "setfield")(value, *field[:2])


class Table(np.ndarray[Any, Any]):
    """Records whose fields are attributes, unless an array has an attribute of this name."""

    def __getattr__(self, name: str) -> Any:
        if name in (self.dtype.names or ()):
            return np.asarray(self[name])
        raise AttributeError(name)

    def __setattr__(self, name: str, value: Any) -> None:
        if name in (self.dtype.names or ()):
            self[name] = value
        else:
            super().__setattr__(name, value)


def table(n: int, fields: Fields, owner: str) -> Any:
    """Return n episodes (n,), all zero, with the fields of every task and this task's own.

    Args:
        n: number of episodes.
        fields: the task's own fields: (name, type) or (name, type, shape).
        owner: name of the task for messages.

    Raises:
        AgentError: a field has a wrong name or type.
    """
    return _table(n, [*_fields(EPISODE), *fields], owner)


def state(n: int, fields: Fields, owner: str) -> Any:
    """Return records (n,) with the given fields, all zero: the state of a sensor, disturbance or estimator in n episodes.

    Raises:
        AgentError: a field has a wrong name or type.
    """
    return _table(n, fields or [("nothing", "i8")], owner)


def one_row(own: Mapping[str, Any], shared: Mapping[str, float], owner: str) -> Any:
    """Return parameters (1,): the parameters of every task, then the own parameters of a task, reward, disturbance, sensor or estimator.

    Args:
        own: numbers or sequences of numbers by name.
        shared: numbers by the names of `PARAMETERS`.
        owner: name of the owner of the parameters, for messages.

    Raises:
        AgentError: a parameter has a wrong name, or is not a number.
    """
    try:
        fields = [(name, _type(value), np.shape(value)) for name, value in own.items()]
    except (TypeError, ValueError) as error:
        raise AgentError(f"{owner}: its parameters must be numbers or lists of numbers: {error}") from error
    row = _table(1, [*_fields(_COMMON), *fields], owner)
    for name, value in {**shared, **own}.items():
        row[name] = value
        if np.isnan(row[name]).any():
            raise AgentError(f"{owner}: the parameter {name} is {value}; it must be a number")
    return row


def of_schema(config: Any) -> dict[str, Any]:
    """Return the numbers in a task's or reward's configuration by key; None is infinity, keys of `preview` are `preview_KEY`."""
    values: dict[str, Any] = {}
    hints = schema.keys(type(config))
    for field in dataclasses.fields(config):
        value = getattr(config, field.name)
        if field.name in _SHARED_KEYS or isinstance(value, str):
            continue
        if dataclasses.is_dataclass(value):
            values |= {f"{field.name}_{key}": number for key, number in of_schema(value).items()}
        elif value is None:
            values[field.name] = math.inf
        else:
            # Each key always has the same type, even if the user writes 1 for 1.0, because compiled code depends on the type.
            values[field.name] = value if hints.get(field.name) in (int, bool) else np.float64(value)
    return values


def check_names(config: Any, owner: str) -> None:
    """Raise AgentError if a key of a reward or disturbance would hide a parameter of every task that has the same name."""
    for field in dataclasses.fields(config):
        if field.name in PARAMETERS:
            raise AgentError(
                f"{owner}: its key {field.name} has the name of a parameter of every task; give it another name"
            )


def plain(array: Any) -> Any:
    """Return a table without attribute access in Python, so that numba recognises the table's type faster.

    With NUMBA_DISABLE_JIT, functions need attribute access, so the table itself is returned.
    """
    return array if INTERPRETED else bare(array)


def bare(array: Any) -> Any:
    """Return a view of a table without attribute access, as files store it."""
    return np.ndarray(array.shape, _interned_type(array.dtype), array, strides=array.strides)


def common(array: Any, dtype: np.dtype[Any] = EPISODE) -> Any:
    """Return a view (n,) of the fields that every task has, as compiled functions take it."""
    view = np.ndarray(array.shape, dtype, array, strides=array.strides)
    return named(view) if INTERPRETED else view


def common_row(parameters: Any) -> Any:
    """Return a view (1,) of the parameters that every task has, as compiled functions take it."""
    return common(parameters, _COMMON)


def columns(dtype: np.dtype[Any], has_yaw: bool, has_goal: bool) -> list[str]:
    """Return the names of an episode's float fields, in the column order of checkpoints of version 2.

    Digests of drawn scenarios use this order (`evaluation.protocol`).
    """
    left_out = _names([*_COUNTERS, *_STEP, *(() if has_yaw else _YAW), *(() if has_goal else _GOAL)])
    return [name for name in dtype.names or () if name not in left_out]


def from_version_2(array: Any, names: Sequence[str], state: Mapping[str, NDArray[Any]]) -> Any:
    """Write the columns `F` (n, floats) and `C` (n, integers) of a checkpoint of version 2 into episodes (n,).

    Returns:
        Remaining columns of `F`: previewed points (n, 3 k).

    Raises:
        ValueError: the number of columns is wrong.
    """
    floats, integers = state["F"], state["C"]
    at = 0
    for name in names:
        shape = array.dtype[name].shape
        width = math.prod(shape)
        array[name] = floats[:, at : at + width].reshape(-1, *shape)
        at += width
    for column, name in enumerate(_names(_COUNTERS)):
        array[name] = integers[:, column]
    return floats[:, at:]


def _table(n: int, fields: Fields, owner: str) -> Any:
    names = [field[0] for field in fields]
    for name in names:
        # numba refuses any attribute `view`.
        if not str(name).isidentifier() or str(name).startswith("_") or name == "view":
            raise AgentError(
                f"{owner}: {name} cannot be the name of a field; use a Python name other than view that does not begin with _"
            )
        if names.count(name) > 1:
            raise AgentError(f"{owner}: the field {name} occurs twice")
    try:
        dtype = np.dtype([tuple(field) for field in fields], align=True)
    except (TypeError, ValueError) as error:
        raise AgentError(
            f"{owner}: its fields must be (name, type) or (name, type, shape): {error}"
        ) from error
    return named(np.zeros(n, dtype))


def named(array: NDArray[Any]) -> Any:
    """Return a view of records whose fields are attributes."""
    return array.view(np.dtype((Row, array.dtype))).view(Table)


def _type(value: Any) -> str:
    kind = np.asarray(value).dtype.kind
    if kind not in "fiub":
        raise TypeError(f"not {value!r}")
    return "f8" if kind == "f" else "i8"


def _names(fields: Fields) -> list[str]:
    return [field[0] for field in fields]
