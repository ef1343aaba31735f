"""Control by a linear-quadratic regulator about the cruise state, with integral action.

The state is the velocity error (u, v, w), the yaw error, the yaw rate and the integral of the velocity error.
An error is the actual value minus the commanded value. The input is the wrench (X, Y, Z, N) minus the drag at the
commanded velocity. The plant is M nu' + C(nu) nu + D(nu) nu = tau with the sheet's values, linearised about
cruising ahead at `cruise_speed` (Fossen 2021, chapter 16). The gain comes from the discrete algebraic Riccati
equation for the agent's step. Guidance, allocation and limits are in `cascade.py`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm, solve_discrete_are

from auvbench.agents.base import Integers
from auvbench.agents.classical.cascade import CONTROLLED, Cascade
from auvbench.config import schema
from auvbench.config.algorithms.lqr import LQR
from auvbench.dynamics.rigid_body import GZ_SIM_8_11, coriolis, early
from auvbench.vehicles.vehicle_model import VehicleModel

Floats = NDArray[np.float64]


class LQRController(Cascade):
    """Linear-quadratic regulator of velocity and heading."""

    carried = ("integral",)

    def __init__(self, config: schema.TrainConfig, vehicle: VehicleModel) -> None:
        gains = config.algo
        assert isinstance(gains, LQR)
        super().__init__(config, vehicle)
        self.gain = lqr_gain(vehicle, gains, self.dt)

    def reset(self, episodes: Integers) -> None:
        super().reset(episodes)
        self.integral: Floats = np.zeros((len(episodes), 3))

    def law(self, wanted: Floats, velocity: Floats) -> Floats:
        now = self.estimate
        state = np.column_stack(
            [velocity - wanted, -now.yaw_error, now.yaw_rate - now.turning, self.integral]
        )
        wrench = np.zeros((len(wanted), 6))
        wrench[:, :3] = self._drag(wanted)
        # Add the terms of the product state by state: a matrix product may round differently for another batch size.
        for column, gains in enumerate(self.gain.T):
            wrench[:, CONTROLLED] -= state[:, column : column + 1] * gains
        return wrench

    def after(self, miss: Floats, scale: Floats) -> None:
        # Conditional integration: no wind-up while the thrusters are saturated.
        self.integral -= np.where((scale >= 1.0)[:, None], self.dt * miss, 0.0)


def lqr_gain(vehicle: VehicleModel, gains: LQR, dt: float) -> Floats:
    """Return the feedback gain K (4, 8).

    The wrench (X, Y, Z, N) in N and N m is -K times the state, in addition to the drag. The state has the errors of
    u, v and w, the yaw error, the error of the yaw rate, and the integrals of the velocity errors.
    """
    A, B = cruise_plant(vehicle, gains.cruise_speed)
    n, m = B.shape
    block = np.zeros((n + m, n + m))
    block[:n, :n], block[:n, n:] = A * dt, B * dt
    discrete = expm(block)
    F, G = discrete[:n, :n], discrete[:n, n:]
    # Bryson's rule: each weight is the inverse square of the deviation that costs 1.
    Q = np.diag(
        np.concatenate(
            [
                np.full(3, gains.velocity_error**-2.0),
                [gains.yaw_error**-2.0, gains.yaw_rate**-2.0],
                np.full(3, gains.integral_error**-2.0),
            ]
        )
    )
    most = np.abs(vehicle.allocation[CONTROLLED]) @ np.abs(vehicle.force_limits).max(axis=1)
    R = np.diag((gains.effort_share * most) ** -2.0)
    P = solve_discrete_are(F, G, Q, R)
    return np.asarray(np.linalg.solve(R + G.T @ P @ G, G.T @ P @ F))


def cruise_plant(vehicle: VehicleModel, speed: float) -> tuple[Floats, Floats]:
    """Return A (8, 8) and B (8, 4) of the plant, linearised about cruising ahead at `speed` in m/s. Roll and pitch are
    not states.
    """
    nu = np.array([speed, 0.0, 0.0, 0.0, 0.0, 0.0])
    damping = np.diag(vehicle.linear_damping + 2.0 * vehicle.quadratic_damping * np.abs(nu))
    matrices = [vehicle.M_RB]
    if vehicle.added_mass_coriolis:
        matrices.append(vehicle.coriolis_sign * vehicle.M_A)
    none = np.zeros(6)

    def forces(nu: Floats) -> Floats:
        own = sum((coriolis(M, nu) @ nu for M in matrices), none)
        return np.asarray(own - early(vehicle.M_A, nu) if vehicle.plugin == GZ_SIM_8_11 else own)

    slopes = np.zeros((6, 6))
    for column, step in enumerate(np.eye(6) * 1e-6):
        # C(nu) nu is quadratic in nu: the central difference is exact up to rounding.
        slopes[:, column] = (forces(nu + step) - forces(nu - step)) / 2e-6
    reduced = np.ix_(CONTROLLED, CONTROLLED)
    inverse = np.linalg.inv(vehicle.M[reduced])
    A, B = np.zeros((8, 8)), np.zeros((8, 4))
    velocity = [0, 1, 2, 4]
    A[np.ix_(velocity, velocity)] = -inverse @ (damping + slopes)[reduced]
    A[3, 4] = 1.0
    A[5:, :3] = np.eye(3)
    B[velocity] = inverse
    return A, B
