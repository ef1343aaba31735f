"""Compiled actuators: static curve once per step, exact linear dynamics per half substep, wrench.

A command passes through these steps: normalised command -> static curve -> linear dynamics (exactly discretised for
half a substep, so that the stages of RK4 at 0, h/2 and h see the exact state) -> rotor (k n|n|, n in rad/s) or
identity -> effectiveness -> wrench [e; r x e] per newton (tau = T f, Fossen 2011, section 12.3).

Tables (n_u, LANES) have a row for each actuator: `value` is the static curve's value for the command, `output` the
output of the dynamics, and `thrust` the effectiveness times the thrust scale. `kept` and `moved` contain the
coefficients A and B of x' = A x + B u, for first-order lags whose time constants differ between vehicles.
`inner` (states, LANES) contains the states of all dynamics.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from auvbench.dynamics.compiled import inline
from auvbench.dynamics.lanes import (
    add3,
    order_1,
    order_2,
    order_3,
    put3,
    three,
    vector,
)
from auvbench.dynamics.layout import (
    DROP_WEIGHT,
    LANES,
    LINEAR_CURVE,
    POWER_POINTS,
    POWER_TABLE,
    TABLE_CURVE,
    THRUSTER,
    Record,
)
from auvbench.dynamics.vectors import add, dot, product, scale

FloatArray = NDArray[np.float64]


@inline
def interpolated(tables: FloatArray, row: int, points: int, position: float) -> float:
    """Interpolate a row of a table linearly at `position`; the row contains equally spaced points, with point k at position k."""
    k = max(min(int(position), points - 2), 0)
    left: float = tables[row, k]
    right: float = tables[row, k + 1]
    return left + (position - k) * (right - left)


@inline
def polynomial(tables: FloatArray, row: int, points: int, x: float) -> float:
    """Return a polynomial's value at x by Horner's rule; the row contains the coefficients of x^0, x^1, ..."""
    total: float = tables[row, points - 1]
    for k in range(points - 2, -1, -1):
        total = total * x + tables[row, k]
    return total


@njit(nogil=True)
def static_curves(actuators: Record, tables: FloatArray, value: FloatArray) -> None:
    """Replace commands (n_u, LANES), clipped to [-1, 1], by the values of the static curves."""
    for a in range(actuators.shape[0]):
        actuator = actuators[a]
        for lane in range(LANES):
            value[a, lane] = min(max(value[a, lane], -1.0), 1.0)
        if actuator.curve == LINEAR_CURVE:
            neutral = actuator.neutral
            below, above = neutral - actuator.low, actuator.high - neutral
            for lane in range(LANES):
                x = value[a, lane]
                value[a, lane] = neutral + x * (below if x < 0.0 else above)
            continue
        row, points = actuator.table, actuator.entries
        if actuator.curve == TABLE_CURVE:
            for lane in range(LANES):
                position = 0.5 * (value[a, lane] + 1.0) * (points - 1)
                value[a, lane] = interpolated(tables, row, points, position)
        else:
            for lane in range(LANES):
                value[a, lane] = polynomial(tables, row, points, value[a, lane])


@njit(nogil=True)
def report(
    first: int,
    actuators: Record,
    tables: FloatArray,
    value: FloatArray,
    force: FloatArray,
    power: FloatArray,
) -> None:
    """Write each vehicle's commanded forces and its electrical power."""
    middle = 0.5 * (POWER_POINTS - 1)
    for lane in range(min(LANES, force.shape[0] - first)):
        watts = 0.0
        for a in range(actuators.shape[0]):
            actuator = actuators[a]
            if actuator.kind != THRUSTER:
                force[first + lane, a] = 0.0
                continue
            newtons = value[a, lane]
            if actuator.rotor != 0.0:
                newtons = actuator.rotor * newtons * abs(newtons)
            force[first + lane, a] = newtons
            position = newtons * actuator.force_scale * actuator.points_per_newton + middle
            position = min(max(position, 0.0), POWER_POINTS - 1.0)
            watts += interpolated(tables, POWER_TABLE, POWER_POINTS, position) * actuator.power_scale
        power[first + lane] = watts


@njit(nogil=True)
def apply_thrust(ws: Record, actuators: Record, output: FloatArray, thrust: FloatArray) -> None:
    """Set tau to the external wrench plus the thrusters' wrench; `thrust` is a factor on each thruster's force."""
    tau, external, force = ws.tau, ws.external, ws.force
    for lane in range(LANES):
        put3(tau.force, lane, three(external.force, lane))
        put3(tau.torque, lane, three(external.torque, lane))
    for a in range(actuators.shape[0]):
        actuator = actuators[a]
        if actuator.kind != THRUSTER:
            continue
        rotor = actuator.rotor
        if rotor == 0.0:
            for lane in range(LANES):
                force[lane] = output[a, lane] * thrust[a, lane]
        else:
            for lane in range(LANES):
                force[lane] = rotor * output[a, lane] * abs(output[a, lane]) * thrust[a, lane]
        e, r_x_e = vector(actuator.per_newton.force), vector(actuator.per_newton.torque)
        for lane in range(LANES):
            add3(tau.force, lane, scale(force[lane], e))
            add3(tau.torque, lane, scale(force[lane], r_x_e))


@njit(nogil=True)
def hold_commands(
    ws: Record,
    block: int,
    states: FloatArray,
    command: FloatArray,
    effectiveness: FloatArray,
    force: FloatArray,
    power: FloatArray,
    actuators: Record,
    discrete: Record,
    tables: FloatArray,
    value: FloatArray,
    output: FloatArray,
    thrust: FloatArray,
    inner: FloatArray,
    kept: FloatArray,
    moved: FloatArray,
    own_lags: bool,
) -> None:
    """Start a step: compute the static curves' values, the commanded forces and power, and the actuators' present outputs and wrench."""
    last = command.shape[0] - 1
    for lane in range(LANES):
        i = min(block * LANES + lane, last)
        for a in range(actuators.shape[0]):
            value[a, lane] = command[i, a]
            thrust[a, lane] = effectiveness[i, a]
        for j in range(states.shape[1]):
            inner[j, lane] = states[i, j]
    for a in range(actuators.shape[0]):
        for lane in range(LANES):
            thrust[a, lane] *= ws.vehicle.thrust_factor[lane]
    static_curves(actuators, tables, value)
    for a in range(actuators.shape[0]):
        if actuators[a].kind == DROP_WEIGHT:
            first = actuators[a].first_state
            for lane in range(LANES):
                # A command above one half releases the weight for good.
                if value[a, lane] > 0.5:
                    inner[first, lane] = 1.0
    report(block * LANES, actuators, tables, value, force, power)
    if own_lags:
        _discretise_lags(ws, actuators, discrete, kept, moved)
    _outputs(actuators, discrete, value, output, inner)
    apply_thrust(ws, actuators, output, thrust)


@njit(nogil=True)
def _outputs(
    actuators: Record, discrete: Record, value: FloatArray, output: FloatArray, inner: FloatArray
) -> None:
    """Write each actuator's output y = C x for the present state x of its dynamics."""
    for a in range(actuators.shape[0]):
        order, first, C = actuators[a].order, actuators[a].first_state, discrete[a].C
        if order == 0:
            for lane in range(LANES):
                output[a, lane] = value[a, lane]
            continue
        for lane in range(LANES):
            output[a, lane] = 0.0
        for j in range(order):
            c = C[j]
            for lane in range(LANES):
                output[a, lane] += c * inner[first + j, lane]


@inline
def _scaled_lag(actuator: Record) -> bool:
    """Return whether an actuator is a thruster with a first-order lag; `lag_factor` scales only the lags of such thrusters."""
    return bool(actuator.kind == THRUSTER and actuator.order == 1 and actuator.rate == 0.0)


@njit(nogil=True)
def _discretise_lags(
    ws: Record, actuators: Record, discrete: Record, kept: FloatArray, moved: FloatArray
) -> None:
    """Write A and B (n_u, LANES) of first-order lags after the sheet's time constants are multiplied by each vehicle's `lag_factor`.

    With h as half a substep, A = exp(-h / T) becomes A^(1 / factor). B changes so that the static gain stays the same.
    With a factor of 1, A and B keep all bits.
    """
    for a in range(actuators.shape[0]):
        if not _scaled_lag(actuators[a]):
            continue
        A, B, _ = order_1(discrete[a])
        for lane in range(LANES):
            kept[a, lane] = A ** (1.0 / ws.vehicle.lag_factor[lane])
            moved[a, lane] = B * ((1.0 - kept[a, lane]) / (1.0 - A))


# There is one function for each order of x' = A x + B u, y = C x, because a loop over the order would keep the state in memory,
# not in registers. Each function takes whole tables and an index, because a view of a row costs more than the arithmetic. Each
# function reads the coefficients before the loop, so that the compiler knows that the loop does not change them.


@njit(nogil=True)
def _advance_first(
    a: int, first: int, D: Record, value: FloatArray, output: FloatArray, inner: FloatArray
) -> None:
    A, B, C = order_1(D[a])
    for lane in range(LANES):
        x = A * inner[first, lane] + B * value[a, lane]
        inner[first, lane] = x
        output[a, lane] = C * x


@njit(nogil=True)
def _advance_own(
    a: int,
    first: int,
    D: Record,
    kept: FloatArray,
    moved: FloatArray,
    value: FloatArray,
    output: FloatArray,
    inner: FloatArray,
) -> None:
    """Advance one actuator's first-order lag; `kept` and `moved` (n_u, LANES) are A and B of each vehicle."""
    _, _, C = order_1(D[a])
    for lane in range(LANES):
        x = kept[a, lane] * inner[first, lane] + moved[a, lane] * value[a, lane]
        inner[first, lane] = x
        output[a, lane] = C * x


@njit(nogil=True)
def _advance_second(
    a: int, first: int, D: Record, value: FloatArray, output: FloatArray, inner: FloatArray
) -> None:
    ((a00, a01), (a10, a11)), (b0, b1), (c0, c1) = order_2(D[a])
    second = first + 1
    for lane in range(LANES):
        s0, s1, u = inner[first, lane], inner[second, lane], value[a, lane]
        x0 = a00 * s0 + a01 * s1 + b0 * u
        x1 = a10 * s0 + a11 * s1 + b1 * u
        inner[first, lane] = x0
        inner[second, lane] = x1
        output[a, lane] = c0 * x0 + c1 * x1


@njit(nogil=True)
def _advance_third(
    a: int, first: int, D: Record, value: FloatArray, output: FloatArray, inner: FloatArray
) -> None:
    A, B, C = order_3(D[a])
    second, third = first + 1, first + 2
    for lane in range(LANES):
        s = (inner[first, lane], inner[second, lane], inner[third, lane])
        x = add(product(A, s), scale(value[a, lane], B))
        inner[first, lane], inner[second, lane], inner[third, lane] = x
        output[a, lane] = dot(C, x)


@njit(nogil=True)
def advance_actuators(
    ws: Record,
    actuators: Record,
    discrete: Record,
    value: FloatArray,
    output: FloatArray,
    thrust: FloatArray,
    inner: FloatArray,
    kept: FloatArray,
    moved: FloatArray,
    own_lags: bool,
) -> None:
    """Advance the actuator states exactly by half a substep, and compute the new wrench."""
    for a in range(actuators.shape[0]):
        actuator = actuators[a]
        order, first = actuator.order, actuator.first_state
        if order == 0:
            continue
        if actuator.rate > 0.0:
            reach = actuator.rate * discrete[a].half_step
            for lane in range(LANES):
                inner[first, lane] += min(max(value[a, lane] - inner[first, lane], -reach), reach)
                output[a, lane] = inner[first, lane]
        elif actuator.kind == DROP_WEIGHT:
            continue
        elif order == 1:
            if own_lags and actuator.kind == THRUSTER:
                _advance_own(a, first, discrete, kept, moved, value, output, inner)
                continue
            _advance_first(a, first, discrete, value, output, inner)
        elif order == 2:
            _advance_second(a, first, discrete, value, output, inner)
        else:
            _advance_third(a, first, discrete, value, output, inner)
    apply_thrust(ws, actuators, output, thrust)
