"""Check the results of disturbances from installed packages before auvbench uses these results."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from auvbench.config.disturbances import DisturbanceConfig, forces
from auvbench.config.schema import SCALES
from auvbench.errors import AgentError
from auvbench.registry import owned
from auvbench.tasks.base import Task
from auvbench.tasks.disturbances.base import Disturbance, kind_of
from auvbench.tasks.installed import telling
from auvbench.vehicles.vehicle_model import VehicleModel

SHORTEST = 1e-4
"""Smallest allowed value of `Disturbance.longest`, s"""

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


def make(name: str, settings: DisturbanceConfig, vehicle: VehicleModel, task: Task) -> Disturbance:
    """Return the disturbance of a package.

    Raises:
        AgentError: the disturbance cannot be created.
    """
    who = owned(f"disturbance.{name}", settings)
    kind = kind_of(name)
    with telling(who, "cannot be made"):
        part = kind(settings, vehicle, task, who)
    _check_made(part, settings, who)
    return cast(Disturbance, Checked(part, who))


def _check_made(part: Disturbance, settings: DisturbanceConfig, who: str) -> None:
    if not hasattr(part, "field"):
        raise AgentError(
            f"{who}: its __init__ must call the __init__ of {Disturbance.__module__}.Disturbance"
        )
    if not isinstance(part.longest, float) or not part.longest >= SHORTEST:
        raise AgentError(f"{who}: longest is {part.longest!r}; it must be a float of at least {SHORTEST:g} s")
    if hasattr(part, "push") and forces("").what not in {need.what for need in settings.needs("")}:
        raise AgentError(
            f"{who}: has push, so the needs of its schema must yield auvbench.plugin.forces(key)"
        )


def _told(name: str) -> Callable[..., Any]:
    """Return a method that calls the disturbance's method `name` and turns exceptions into errors that name the disturbance."""

    def call(self: Checked, *arguments: Any) -> Any:
        with telling(self.who, f"{name} fails"):
            return getattr(self.part, name)(*arguments)

    return call


class Checked:
    """Wrapper of a disturbance: an exception, or a number that is not finite, raises an AgentError that names the disturbance.

    Args:
        part: the disturbance.
        who: name and package of the disturbance, for messages.
    """

    give, arrays, load, restored, clear = map(_told, ("give", "arrays", "load", "restored", "clear"))

    def __init__(self, part: Disturbance, who: str) -> None:
        self.part, self.who = part, who

    def __getattr__(self, name: str) -> Any:
        if name in ("part", "who"):  # copy and pickle look up attributes before these two are set
            raise AttributeError(name)
        return getattr(self.part, name)

    def draw_rows(self, indices: Integers) -> None:
        with telling(self.who, "draw fails"):
            self.part.draw_rows(indices)
        self._check_state("draw")

    def before_rows(self) -> None:
        with telling(self.who, "before fails"):
            self.part.before_rows()
        self._check_state("before")

    def scales(self, indices: Integers) -> Floats | None:
        with telling(self.who, "scales fails"):
            scales = self.part.scales(indices)
        if scales is None:
            return None
        if np.shape(scales) != (len(indices), len(SCALES)):
            raise AgentError(
                f"{self.who}: scales returned an array of shape {np.shape(scales)}; the shape must be {(len(indices), len(SCALES))}"
            )
        self._check("scales gives factors", scales)
        return scales

    def act_rows(self, command: Floats, effectiveness: Floats) -> None:
        with telling(self.who, "act fails"):
            self.part.act_rows(command, effectiveness)
        self._check("act writes commands", command)
        self._check("act writes effectiveness", effectiveness)
        self._check_state("act")

    def push_rows(self, simulator: Any, command: Floats, duration: float) -> None:
        with telling(self.who, "push fails"):
            self.part.push_rows(simulator, command, duration)
        self._check("push writes forces", simulator.external_wrench)
        self._check_state("push")

    def read_rows(self, indices: Integers) -> None:
        with telling(self.who, "read fails"):
            self.part.read_rows(indices)
        self._check("read writes errors", self.part.task.offset)
        self._check_state("read")

    def _check_state(self, function: str) -> None:
        for name, values in self.part.field.items():
            if values.dtype.kind == "f":
                self._check(f"{function} writes {name}", values)

    def _check(self, what: str, values: NDArray[Any]) -> None:
        finite = np.isfinite(values)
        if finite.all():
            return
        row = int(np.argmin(finite.reshape(len(values), -1).all(axis=1)))
        raise AgentError(f"{self.who}: {what} that are not finite, in environment {row}")
