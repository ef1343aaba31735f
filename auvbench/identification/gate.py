"""Judge from a log whether the commands caused the motion, or a controller computed the commands from the motion.

In an open-loop log the commanded force leads the force that the motion shows (mass times acceleration, damping, restoring
moment) by the thrusters' delay, 20 to 30 ms in a log of a BlueROV. In closed-loop logs of the same vehicle the command follows
the motion by 60 to 200 ms, and a fit runs to its bounds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from auvbench.dynamics import frames
from auvbench.identification import inputs, motion
from auvbench.identification.log import CHANNELS, Log
from auvbench.vehicles.inspect import AXES
from auvbench.vehicles.vehicle_model import VehicleModel

FloatArray = NDArray[np.float64]

GRID = 0.02
"""Time in s between two samples of the comparison."""
LATEST = 0.15
"""Largest time in s by which the motion may follow the command in an open-loop log."""
FARTHEST = 0.3
"""Largest time in s by which command and motion are shifted against each other for the comparison."""
SMALLEST = 0.6
"""Smallest correlation of command and motion with which an axis is judged as open loop."""
COARSEST = 0.075
"""Largest time in s between two measurements with which the lag of the motion can be judged."""
SMOOTH = 5
"""Number of samples in the moving means that smooth the velocities, the commanded force and the force from the motion."""
EXCITED = 0.02
"""Smallest RMS of the commanded force on an axis that is judged, as a fraction of the axis's largest force."""


QUIET = 0.05
"""Speed in m/s or rad/s below which the motion along an axis without commands determines neither mass nor damping."""

CLOSED, AGAINST, STILL = "closed loop", "against the command", "still"
_REASONS = {
    CLOSED: "the log is closed loop on this axis",
    AGAINST: "the vehicle moves against the commands on this axis",
    STILL: "the thrusters were hardly commanded along this axis, and the log shows no motion along it",
}


@dataclass(frozen=True, slots=True)
class Verdict:
    """Judgement whether, in some logs, the commands of one axis caused the motion along this axis."""

    axis: str
    command: float
    """Root mean square of the commanded force along the axis, as a fraction of the largest force along the axis."""
    moved: float
    """95 % quantile of the absolute velocity, m/s or rad/s; NaN if no log shows the velocity."""
    lag: float = float("nan")
    """Time in s by which the motion follows the command at the largest correlation."""
    correlation: float = float("nan")
    state: str = "open loop"
    """"open loop", "closed loop", "against the command", "still", "not commanded", "not measured" or "not resolved"."""

    @property
    def refused(self) -> bool:
        """Return whether the axis's parameters must stay at their prior."""
        return self.state in _REASONS


def judge(logs: Sequence[Log], vehicle: VehicleModel) -> list[Verdict]:
    """Return a verdict for each axis.

    Raises:
        LogError: the inputs of a log do not fit the vehicle.
    """
    wrenches = [inputs.wrench(log, vehicle) for log in logs]
    motions = [motion.of_log(log) for log in logs]
    largest = _largest(vehicle, wrenches)
    return [_judge(k, logs, vehicle, wrenches, motions, largest[k]) for k in range(6)]


def _largest(vehicle: VehicleModel, wrenches: Sequence[FloatArray]) -> FloatArray:
    """Return the largest force (6,) along each axis."""
    if not vehicle.units:
        return np.asarray(np.max([np.abs(wrench).max(axis=0) for wrench in wrenches], axis=0))
    return np.asarray(np.abs(vehicle.allocation) @ np.abs(vehicle.force_limits).max(axis=1))


def _judge(
    k: int,
    logs: Sequence[Log],
    vehicle: VehicleModel,
    wrenches: Sequence[FloatArray],
    motions: Sequence[motion.Motion],
    largest: float,
) -> Verdict:
    changes = [wrench[:, k] - wrench[:, k].mean() for wrench in wrenches]
    total = np.concatenate([wrench[:, k] for wrench in wrenches])
    command = float(np.sqrt(np.mean(total**2)) / largest) if largest > 0.0 else 0.0
    varied = float(np.sqrt(np.mean(np.concatenate(changes) ** 2)) / largest) if largest > 0.0 else 0.0
    seen = [number for number in range(len(logs)) if motions[number].source[6 + k]]
    moved = float("nan")
    if seen:
        moved = float(np.quantile(np.abs(np.concatenate([motions[n].state[:, 6 + k] for n in seen])), 0.95))
    if command < EXCITED:
        # If the speed was not measured, `moved` is NaN and the state is STILL.
        return Verdict(AXES[k], command, moved, state="not commanded" if moved >= QUIET else STILL)
    if not seen:
        return Verdict(AXES[k], command, moved, state="not measured")
    if varied < EXCITED or max(_interval(logs[number], k) for number in seen) > COARSEST:
        return Verdict(AXES[k], command, moved, state="not resolved")
    shifts = np.arange(-round(FARTHEST / GRID), round(FARTHEST / GRID) + 1)
    products, powers = np.zeros(shifts.size), np.zeros((shifts.size, 2))
    for number in seen:
        for tau, force in _signals(k, logs[number], vehicle, wrenches[number], motions[number]):
            for place, shift in enumerate(shifts.tolist()):
                early = tau[max(0, -shift) : tau.size - max(0, shift)]
                late = force[max(0, shift) : force.size - max(0, -shift)]
                products[place] += early @ late
                powers[place] += early @ early, late @ late
    correlation = products / np.sqrt(np.maximum(powers[:, 0] * powers[:, 1], 1e-30))
    best = int(np.argmax(correlation))
    lag, peak = float(shifts[best] * GRID), float(correlation[best])
    late_enough = (shifts * GRID > -1e-9) & (shifts * GRID <= LATEST)
    against = int(np.argmin(np.where(late_enough, correlation, np.inf)))
    if correlation[against] <= -SMALLEST and -correlation[against] > peak:
        return Verdict(
            AXES[k],
            command,
            moved,
            float(shifts[against] * GRID),
            float(correlation[against]),
            AGAINST,
        )
    state = "open loop" if late_enough[best] and peak >= SMALLEST else CLOSED
    return Verdict(AXES[k], command, moved, lag, peak, state)


def _interval(log: Log, k: int) -> float:
    """Return the time in s between measurements of an axis's velocity, or else of the position or angle that is differentiated."""
    name = CHANNELS[6 + k] if log.has(CHANNELS[6 + k]) else CHANNELS[k]
    return log.interval(name) if log.has(name) else float("inf")


def _signals(
    k: int, log: Log, vehicle: VehicleModel, wrench: FloatArray, state: motion.Motion
) -> list[tuple[FloatArray, FloatArray]]:
    """Return, for each segment, the commanded force and the force that the motion shows, both less their means, (samples,)."""
    signals = []
    kernel = np.ones(SMOOTH) / SMOOTH
    for first, last in log.segments:
        time = log.time[first:last]
        grid = np.arange(time[0], time[-1], GRID)
        if grid.size < 4 * round(FARTHEST / GRID):
            continue
        tau = wrench[first:last, k][np.searchsorted(time, grid, side="right") - 1]
        states = np.column_stack([np.interp(grid, time, column) for column in state.state[first:last].T])
        states[:, 6:] = np.column_stack([np.convolve(column, kernel, "same") for column in states[:, 6:].T])
        force = needed(vehicle, states, np.gradient(states[:, 6:], GRID, axis=0))[:, k]
        tau, force = (np.convolve(part, kernel, "same")[SMOOTH:-SMOOTH] for part in (tau, force))
        signals.append((tau - tau.mean(), force - force.mean()))
    return signals


def needed(vehicle: VehicleModel, states: FloatArray, change: FloatArray) -> FloatArray:
    """Return the wrench (T, 6) that Fossen's equations need for states (T, 12) with the acceleration `change` (T, 6)."""
    nu = states[:, 6:]
    v, omega = nu[:, :3], nu[:, 3:]
    momentum = nu @ (vehicle.M_RB + vehicle.coriolis_sign * vehicle.M_A).T
    p, h = momentum[:, :3], momentum[:, 3:]
    coriolis = np.column_stack([np.cross(omega, p), np.cross(v, p) + np.cross(omega, h)])
    up = frames.rotation(frames.quaternion(states[:, 3:6]))[:, 2]
    arm = vehicle.buoyancy * vehicle.center_of_buoyancy - vehicle.weight * vehicle.center_of_gravity
    restoring = np.column_stack([(vehicle.buoyancy - vehicle.weight) * up, np.cross(arm, up)])
    damping = (vehicle.linear_damping + vehicle.quadratic_damping * np.abs(nu)) * nu
    return np.asarray(change @ vehicle.M.T + coriolis + damping - restoring)


def reasons(verdicts: Sequence[Verdict], names: Sequence[str]) -> dict[str, str]:
    """Return, by parameter name, why a parameter of a refused axis stays at its prior."""
    refused = {verdict.axis: _REASONS[verdict.state] for verdict in verdicts if verdict.refused}
    return {
        name: refused[axis]
        for name in names
        if (axis := name.partition(".")[2]) in refused
        and not name.startswith(("gain.", "center_of_buoyancy"))
    }


def warning(verdicts: Sequence[Verdict]) -> str:
    """Return a warning about the commands of some axes; '' if nothing is wrong."""
    closed, against = _said(verdicts, CLOSED), _said(verdicts, AGAINST)
    parts = []
    if all(verdict.state in ("not commanded", STILL) for verdict in verdicts):
        parts.append(
            f"no axis was commanded with more than {100 * EXCITED:.0f} % of its largest force: the logs show little more than"
            " the buoyancy; record a telegraph signal (auvbench pilot excite)"
        )
    if closed:
        parts.append(
            f"the commands do not lead the motion on {closed}: the log looks closed loop, and these axes stay at the sheet's"
            f" values; record a telegraph signal without a controller (accepted: correlation of"
            f" {SMALLEST:g} or more at a lag of 0 to {1e3 * LATEST:.0f} ms). If no controller ran, give gate=off: a vehicle with far"
            " more damping than in its sheet looks the same"
        )
    if against:
        parts.append(
            f"the vehicle moves against the commands on {against}, and these axes stay at the sheet's values; either a"
            " thruster pushes opposite to its direction in the sheet (correct motors=), or the log has other axes (correct frame=)"
        )
    return ". ".join(parts)


def _said(verdicts: Sequence[Verdict], state: str) -> str:
    return ", ".join(
        f"{verdict.axis} (correlation {verdict.correlation:.2f} at {1e3 * verdict.lag:+.0f} ms)"
        for verdict in verdicts
        if verdict.state == state
    )
