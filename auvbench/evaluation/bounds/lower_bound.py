"""Compute a proven lower bound of the time to the goal from the energy that the thrusters can supply.

Let d be the distance to the edge of the goal, e the unit vector towards it in body axes, v the velocity, nu =
(v, omega), f the thrusts, B the allocation, and D(nu) = sum_i d_i nu_i^2 + q_i |nu_i|^3 the power of damping.
Coriolis forces do no work, and weight and buoyancy have a potential V. With the kinetic energy K of the body and
its added mass,

    d/dt (K + V) = nu' B f - D(nu).

For every a >= 0, the speed towards the goal e.v is then at most c(a) - a d/dt (K + V) with

    c(a) = max over f within its limits, |e| = 1 and nu of   e.v + a (nu' B f - D(nu)),

Integrating from rest over the duration T, with K = 0 at the start and K >= 0 at the end, gives
d <= c(a) T + a (V(start) - V(end)), and so

    T >= (d - a (V(start) - V(end))) / c(a).

The bound is the largest of these values over several values of a. It is not sharp, because c(a) allows the
vehicle to have any attitude and velocity at any time. It holds for the exact equations of motion; the simulator
integrates them in steps of some milliseconds.
"""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from auvbench.dynamics.rigid_body import GZ_SIM_8_11
from auvbench.evaluation.bounds.command_replay import Scenario
from auvbench.vehicles.actuators import Actuator, Thruster
from auvbench.vehicles.vehicle_model import VehicleModel

Floats = NDArray[np.float64]

PRICES = np.geomspace(5e-4, 5e-2, 17)
"""values of a for which the bound is computed, m/J"""
CLOSE = 3e-3
"""relative accuracy of the computed c(a), which is never below the exact c(a)"""
HALVINGS = 9
"""largest number of halvings of the cells of directions; fewer halvings give a weaker but valid bound"""
MOST_THRUSTERS = 12
"""largest number of thrusters for which a bound is computed; the box of possible thrusts then has 2^12 corners"""


class Energy:
    """Lower bound of the time to the goal for one vehicle."""

    def __init__(self, vehicle: VehicleModel, radius: float) -> None:
        self.radius = radius
        self.lift = vehicle.buoyancy - vehicle.weight  # N
        lever = vehicle.buoyancy * vehicle.center_of_buoyancy - vehicle.weight * vehicle.center_of_gravity
        # Largest energy in J that the restoring moment can supply, from level to the attitude of lowest potential.
        self.righting = float(np.linalg.norm(lever) - lever[2])
        self.pace = np.array([np.inf] * len(PRICES))
        limits = [_reached(*pair) for pair in zip(vehicle.units, vehicle.force_limits, strict=True)]
        passive = vehicle.plugin != GZ_SIM_8_11  # No bound for this plug-in: its Coriolis term does work.
        if passive and len(limits) <= MOST_THRUSTERS and np.isfinite(limits).all():
            corners = np.array(list(itertools.product(*limits)))
            wrenches = corners @ vehicle.allocation.T
            damping = vehicle.linear_damping, vehicle.quadratic_damping
            self.pace = np.array([_fastest(wrenches, *damping, a) for a in PRICES.tolist()])

    def seconds(self, scenario: Scenario) -> float:
        """Return a lower bound of the duration of every trajectory into the goal, s; 0 if no bound is known."""
        line = scenario.waypoint - scenario.pose[:3]
        distance = max(float(np.linalg.norm(line)) - self.radius, 0.0)
        # The trajectory may end anywhere in the goal: use the point at which buoyancy and weight have supplied most energy.
        rise = line[2] + np.sign(self.lift) * self.radius
        gained = self.lift * rise + self.righting
        return float(max(0.0, np.max((distance - PRICES * gained) / self.pace)))

    def steps(self, scenario: Scenario, frequency: float) -> int:
        """Return the bound in whole agent steps; it is at least 1, because the task checks the arrival after a step."""
        return max(1, int(np.ceil(self.seconds(scenario) * frequency - 1e-9)))


def _reached(unit: Actuator, limits: Floats) -> tuple[float, float]:
    """Return the range of thrust in N, including the overshoot of the actuator's lag; infinite if the overshoot is unknown.

    Let g be the impulse response, P = int max(g, 0) dt its positive part and N = int max(-g, 0) dt = P - 1 its
    negative part. An input in [l, h], which contains 0, then gives an output in [P l - N h, P h - N l].
    """
    low, high = float(min(limits)), float(max(limits))
    if unit.lag.order <= 1:
        return min(low, 0.0), max(high, 0.0)
    poles, modes = np.linalg.eig(unit.lag.A)
    if not isinstance(unit, Thruster) or unit.rotor_constant != 0.0 or (poles.real >= 0.0).any():
        return -np.inf, np.inf
    weights = (unit.lag.C @ modes) * np.linalg.solve(modes, unit.lag.B.astype(complex))
    t = np.linspace(0.0, 40.0 / float(np.abs(poles.real).min()), 200_001)
    g = np.real(np.exp(np.outer(t, poles)) @ weights)
    N = 1.001 * float(np.trapezoid(np.maximum(-g, 0.0), t)) + 1e-6
    return (1.0 + N) * min(low, 0.0) - N * max(high, 0.0), (1.0 + N) * max(high, 0.0) - N * min(low, 0.0)


def _fastest(wrenches: Floats, linear: Floats, quadratic: Floats, a: float) -> float:
    """Return an upper bound of c(a), by branch and bound over directions e.

    Damping is symmetric, so only the absolute values of e and of the forces matter, and the search covers one
    octant of directions.

    Args:
        wrenches: (n, 6) wrenches in N and N m at the corners of the thrusters' limits.
        linear: (6,) coefficients d_i.
        quadratic: (6,) coefficients q_i.
        a: value of a, m/J.
    """
    turning = _gain(a * np.abs(wrenches[:, 3:]), linear[3:], quadratic[3:], a)[0].sum(axis=1)
    corners = _undominated(np.column_stack([a * np.abs(wrenches[:, :3]), turning]))
    forces, turning = corners[:, :3], corners[:, 3]
    if not np.isfinite(turning).all():
        return np.inf
    half = 0.25 * np.pi  # half the width of a cell of elevation and azimuth
    cells = np.array([[half, half]])
    best, above = 0.0, np.array([np.inf])
    for _ in range(HALVINGS):
        elevation, azimuth = cells.T
        flat = np.cos(elevation)
        e = np.column_stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])
        gains = _gain(e[:, None] + forces, linear[:3], quadratic[:3], a)[0]
        value = (gains.sum(axis=2) + turning).max(axis=1)
        best = max(best, float(value.max()))
        # Within a cell, e changes by at most `reach`. The value then changes by at most `reach` times the optimal velocity.
        reach = np.sqrt(2.0) * half
        speeds = _gain(np.minimum(e + reach, 1.0)[:, None] + forces, linear[:3], quadratic[:3], a)[1]
        above = value + reach * np.linalg.norm(speeds, axis=2).max(axis=1)
        if not above.max() > best * (1.0 + CLOSE):
            break
        half *= 0.5
        candidates = cells[above > best]
        cells = np.concatenate(
            [candidates + half * np.array(corner) for corner in itertools.product((-1, 1), repeat=2)]
        )
    return float(above.max()) if np.isfinite(above).all() else np.inf


def _undominated(rows: Floats) -> Floats:
    """Return the rows without duplicates, and without each row that another row equals or exceeds in every column."""
    best: list[Floats] = []
    for row in np.unique(np.round(rows, 12), axis=0)[::-1]:
        if not any(np.all(other >= row) for other in best):
            best = [other for other in best if not np.all(row >= other)]
            best.append(row)
    return np.array(best)


def _gain(force: Floats, linear: Floats, quadratic: Floats, a: float) -> tuple[Floats, Floats]:
    """Maximize force * x - a * (linear * x^2 + quadratic * x^3) over x >= 0 for each axis; return the maximum and its x."""
    A = force / a
    root = 2.0 * linear + np.sqrt(4.0 * linear**2 + 12.0 * quadratic * A)
    with np.errstate(divide="ignore", invalid="ignore"):
        x = np.where(A > 0.0, 2.0 * A / root, 0.0)
        gain = np.where(np.isfinite(x), a * (A * x - linear * x**2 - quadratic * x**3), np.inf)
    return gain, x
