"""The active disturbances of N episodes, as the batch of environments calls them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from auvbench.config import schema
from auvbench.config.disturbances import DisturbanceConfig, asking
from auvbench.simulators.base import Simulator
from auvbench.tasks.disturbances.base import Disturbance, kind_of
from auvbench.tasks.disturbances.delay import DeadTime

if TYPE_CHECKING:
    from auvbench.tasks.base import Task
    from auvbench.vehicles.vehicle_model import VehicleModel

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


def make(config: schema.TrainConfig, vehicle: VehicleModel, task: Task) -> Disturbances | None:
    """Return the disturbances of a configuration; None if no disturbance is active."""
    disturbances = of(config, vehicle, task)
    return disturbances if disturbances.parts else None


def of(config: schema.TrainConfig, vehicle: VehicleModel, task: Task) -> Disturbances:
    """Return the disturbances of a configuration, even if no disturbance is active."""
    return Disturbances(dict(_parts(config, vehicle, task)), task)


def _parts(
    config: schema.TrainConfig, vehicle: VehicleModel, task: Task
) -> Iterator[tuple[str, Disturbance]]:
    for name, settings in config.disturbance.active():
        if isinstance(settings, DisturbanceConfig):
            from auvbench.tasks.disturbances import installed

            yield name, installed.make(name, settings, vehicle, task)
        else:
            yield name, kind_of(name)(settings, vehicle, task, f"disturbance.{name}")


def check(config: schema.TrainConfig, vehicle: VehicleModel) -> None:
    """Check disturbances against the vehicle before a run is created.

    Raises:
        ConfigError: the vehicle does not fit a disturbance; inactive disturbances are checked too.
    """
    for name, settings in config.disturbance.factors():
        kind = kind_of(name)
        with asking(name, settings, "check"):
            kind.check(settings, vehicle)


class Disturbances:
    """The disturbances of N episodes, which act one after the other.

    Order of calls when episodes begin: `draw`, the simulator's reset, `begin`. Order in each agent step: `advance` in
    place of the simulator's step, then `read` before the task observes.

    Args:
        parts: active disturbances, by name.
        task: task of the episodes.
    """

    def __init__(self, parts: Mapping[str, Disturbance], task: Task) -> None:
        self.task = task
        self.parts = dict(parts)
        every = list(parts.values())
        self._moving = [part for part in every if part.moves]
        self._acting = [part for part in every if hasattr(part, "act")]
        self._pushing = [part for part in every if hasattr(part, "push")]
        self._reading = [part for part in every if hasattr(part, "read")]
        self._longest = min((part.longest for part in self._pushing), default=math.inf)
        self._rereads = any(part.rereads for part in self._reading)
        self._delay = next((part for part in every if isinstance(part, DeadTime)), None)
        self._all = np.arange(task.n)
        self.power: Floats = np.zeros(task.n)
        """(n,) W, mean electrical power over the last agent step"""

    def __getitem__(self, name: str) -> Any:
        """Return an active disturbance by its name."""
        return self.parts[name]

    def draw(self, indices: Integers) -> Floats | None:
        """Draw the disturbances of new episodes; return the factors (k, 6) on their vehicles, or None (`Disturbance.scales`)."""
        product = None
        for part in self.parts.values():
            part.draw_rows(indices)
            scales = part.scales(indices)
            if scales is not None:
                product = scales if product is None else product * scales
        return product

    def begin(self, indices: Integers, simulator: Simulator) -> None:
        """Give the simulator the drawn disturbances; set delays, power and the errors of the first readings of new episodes."""
        for part in self.parts.values():
            part.give(simulator)
        if self._delay is not None:
            self._delay.begin(indices, simulator)
        self.power[indices] = 0.0
        self._read(indices)

    def advance(self, simulator: Simulator, command: Floats) -> None:
        """Advance the simulator by one agent step under `command` (n, n_u), with delays and faults."""
        self.before(simulator)
        if self._delay is not None:
            self._delay.carry(simulator, command, self.power, self._step)
            return
        self._step(simulator, command, self.task.duration)
        self.power[:] = simulator.power

    def _step(self, simulator: Simulator, command: Floats, duration: float) -> None:
        """Let a command act for `duration` s: an agent step or a part of a step."""
        self.act(simulator, command)
        if not self._pushing:
            simulator.step(command, duration)
            return
        pushed: Any = simulator  # a configuration with forces always has a simulator with `external_wrench`
        # The margin avoids an extra part where rounding makes the quotient slightly larger than a whole number.
        count = max(1, math.ceil(duration / self._longest - 1e-9))
        for _ in range(count):
            pushed.external_wrench[:] = 0.0
            self.push(simulator, command, duration / count)
            simulator.step(command, duration / count)

    def before(self, simulator: Simulator, *, running: bool = False) -> None:
        """Advance the disturbances to the next agent step.

        Args:
            simulator: simulator that gets the changes.
            running: whether to skip the disturbances that the simulator advances by itself (`Disturbance.runs_on`).
        """
        for part in self._moving:
            if not (running and part.runs_on):
                part.before_rows()
                part.give(simulator)

    def act(self, simulator: Simulator, command: Floats) -> None:
        """Let each disturbance with `act` change `command` (n, n_u) and the effectiveness of the simulator's thrusters."""
        for part in self._acting:
            part.act_rows(command, simulator.effectiveness)

    def push(self, simulator: Simulator, command: Floats, duration: float) -> None:
        """Add the forces of the next `duration` s to the simulator's `external_wrench`."""
        for part in self._pushing:
            part.push_rows(simulator, command, duration)

    def read(self) -> None:
        """Renew the errors of the readings after an agent step."""
        if self._rereads:
            self.task.offset[:] = 0.0
            self._read(self._all)

    def _read(self, indices: Integers) -> None:
        for part in self._reading:
            part.read_rows(indices)

    def measured(self, simulator: Simulator) -> tuple[Floats, Floats]:
        """Return the poses (n, 7) and velocities (n, 6) that arrive now, without the errors of the readings."""
        if self._delay is None:
            return simulator.pose, simulator.velocity
        return self._delay.measured(simulator)

    def clear(self) -> None:
        """Set the state of all disturbances to 0."""
        for part in self.parts.values():
            part.clear()

    def interpret(self) -> None:
        """From now on, run the functions of all disturbances as Python."""
        for part in self.parts.values():
            part.interpret()

    def state_dict(self) -> dict[str, NDArray[Any]]:
        """Return copies of the state that an exact resume needs in addition to the states of task and simulator."""
        arrays = {
            f"{name}.{key}": array
            for name, part in self.parts.items()
            for key, array in part.arrays().items()
        }
        return {key: np.copy(array) for key, array in {"power": self.power, **arrays}.items()}

    def load_state_dict(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Restore a state of `state_dict` or of a checkpoint of version 2. Restore the task's state first."""
        np.copyto(self.power, state["power"], casting="no")
        for name, part in self.parts.items():
            if "D" in state:
                from auvbench.tasks.disturbances import version_2  # few checkpoints are so old

                version_2.load(name, part, state)
            else:
                prefix = f"{name}."
                own = {k.removeprefix(prefix): v for k, v in state.items() if k.startswith(prefix)}
                part.load(own)
            part.restored()
