"""What a vehicle steers with besides thrusters: fins, a shifting mass, a buoyancy engine.

For a vehicle that goes where it points (a torpedo-shaped AUV): rudder by heading, elevator and mass
shifter by the slope of the path that leads to the waypoint, buoyancy engine by the depth that is missing. A drop
weight is never dropped. Moments of fins are those of attached flow from straight ahead; gains follow from the
vehicle's sheet.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from auvbench.vehicles.model import VehicleModel

Floats = NDArray[np.float64]

STEEPEST = 0.9  # rad of slope that is asked for
SLOWEST = 0.3  # m/s at which fins are taken to work at least: below it their angle would have no bound
CLOSE = 5.0  # m of distance over ground below which the slope is not made any steeper
SLACK = 2.0  # m that a path may miss the waypoint by, less than the radius within which it counts as reached


class Steering:
    """Commands for the actuators of `vehicle` that are no thrusters.

    Args:
        vehicle: with at least one such actuator.
        bandwidth: rad/s of the heading loop.
        dt: s between commands.
    """

    def __init__(self, vehicle: VehicleModel, bandwidth: float, dt: float) -> None:
        self.vehicle = vehicle
        self.bandwidth = bandwidth
        self.dt = dt
        lever = vehicle.buoyancy * vehicle.center_of_buoyancy - vehicle.weight * vehicle.center_of_gravity
        self.stiffness = float(lever[2])  # N m/rad of the restoring moment about level
        self.rudders = {i: m for i, m in self._fins(vehicle).items() if abs(m[2]) >= abs(m[1])}
        self.elevators = {i: m for i, m in self._fins(vehicle).items() if abs(m[2]) < abs(m[1])}
        self.radius = self._turning_radius()
        self.reset(0)

    def reset(self, n: int) -> None:
        self.shift: Floats = np.zeros((n, len(self.vehicle.units)))  # where rate-limited masses are by now, m

    @staticmethod
    def _fins(vehicle: VehicleModel) -> dict[int, Floats]:
        """Moment (3,) of each fin in N m per radian at 1 m/s ahead."""
        moments = {}
        for i, unit in enumerate(vehicle.units):
            if unit.kind == "fin":
                force = np.cross(unit.direction, [1.0, 0.0, 0.0])
                slope = 0.5 * vehicle.density * unit.parameters["area"] * unit.parameters["lift_slope"]
                moments[i] = slope * np.cross(unit.position, force)
        return moments

    def _turning_radius(self) -> float:
        """About twice the radius at which the fins' moment meets yaw damping: drift takes half of their angle."""
        moment = sum(
            abs(m[2]) * min(unit.curve.limits[1], unit.parameters["stall_angle"])
            for i, m in self.rudders.items()
            for unit in [self.vehicle.units[i]]
        )
        damping = self.vehicle.quadratic_damping[5]
        return float(2.0 * np.sqrt(damping / moment)) if moment > 0.0 and damping > 0.0 else 0.0

    def act(self, error: Floats, yaw_error: Floats, velocity: Floats) -> Floats:
        """Commands (n, n_u) from the way to the waypoint (n, 3), heading, and velocity (n, 3) in the world."""
        across = np.hypot(error[:, 0], error[:, 1])
        pace = np.hypot(velocity[:, 0], velocity[:, 1])
        speed = np.maximum(np.hypot(pace, velocity[:, 2]), SLOWEST)
        action = np.zeros((len(error), len(self.vehicle.units)))

        turn = self._reachable_turn(across, yaw_error)
        # No rate term: the hull damps the turn by itself, and a differentiated heading is mostly noise.
        moment = self.vehicle.M[5, 5] * self.bandwidth**2 * turn
        self._deflect(action, self.rudders, 2, moment, speed)

        slope = np.arctan2(error[:, 2], np.maximum(across, CLOSE))
        miss = slope - np.arctan2(velocity[:, 2], np.maximum(pace, SLOWEST))
        # A positive moment about y lowers the bow.
        moment = -self.stiffness * np.sin(np.clip(slope + miss, -STEEPEST, STEEPEST))
        moment = moment - self._shift_masses(action, 0.5 * moment)
        self._deflect(action, self.elevators, 1, moment, speed)

        for i, unit in enumerate(self.vehicle.units):
            if unit.kind == "buoyancy_engine":
                action[:, i] = np.clip(error[:, 2] / CLOSE, -1.0, 1.0)
        return action

    def _reachable_turn(self, across: Floats, yaw_error: Floats) -> Floats:
        """The heading error to steer by: none while the waypoint lies within the circle of the tightest turn."""
        ahead, aside = across * np.cos(yaw_error), across * np.abs(np.sin(yaw_error))
        inside = np.hypot(ahead, aside - self.radius) < self.radius - SLACK
        return np.asarray(np.where(inside, 0.0, yaw_error))

    def _deflect(
        self, action: Floats, fins: dict[int, Floats], axis: int, moment: Floats, speed: Floats
    ) -> None:
        """Share `moment` (n,) about `axis` among `fins`."""
        for i, per_radian in fins.items():
            unit = self.vehicle.units[i]
            angle = moment / (len(fins) * per_radian[axis] * speed**2)
            action[:, i] = unit.curve.inverse(angle)

    def _shift_masses(self, action: Floats, moment: Floats) -> Floats:
        """Ask the mass shifters for `moment` (n,) about y; returns what they give by now."""
        given = np.zeros(len(moment))
        for i, unit in enumerate(self.vehicle.units):
            if unit.kind != "mass_shifter":
                continue
            per_metre = unit.parameters["mass"] * self.vehicle.gravity * unit.direction[0]
            wanted = np.clip(moment / per_metre, *unit.curve.limits)
            reach = unit.rate * self.dt
            self.shift[:, i] += np.clip(wanted - self.shift[:, i], -reach, reach)
            action[:, i] = unit.curve.inverse(wanted)
            given += per_metre * self.shift[:, i]
        return given
