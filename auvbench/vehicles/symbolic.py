"""Build the equations of `dynamics/equations.py` as CasADi expressions from a vehicle's sheet.

The expressions are for methods that need derivatives of the motion: model predictive control and time-optimal bounds.
The unit tests compare a step of these equations with a step of the compiled kernel, for every vehicle with only
thrusters.

State (13 + n_a): x y z (m, world ENU), qw qx qy qz (body to world), u v w p q r (m/s, rad/s, body FLU), then
the states of the thrusters' lags in the order of the actuators. Input (n_u): steady thrusts in N, even for a
thruster with a rotor, since the rotor's speed as a function of thrust has no finite slope at rest. A lag of
higher order is replaced by a first-order lag of the thrust with the same mean delay. The current is constant in the
world, (3,) m/s.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.dynamics.rigid_body import GZ_SIM_8_11, surge_and_yaw
from auvbench.errors import ConfigError, MissingExtraError
from auvbench.vehicles.curves import Lag
from auvbench.vehicles.inspect import shortest_time_constant
from auvbench.vehicles.vehicle_model import VehicleModel

FloatArray = NDArray[np.float64]

RIGID = 13
"""Number of states before the states of the actuators."""


def require() -> Any:
    """Return the CasADi module.

    Raises:
        MissingExtraError: CasADi is not installed.
    """
    try:
        import casadi
    except ImportError as error:
        raise MissingExtraError(
            "casadi", extra="mpc", purpose="model predictive control and time-optimal bounds"
        ) from error
    return casadi


class Direct:
    """A CasADi function of dense arrays, called without CasADi's conversion of arguments and results. The conversion takes
    longer than the evaluation of a small function.

    A call returns new arrays. Only one thread at a time may call an instance.
    """

    def __init__(self, function: Any) -> None:
        self._buffer, self._evaluate = function.buffer()
        self._arguments, self._results = [], []
        for number in range(function.n_in()):
            place = np.zeros(function.nnz_in(number))
            self._buffer.set_arg(number, place.data)
            self._arguments.append(place.reshape(function.size_in(number), order="F"))
        for number in range(function.n_out()):
            place = np.zeros(function.nnz_out(number))
            self._buffer.set_res(number, place.data)
            self._results.append(place.reshape(function.size_out(number), order="F"))

    def __call__(self, *arguments: FloatArray) -> tuple[FloatArray, ...]:
        for place, argument in zip(self._arguments, arguments, strict=True):
            place[:] = argument
        self._evaluate()
        return tuple(place.copy() for place in self._results)


@dataclass(frozen=True, slots=True, eq=False)
class SymbolicModel:
    """A vehicle's equations of motion as CasADi functions."""

    vehicle: VehicleModel
    n_x: int
    n_u: int
    derivative: Any
    """Function (state (n_x), input (n_u), current (3)) -> time derivative of the state (n_x)"""
    input_limits: FloatArray
    """Limits (n_u, 2) of the inputs, N"""
    rest: FloatArray
    """States (n_x - 13,) of the actuators after a long time at command 0"""
    longest_step: float
    """Longest step, s: twice the shortest time constant of the body (`vehicles.inspect`) and of the lags;
    RK4 is stable up to 2.8 time constants
    """

    def step(self, duration: float, substeps: int) -> Any:
        """Return the function (state, input, current) -> state after `duration` s.

        The function integrates by RK4, and normalises the quaternion after each substep.
        """
        ca = require()
        x0, u, c = ca.SX.sym("x", self.n_x), ca.SX.sym("u", self.n_u), ca.SX.sym("c", 3)
        h = duration / substeps
        x = x0
        for _ in range(substeps):
            k1 = self.derivative(x, u, c)
            k2 = self.derivative(x + h / 2 * k1, u, c)
            k3 = self.derivative(x + h / 2 * k2, u, c)
            k4 = self.derivative(x + h * k3, u, c)
            x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            q = x[3:7]
            x = ca.vertcat(x[:3], q / ca.norm_2(q), x[7:])
        return ca.Function("step", [x0, u, c], [x])


def symbolic(vehicle: VehicleModel) -> SymbolicModel:
    """Return the symbolic model of a vehicle.

    Raises:
        ConfigError: an actuator of the vehicle is not a thruster, or is rate-limited.
    """
    ca = require()
    lags = [_first_order(unit.lag) for unit in vehicle.units]
    thrusters = [unit for _, unit in vehicle.thrusters if unit.rate == 0.0]
    unsupported = [unit.name for unit in vehicle.units if unit not in thrusters]
    if unsupported:
        raise ConfigError(
            f"vehicle={vehicle.name}: the symbolic equations cover thrusters with linear lags, not {', '.join(unsupported)}"
        )
    n_u = len(vehicle.units)
    n_a = sum(lag.order for lag in lags)
    x, u, current = ca.SX.sym("x", RIGID + n_a), ca.SX.sym("u", n_u), ca.SX.sym("c", 3)
    states = x[RIGID:]

    outputs, rates, first = [], [], 0
    for j, lag in enumerate(lags):
        order = lag.order
        if order == 0:
            outputs.append(u[j])
            continue
        own = states[first : first + order]
        first += order
        rates.append(ca.DM(lag.A) @ own + ca.DM(lag.B) * u[j])
        outputs.append(ca.dot(ca.DM(lag.C), own))
    rigid = _rigid(ca, vehicle, n_u)
    x_dot = ca.vertcat(rigid(x[:RIGID], ca.vertcat(*outputs), current), *rates)
    poles = [pole for lag in lags for pole in np.linalg.eigvals(lag.A)]
    return SymbolicModel(
        vehicle,
        RIGID + n_a,
        n_u,
        ca.Function("derivative", [x, u, current], [x_dot]),
        vehicle.force_limits,
        np.zeros(n_a),
        2.0 * min(shortest_time_constant(vehicle), *(1.0 / abs(pole) for pole in poles), np.inf),
    )


def _first_order(lag: Lag) -> Lag:
    """Return `lag` if its order is at most 1, else the first-order lag with the same mean delay."""
    return lag if lag.order <= 1 else Lag.first_order(lag.delay)


def _rigid(ca: Any, vehicle: VehicleModel, n_u: int) -> Any:
    """Return the CasADi function of the rigid body: (state (13), thrusts (n_u) in N, current (3)) -> derivative of the state."""
    x, f, current = ca.SX.sym("x", RIGID), ca.SX.sym("f", n_u), ca.SX.sym("c", 3)
    q, nu = x[3:7], x[7:13]
    nu_dot, R = _acceleration(ca, vehicle, q, nu, ca.DM(vehicle.allocation) @ f, current)
    w, e, omega = q[0], q[1:4], nu[3:6]
    q_dot = 0.5 * ca.vertcat(-ca.dot(e, omega), w * omega + ca.cross(e, omega))
    return ca.Function("rigid", [x, f, current], [ca.vertcat(R @ nu[:3], q_dot, nu_dot)])


def _acceleration(ca: Any, vehicle: VehicleModel, q: Any, nu: Any, tau: Any, current: Any) -> tuple[Any, Any]:
    """Return the acceleration nu' (6) and the rotation matrix R(q) (3, 3).

    nu' solves M_RB nu' + C_RB nu + M_A (nu' - nu_c') + C_A nu_r + D nu_r + g = tau.
    """
    w, x, y, z = q[0], q[1], q[2], q[3]
    # Fossen 2011, eq. 2.65. Like the kernel, this code does not divide by the quaternion's norm.
    R = ca.vertcat(
        ca.horzcat(1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        ca.horzcat(2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        ca.horzcat(2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    v_c = R.T @ current
    omega = nu[3:6]
    nu_r = nu - ca.vertcat(v_c, 0, 0, 0)
    # A current that is constant in the world turns relative to the body (Fossen 2011, section 8.3).
    nu_c_dot = ca.vertcat(-ca.cross(omega, v_c), 0, 0, 0)
    M_RB, M_A = ca.DM(vehicle.M_RB), ca.DM(vehicle.M_A)
    coriolis = _momentum_term(ca, M_RB, nu)
    if vehicle.plugin:
        coriolis -= _momentum_term(ca, M_A, nu_r)
    elif vehicle.added_mass_coriolis:
        coriolis += _momentum_term(ca, M_A, nu_r)
    if vehicle.plugin == GZ_SIM_8_11:
        surge, yaw = surge_and_yaw(vehicle.M_A, nu_r)
        coriolis -= ca.vertcat(surge, 0, 0, 0, 0, yaw)
    damping = (ca.DM(vehicle.linear_damping) + ca.DM(vehicle.quadratic_damping) * ca.fabs(nu_r)) * nu_r
    up = R[2, :].T  # the world's z axis in body axes
    lever = ca.DM(vehicle.buoyancy * vehicle.center_of_buoyancy - vehicle.weight * vehicle.center_of_gravity)
    restoring = ca.vertcat((vehicle.buoyancy - vehicle.weight) * up, ca.cross(lever, up))
    total = tau + restoring - coriolis - damping + M_A @ nu_c_dot
    return ca.DM(vehicle.M_inverse) @ total, R


def _momentum_term(ca: Any, M: Any, nu: Any) -> Any:
    """Return C(nu) nu = [omega x p; v x p + omega x h] with momenta [p; h] = M nu (Fossen 2011, theorem 3.2)."""
    momentum = M @ nu
    p, h = momentum[:3], momentum[3:6]
    v, omega = nu[:3], nu[3:6]
    return ca.vertcat(ca.cross(omega, p), ca.cross(v, p) + ca.cross(omega, h))
