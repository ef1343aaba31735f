"""Keep vehicles away from solids and limits, by a control barrier function with the sheet's model (docs/safety.md)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from auvbench.config import schema
from auvbench.config.filters import Barrier
from auvbench.errors import ConfigError
from auvbench.observation import ObservationSpec
from auvbench.tasks.filters.echoes import Echoes
from auvbench.tasks.filters.rows import CHANGE, CHANGED, INFEASIBLE, MODEL, POINTS, protect
from auvbench.tasks.worlds.contact import HULL
from auvbench.vehicles.vehicle_model import VehicleModel
from auvbench.worlds.solids import NO_HEIGHTS, SOLID

if TYPE_CHECKING:
    from auvbench.tasks.base import Task

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

MOMENT = 10.0
"""Cost of changing the moment relative to the cost of changing forces; it is high so that a filter brakes without turning the vehicle"""
YAW = 5


class BarrierFilter:
    """Filter of the commands of N vehicles.

    Args:
        config: configuration with `filter=cbf`.
        vehicle: vehicle of all episodes.
        spec: specification of the observation.
        n: number of episodes.

    Raises:
        ConfigError: the vehicle cannot brake in every direction, or the observation has no rays that show echoes to the filter.
    """

    def __init__(
        self, config: schema.TrainConfig, vehicle: VehicleModel, spec: ObservationSpec, n: int
    ) -> None:
        settings = config.filter
        assert isinstance(settings, Barrier)
        self.echoes = Echoes(config, spec, n) if settings.knows == "ranges" else None
        """Echoes that show the solids to the filter; None if the filter knows the map"""
        water = _water(vehicle, settings.current)
        brake = settings.braking * braking(vehicle, water["push"], settings)
        limits = _thrust_limits(vehicle)
        strongest = np.abs(limits).max(axis=1)
        self.tallies: Floats = np.zeros((n, 3))
        """Tallies (n, 3) of the present episodes, with the columns CHANGED, CHANGE and INFEASIBLE of `rows`"""
        low, high = (limits / strongest[:, None]).T.copy()
        self.effect: Floats = vehicle.M_inverse @ vehicle.allocation * strongest
        moments = vehicle.allocation[3:] * strongest
        sizes = np.maximum(np.abs(moments).sum(axis=1), 1e-9)
        shares = moments / sizes[:, None]
        self.inverse: Floats = np.linalg.inv(np.eye(len(strongest)) + MOMENT * shares.T @ shares)
        self.curves = _force_curves(vehicle, strongest)
        model = np.zeros(1, MODEL)
        values = {
            "mass_inverse": vehicle.M_inverse,
            "momentum": vehicle.M_RB + vehicle.coriolis_sign * vehicle.M_A,
            "linear": vehicle.linear_damping,
            "quadratic": vehicle.quadratic_damping,
            "lift": vehicle.buoyancy - vehicle.weight,
            "righting": vehicle.buoyancy * vehicle.center_of_buoyancy
            - vehicle.weight * vehicle.center_of_gravity,
            "brake": brake,
            "horizon": _horizon(config, vehicle),
            "margin": settings.margin,
            "speed": math.inf if settings.speed is None else settings.speed,
            "tilt": math.inf if settings.tilt is None else settings.tilt,
            "turn_brake": 0.0
            if settings.tilt is None
            else settings.braking * turn_braking(vehicle, settings),
            "low": config.task.depth_low,
            "high": config.task.depth_high,
            "duration": 1.0 / config.step.frequency,
            **water,
        }
        for name, value in values.items():
            model[name] = value
        self.model = model.view(np.recarray)
        # `model` is passed as a plain array, because numba recognises this type thirty times as fast as a record array's type.
        self._own = model, self.effect, self.inverse, low, high, *self.curves

    def around(self, task: Task) -> tuple[Any, ...]:
        """Return the arguments that `rows.protect` takes from a task: steps, counts of solids, solids, heights and hull."""
        steps = np.asarray(task.episodes["steps"])
        if task.world is not None:
            solids, heights, hull = task.world.loops
            if self.echoes is not None:
                return steps, self.echoes.counts, self.echoes.solids, NO_HEIGHTS, hull.view(np.ndarray)
            return steps, np.asarray(task.episodes["solids"]), solids, heights, hull.view(np.ndarray)
        return steps, np.zeros(task.n, np.int64), np.zeros((task.n, 1), SOLID), NO_HEIGHTS, np.zeros(1, HULL)

    def begin(self, indices: Integers) -> None:
        """Clear the tallies and the echoes of new episodes."""
        self.tallies[indices] = 0.0
        if self.echoes is not None:
            self.echoes.forget(indices)

    def act(
        self,
        pose: Floats,
        velocity: Floats,
        action: Floats,
        observation: NDArray[np.float32],
        around: tuple[Any, ...],
        start: int,
        stop: int,
    ) -> None:
        """Change the commands (n, n_u) of the vehicles start .. stop - 1.

        Args:
            pose: (n, 7) measured poses.
            velocity: (n, 6) measured velocities.
            action: (n, n_u) commands in [-1, 1], which this method changes.
            observation: (n, n_obs) observations at the same time.
            around: result of `around`.
            start: index of the first vehicle.
            stop: index after the last vehicle.
        """
        if self.echoes is not None:
            self.echoes.see(pose, observation, around[0], start, stop)
        protect(start, stop, pose, velocity, action, *around, *self._own, self.tallies)

    def state(self) -> dict[str, NDArray[Any]]:
        """Return the arrays that an exact resume needs."""
        echoes = {} if self.echoes is None else {"filter.echoes": self.echoes.solids["position"]}
        return {"filter": self.tallies} | echoes

    def columns(self, i: int, steps: int) -> dict[str, float]:
        """Return the columns that the filter adds to the record of episode i, which has ended after `steps` steps."""
        tally = self.tallies[i] / max(steps, 1)
        return {
            "intervention_share": float(tally[CHANGED]),
            "command_change_mean": float(tally[CHANGE]),
            "infeasible_steps": int(self.tallies[i, INFEASIBLE]),
        }


def braking(vehicle: VehicleModel, push: Floats, settings: Barrier) -> float:
    """Return the deceleration in m/s2 that the thrusters guarantee in every direction, against net buoyancy and moving water.

    Along each axis, the deceleration follows from the largest force without a yaw moment. In other directions, it follows from the
    octahedron through the decelerations along the axes.

    Args:
        vehicle: vehicle of all episodes.
        push: (3,) m/s2, largest acceleration by moving water along each axis.
        settings: settings of the filter; error messages name their keys.

    Raises:
        ConfigError: the vehicle has actuators that are not thrusters, or cannot brake in every direction.
    """
    if vehicle.others:
        raise ConfigError(
            f"filter={settings.name}: needs a vehicle with only thrusters; vehicle={vehicle.name} also has {', '.join(vehicle.others)}; "
            "use filter=none"
        )
    rows = vehicle.allocation[[0, 1, 2, YAW]]
    if len(vehicle.units) < 4 or np.linalg.matrix_rank(rows, tol=1e-6) < 4:
        raise ConfigError(
            f"filter={settings.name}: vehicle={vehicle.name} cannot brake in every direction; use filter=none, or a vehicle with thrust "
            "along x, y, z and about z"
        )
    limits, inverse = _thrust_limits(vehicle), np.linalg.pinv(rows)
    lift = abs(vehicle.buoyancy - vehicle.weight)
    rates = np.empty(3)
    for axis in range(3):
        thrust = inverse[:, axis]
        reach = [
            np.min(
                np.where(side * thrust >= 0.0, limits[:, 1], -limits[:, 0]) / np.maximum(abs(thrust), 1e-9)
            )
            for side in (1.0, -1.0)
        ]
        # The net buoyancy may point along any axis of a tilted vehicle.
        rates[axis] = (min(reach) - lift) / vehicle.M[axis, axis] - push[axis]
    if rates.min() <= 0.0:
        raise ConfigError(
            f"filter.current={settings.current:g}: vehicle={vehicle.name} cannot brake against this current; reduce it, or use filter=none"
        )
    return float(1.0 / np.sqrt((1.0 / rates**2).sum()))


def turn_braking(vehicle: VehicleModel, settings: Barrier) -> float:
    """Return the angular deceleration in rad/s2 that the thrusters guarantee about each axis of the body's x-y plane.

    The thrusters give this deceleration without a force and without a moment about another axis.

    Raises:
        ConfigError: the thrusters do not control roll and pitch.
    """
    inverse = np.linalg.pinv(vehicle.allocation, rcond=1e-6)
    if np.diag(vehicle.allocation @ inverse).min() < 0.99:
        raise ConfigError(
            f"filter.tilt={settings.tilt:g}: vehicle={vehicle.name} does not control roll and pitch by its thrusters; use "
            "filter.tilt=null, or a vehicle with thrust along and about each axis"
        )
    # Each thruster can give the smaller of its two limits in both directions.
    strongest = np.abs(_thrust_limits(vehicle)).min(axis=1)
    reach = np.array([np.min(strongest / np.maximum(np.abs(inverse[:, axis]), 1e-9)) for axis in (3, 4)])
    rates = reach / np.diag(vehicle.M)[3:5]
    return float(1.0 / np.sqrt((1.0 / rates**2).sum()))


def _thrust_limits(vehicle: VehicleModel) -> Floats:
    """Return the smallest and the largest force of each thruster: (n_u, 2), N."""
    return np.sort(vehicle.force_limits, axis=1)


def _force_curves(vehicle: VehicleModel, strongest: Floats) -> tuple[Floats, Floats, Floats]:
    """Return `tables`, `first` and `last` of `rows.protect`: the rising part of each thruster's curve of force over command."""
    tables = np.empty((len(vehicle.units), POINTS))
    first, last = np.empty((2, len(vehicle.units)))
    for j, unit in enumerate(vehicle.units):
        first[j], last[j] = unit.command(np.array([-2.0, 2.0]) * strongest[j])
        tables[j] = unit.force(np.linspace(first[j], last[j], POINTS)) / strongest[j]
    return tables, first, last


def _water(vehicle: VehicleModel, current: float) -> dict[str, Floats]:
    """Return the largest accelerations that water moving at `current` m/s causes.

    Returns:
        `push` (3,): acceleration of a vehicle at rest; `drag` (3,): additional acceleration per m/s of the vehicle's speed.
    """
    mass = np.diag(vehicle.M)[:3]
    linear, quadratic = vehicle.linear_damping[:3], vehicle.quadratic_damping[:3]
    # |D(v + c) - D(v)| <= (D + 2 D_n |v| + D_n c) c
    return {
        "push": (linear + quadratic * current) * current / mass,
        "drag": 2.0 * quadratic * current / mass,
    }


def _horizon(config: schema.TrainConfig, vehicle: VehicleModel) -> float:
    """Return the time in s from a measurement to the thrusters' reaction: agent step, lag of the thrusters, and delays."""
    delay = config.disturbance.delay
    lag = max(unit.lag.delay for unit in vehicle.units)
    return float(1.0 / config.step.frequency + lag + delay.action + delay.observation)
