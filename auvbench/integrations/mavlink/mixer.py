"""Model ArduSub's mixer in the mode MANUAL, and invert the model to find MANUAL_CONTROL axes for thruster forces.

Sources: the mixing is in output_armed_stabilizing_vectored and ..._vectored_6dof in
libraries/AP_Motors/AP_Motors6DOF.cpp; the sticks are in transform_manual_control_to_rc_override in
ArduSub/joystick.cpp and in ModeManual::run in ArduSub/mode_manual.cpp. The mixer's output is linear in PWM,
which a T200 converts to a force by its curve.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from auvbench.integrations.ardusub.frames import HIGH, Motors
from auvbench.integrations.ardusub.frames import NEUTRAL as CENTRE
from auvbench.vehicles.curves import t200_curve

Floats = NDArray[np.float64]

ROLL, PITCH, YAW, THROTTLE, FORWARD, LATERAL = range(6)
"""indices of the mixer's axes, with body axes forward, starboard and down; positive throttle pushes up"""
FULL = 1000
"""full deflection of a stick"""
RAW = 400
"""full deflection of s and t, in us of PWM; the joystick gain does not scale it"""
_ITERATIONS = 6
_DAMPING = 1e-3
_STEP = 0.01
_SPREAD = 0.1
"""lever arm in m that converts moments to forces in the error that `Mixer.axes` minimises"""


@dataclass(frozen=True, slots=True)
class Sticks:
    """Fields of MANUAL_CONTROL."""

    x: int = 0
    y: int = 0
    z: int = 500
    r: int = 0
    s: int = 0
    t: int = 0


NEUTRAL = Sticks()


class Mixer:
    """The mixer of one vehicle.

    Args:
        motors: thrusters of the vehicle, matched to one of ArduSub's frames.
        throttle_gain: ArduSub's parameter JS_THR_GAIN.
        coupling: ArduSub's parameter MOT_FV_CPLNG_K, by which the frame vectored limits the rear thrusters
            during vertical motion.
    """

    def __init__(self, motors: Motors, *, throttle_gain: float = 1.0, coupling: float = 1.0) -> None:
        assert motors.frame is not None
        self.motors, self.frame = motors, motors.frame
        self.throttle_gain, self.coupling = throttle_gain, coupling
        self._factors = np.array(self.frame.factors)
        self._used = np.flatnonzero(np.any(self._factors != 0.0, axis=0))
        self._B = motors.vehicle.allocation
        self._weight = np.array([1.0, 1.0, 1.0, *[1.0 / _SPREAD] * 3])
        self._spread = np.linalg.pinv(self._B) @ self._B
        self._unmix = np.linalg.pinv(self._factors)

    def levels(self, axes: Floats) -> Floats:
        """Return the motors' outputs in [-1, 1], (..., motors), for axes in [-1, 1], (..., 6)."""
        factors = self._factors.T
        if self.frame.name == "vectored_6dof":
            # The mixer scales down a group of axes if a motor would saturate.
            groups = ([ROLL, PITCH, THROTTLE], [YAW, FORWARD, LATERAL])
            parts = [axes[..., group] @ factors[group] for group in groups]
            return np.asarray(
                sum(part / np.maximum(np.max(np.abs(part), axis=-1, keepdims=True), 1.0) for part in parts)
            )
        forward = axes[..., FORWARD, None]
        room = np.maximum(1.0 - self.coupling * np.abs(axes[..., THROTTLE, None]), 0.0)
        # The mixer limits the rear motors that push in the direction of motion.
        limited = factors[FORWARD] * forward > 0.0
        ahead = np.where(limited, np.clip(forward, -room, room), forward)
        others = [ROLL, PITCH, YAW, THROTTLE, LATERAL]
        return np.asarray(np.clip(axes[..., others] @ factors[others] + factors[FORWARD] * ahead, -1.0, 1.0))

    def wrench(self, axes: Floats) -> Floats:
        """Return the steady wrench in N and N m, body axes FLU, (..., 6), for axes, (..., 6)."""
        pulses = CENTRE + (HIGH - CENTRE) * self.levels(axes)
        return np.asarray(self.motors.forces(pulses) @ self._B.T)

    def limits(self, gain: float) -> Floats:
        """Return the largest magnitude of each axis at a joystick gain, (6,); the gain does not limit roll and pitch."""
        return np.minimum([1.0, 1.0, gain, gain * self.throttle_gain, gain, gain], 1.0)

    def reach(self, gain: float) -> Floats:
        """Return, for each axis, the mixer's largest force or moment as a fraction of the thrusters' largest force or moment, (6,).

        The thrusters' largest force or moment is the sum of the magnitudes that all thrusters can contribute along the axis. If this
        sum is 0, the fraction is NaN.
        """
        axes = np.diag(self.limits(gain))[[FORWARD, LATERAL, THROTTLE, ROLL, PITCH, YAW]]
        both = [np.abs(np.diagonal(self.wrench(sign * axes))) for sign in (1.0, -1.0)]
        vehicle = self.motors.vehicle
        most = np.abs(self._B) @ np.abs(vehicle.force(np.ones(len(vehicle.units))))
        with np.errstate(invalid="ignore"):  # 0 / 0: the thrusters of a vectored frame give no pitch
            return np.asarray(np.minimum(np.minimum(*both) / most, 1.0))

    def axes(self, force: Floats, limits: Floats) -> Floats:
        """Return the mixer's axes (6,) within `limits` that give the wrench closest to the wrench of the thruster forces.

        The mixer cannot produce forces that cancel each other, so the search (Levenberg-Marquardt) starts from the smallest
        thruster forces with the same wrench.

        Args:
            force: thruster forces in N, (n_u,).
            limits: largest magnitudes of the axes, (6,).
        """
        wanted = self._weight * (self._B @ force)
        used, signs = self._used, np.array(self.motors.signs)
        least = (self._spread @ force)[list(self.motors.order)]
        best = np.clip(self._unmix @ t200_curve().inverse(signs * least), -limits, limits)
        error = wanted - self._weight * self.wrench(best)
        damping = _DAMPING
        for _ in range(_ITERATIONS):
            nudged = best + _STEP * np.eye(6)[used]
            slopes = (wanted - self._weight * self.wrench(nudged) - error) / -_STEP
            damped = slopes @ slopes.T + damping * np.eye(len(used)) * np.trace(slopes @ slopes.T)
            trial = best.copy()
            trial[used] += np.linalg.solve(damped, slopes @ error)
            trial = np.clip(trial, -limits, limits)
            trial_error = wanted - self._weight * self.wrench(trial)
            if trial_error @ trial_error < error @ error:
                best, error, damping = trial, trial_error, 0.1 * damping
            else:
                damping *= 10.0
        return np.asarray(best)

    def sticks(self, axes: Floats, gain: float) -> Sticks:
        """Return the fields of MANUAL_CONTROL that set the mixer's axes to `axes` (6,) if the joystick gain is `gain`."""
        speed = FULL / gain
        whole = np.rint(
            [
                speed * axes[FORWARD],
                speed * axes[LATERAL],
                500 + 0.5 * speed / self.throttle_gain * axes[THROTTLE],
                speed * axes[YAW],
                RAW * axes[PITCH],
                RAW * axes[ROLL],
            ]
        )
        return Sticks(*whole.astype(int).tolist())
