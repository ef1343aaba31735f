"""Base class of disturbances: functions for one episode, a state in each episode, and calls of the simulator.

A disturbance is one file of this folder or of a package. The file declares functions for one episode, which are compiled into loops, and
the disturbance's state, one record per episode. An exact resume needs the whole state. `composed.Disturbances` calls the active
disturbances.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from auvbench.config.disturbances import asking
from auvbench.dynamics.layout import CURRENT
from auvbench.errors import AgentError
from auvbench.registry import DISTURBANCES, owned, resolve, telling
from auvbench.simulators.base import Simulator
from auvbench.tasks import records
from auvbench.tasks.disturbances import loops

if TYPE_CHECKING:
    from collections.abc import Callable

    from auvbench.config import schema
    from auvbench.tasks.base import Task
    from auvbench.vehicles.vehicle_model import VehicleModel

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Array = NDArray[Any]


def kind_of(name: str) -> type[Disturbance]:
    """Return the class of a disturbance.

    Raises:
        AgentError: the class of a package is not a Disturbance.
    """
    if name in DISTURBANCES.own:
        kind: type[Disturbance] = resolve(DISTURBANCES[name].code)
        return kind
    who = f"disturbance.{name}"
    with telling(who, "cannot be imported"):
        kind = resolve(DISTURBANCES[name].code)
    if not (isinstance(kind, type) and issubclass(kind, Disturbance)):
        raise AgentError(
            f"{who}: {DISTURBANCES[name].code} is not a subclass of {Disturbance.__module__}.Disturbance"
        )
    return kind


def water_speed(disturbance: schema.Disturbance, vehicle: VehicleModel) -> tuple[float, float]:
    """Return the largest mean speed of the water and the standard deviation of its fluctuation, both in m/s."""
    water = [_asked(name, "water_speed", settings, vehicle) for name, settings in disturbance.active()]
    return sum(mean for mean, _ in water), math.hypot(*(spread for _, spread in water))


def misreading(disturbance: schema.Disturbance, seconds: float) -> Floats:
    """Return an upper bound (3,) in m on the standard deviation of position readings after `seconds`: a sum over disturbances."""
    errors = np.zeros(3)
    for name, settings in disturbance.active():
        errors += _asked(name, "misreading", settings, seconds)
    return errors


def extreme(vehicle: VehicleModel, disturbance: schema.Disturbance, damping: float) -> VehicleModel:
    """Return the most extreme vehicle that the active disturbances may draw (`Disturbance.extreme`)."""
    for name, settings in disturbance.active():
        vehicle = kind_of(name).extreme(settings, vehicle, damping)
    return vehicle


_SIZES = {"water_speed": 2, "misreading": 3}
"""Number of values that each static method returns"""


def _asked(name: str, method: str, settings: Any, *arguments: Any) -> Any:
    """Return the numbers from a static method of a disturbance; raise AgentError for a wrong count or a number that is not finite."""
    kind, size = kind_of(name), _SIZES[method]
    with asking(name, settings, method):
        given = np.asarray(getattr(kind, method)(settings, *arguments), dtype=np.float64)
    if given.shape != (size,) or not np.isfinite(given).all():
        who = owned(f"disturbance.{name}", settings)
        raise AgentError(f"{who}: {method} returned {given}; it must return {size} finite numbers")
    return given


class Disturbance:
    """One disturbance of N episodes.

    In the functions of a disturbance, `e` is the record of an episode (the fields that every task has), `d` the disturbance's state in
    this episode, and `p` the disturbance's parameters. `stream` is the flag of the random streams: draw by
    `uniform4(e.seed, OWN | stream, ...)`.

    Args:
        settings: configuration, with the schema of the disturbance's spec.
        vehicle: vehicle of all episodes.
        task: task of the episodes.
        who: name of the disturbance for messages.
    """

    draw: ClassVar[Callable[..., None]]
    """`draw(e, d, p, stream)`: begins an episode; before the call, all fields of d are 0"""
    before: ClassVar[Callable[..., None]]
    """`before(e, d, p, stream)`: called before each agent step; `e.steps` is the number of completed steps"""
    act: ClassVar[Callable[..., None]]
    """`act(e, d, p, command, effectiveness)`: changes the commands (n_u,) in [-1, 1] that act now, and the effectiveness (n_u,): the
    fraction of the commanded force that each thruster gives"""
    push: ClassVar[Callable[..., None]]
    """`push(e, d, p, v, w, duration, wrench)`: adds force (N) and moment (N m), body axes, to `wrench` (6,). Force and moment act on the
    vehicle `v` in the current `w` (`rows.current_at`) for the next `duration` s. The `needs` of the disturbance's schema must
    yield `forces`"""
    read: ClassVar[Callable[..., None]]
    """`read(e, d, p, stream, offset)`: adds this disturbance's errors to `offset` (4,), the errors of the position (m) and yaw (rad)
    readings. Called at the start of an episode (`e.steps == 0`) and after each agent step"""
    fields: ClassVar[tuple[tuple[Any, ...], ...]] = ()
    """Fields of the state in each episode: (name, type) or (name, type, shape)"""
    longest: ClassVar[float] = math.inf
    """Largest `duration` of a push, s"""
    runs_on: ClassVar[bool] = False
    """Whether the simulator advances the disturbance by itself after `give`"""

    def __init__(self, settings: Any, vehicle: VehicleModel, task: Task, who: str) -> None:
        self.settings, self.vehicle, self.task, self.who = settings, vehicle, task, who
        records.check_names(settings, who)
        shared = {name: task.parameters[name][0] for name in records.PARAMETERS}
        self.parameters = records.one_row(self.own_parameters(settings), shared, who)
        """Parameters (1,) of the disturbance"""
        self.state = records.state(task.n, self.fields, who)
        """State (n,) of the disturbance in each episode"""
        self.moves = hasattr(self, "before")
        """Whether the disturbance changes during an episode; if so, `before` and `give` are called before each agent step"""
        self.rereads = hasattr(self, "read")
        """Whether the disturbance changes the errors of the readings from step to step"""
        self._interpreted = False
        self._take()

    def own_parameters(self, settings: Any) -> dict[str, Any]:
        """Return the disturbance's parameters by name: numbers, or lists of numbers."""
        return records.of_schema(settings)

    @staticmethod
    def check(settings: Any, vehicle: VehicleModel) -> None:
        """Check the settings against a vehicle before a run.

        Raises:
            ConfigError: the vehicle does not fit the disturbance.
        """

    @staticmethod
    def water_speed(settings: Any, vehicle: VehicleModel) -> tuple[float, float]:
        """Return the largest mean speed of the water and the standard deviation of its fluctuation, both in m/s."""
        return 0.0, 0.0

    @staticmethod
    def misreading(settings: Any, seconds: float) -> Floats:
        """Return the standard deviation (3,) in m of the position readings' errors, `seconds` after the start of an episode."""
        return np.zeros(3)

    @staticmethod
    def extreme(settings: Any, vehicle: VehicleModel, damping: float) -> VehicleModel:
        """Return a vehicle with the most thrust and the most (`damping` = 1) or least (-1) damping that the disturbance may draw.

        A disturbance that does not draw vehicles returns `vehicle`.
        """
        return vehicle

    def give(self, simulator: Simulator) -> None:
        """Pass the disturbance's state to the simulator.

        Called at the start of episodes and, if the disturbance `moves`, before each agent step.
        """

    def scales(self, indices: Integers) -> Floats | None:
        """Return factors (k, 6) on properties of new episodes' vehicles (`Simulator.reset`); None: use the sheet's vehicle."""
        return None

    def interpret(self) -> None:
        """From now on, run the disturbance's functions as Python, which checks each index."""
        self._interpreted = True
        self._take()

    def _take(self) -> None:
        names = ("draw", "before", "act", "push", "read")
        functions = tuple((name, getattr(type(self), name)) for name in names if hasattr(type(self), name))
        self.loops = loops.of_disturbance(functions, self.fields, self._interpreted)
        tables = self.state, self.parameters
        state, parameters = tables if self._interpreted else map(records.plain, tables)
        self._own = state, parameters
        self.field = {name: np.asarray(self.state[name]) for name, *_ in self.fields}
        """Views (n, ...) of the fields of `state`, which Python reads faster than attributes of records"""

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without the attributes that `__setstate__` creates: NumPy would copy a view as a separate array."""
        return {
            name: value for name, value in self.__dict__.items() if name not in ("loops", "_own", "field")
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._take()

    @property
    def _rows(self) -> Any:
        """The episodes (n,), as the loops take them."""
        return self.task.episodes if self._interpreted else self.task.rows

    def draw_rows(self, indices: Integers) -> None:
        """Draw the state of new episodes."""
        if loop := self.loops.get("draw"):
            loop(indices, self._rows, *self._own, self.task.stream)

    def before_rows(self) -> None:
        """Advance the state to the next agent step."""
        if loop := self.loops.get("before"):
            loop(self._rows, *self._own, self.task.stream)

    def act_rows(self, command: Floats, effectiveness: Floats) -> None:
        """Change commands (n, n_u) and the effectiveness (n, n_u) of thrusters."""
        self.loops["act"](self._rows, *self._own, command, effectiveness)

    def push_rows(self, simulator: Any, command: Floats, duration: float) -> None:
        """Add this disturbance's forces to the forces on the simulator's vehicles."""
        force, power = simulator.command_force, simulator.power
        motion = simulator.pose, simulator.velocity, command, self.task.previous, force, power
        water = simulator.current.view(CURRENT)[:, 0]
        water = records.named(water) if self._interpreted else water
        self.loops["push"](self._rows, *self._own, *motion, water, duration, simulator.external_wrench)

    def read_rows(self, indices: Integers) -> None:
        """Add this disturbance's errors to the errors of the readings in some episodes."""
        self.loops["read"](indices, self._rows, *self._own, self.task.stream, self.task.offset)

    def arrays(self) -> dict[str, Array]:
        """Return the arrays that an exact resume needs."""
        return {"state": records.bare(self.state)} if self.fields else {}

    def restored(self) -> None:
        """Recompute values that depend on episodes and arrays. Called after episodes and arrays were restored."""

    def clear(self) -> None:
        """Set the state of all episodes to 0."""
        for array in self.arrays().values():
            array[...] = np.zeros((), array.dtype)

    def load(self, state: Mapping[str, Array]) -> None:
        """Restore the arrays of `arrays` by their names."""
        for name, array in self.arrays().items():
            np.copyto(array, state[name], casting="no")
