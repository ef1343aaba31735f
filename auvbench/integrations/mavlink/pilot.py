"""Pilot a vehicle that runs ArduSub: send thruster forces to ArduSub's mixer as MANUAL_CONTROL messages."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.errors import UserError
from auvbench.integrations.ardusub.frames import Motors, motors_of
from auvbench.integrations.ardusub.radio import MANUAL
from auvbench.integrations.mavlink.autopilot import Autopilot
from auvbench.integrations.mavlink.failsafes import weak
from auvbench.integrations.mavlink.link import Link
from auvbench.integrations.mavlink.mixer import NEUTRAL, Mixer
from auvbench.pilot import loop
from auvbench.pilot.steering import Steering
from auvbench.vehicles.inspect import AXES

Floats = NDArray[np.float64]

TELEMETRY = 90.0
"""time in s to wait for attitude and position; in SITL the estimator has a position about 50 s after the start"""
SLOWEST = 1.0
"""lowest rate of stick messages, Hz"""
FASTEST = 200.0
"""highest rate of telemetry, Hz"""


class Pilot(loop.Pilot):
    """Pilot that acts as a ground station.

    Args:
        address: address of the link.
        steering: see `loop.Pilot`; the vehicle in it must have the thrusters of ArduSub's frame.
        options: see `loop.Pilot`; `sim_time` steps by the vehicle's time since boot.

    Raises:
        UserError: no vehicle is heard, or the vehicle is unsuitable or sends no telemetry; the message says what to check.
    """

    source = "telemetry"

    def __init__(self, address: str, steering: Steering, **options: Any) -> None:
        super().__init__(steering, **options)
        frequency = steering.frequency
        if frequency < SLOWEST:
            raise UserError(
                f"--frequency {frequency:g}: must be at least {SLOWEST:g} Hz, because ArduSub disarms 3 s after the last stick message"
            )
        motors = motors_of(steering.vehicle)
        self.link = Link(address)
        try:
            # Several messages per step, so that the pose of a step is recent.
            self.vehicle = Autopilot(self.link, min(4.0 * frequency, FASTEST), self._say)
            self._check_frame(motors)
            self.guard = self.link.supervise(self.vehicle.peer, self.limits.patience)
            self.guard.leave_will(self.vehicle.will())
            self._say(f"found {self.vehicle.who}; waiting for its attitude and position")
            if not self.vehicle.until(
                lambda: not self.vehicle.telemetry.missing, TELEMETRY, self.vehicle.ask_telemetry
            ):
                raise UserError(
                    f"--mavlink {address}: {self.vehicle.telemetry.missing} did not come in {TELEMETRY:g} s; a position needs an origin"
                    " and a sensor that the estimator uses (DVL, GPS, external vision)"
                )
        except BaseException:
            self.link.close()
            raise
        parameters = self.vehicle.parameters
        self.mixer = Mixer(
            motors, throttle_gain=parameters["JS_THR_GAIN"], coupling=parameters["MOT_FV_CPLNG_K"]
        )
        self._was_armed = self.vehicle.armed
        self._asked = time.monotonic()
        self._take_telemetry()
        self._set_state("disarmed")

    def _check_frame(self, motors: Motors) -> None:
        assert motors.frame is not None
        config, name = self.vehicle.parameters["FRAME_CONFIG"], motors.vehicle.name
        if config != motors.frame.config:
            raise UserError(
                f"--vehicle {name}: has the frame {motors.frame.name} (FRAME_CONFIG {motors.frame.config}), but ArduSub has"
                f" FRAME_CONFIG {config:g}; choose the vehicle with ArduSub's frame, or correct FRAME_CONFIG"
            )

    def about(self) -> str:
        """Return a line that names, for each axis, the fraction of the vehicle's largest force that the mixer can produce."""
        gain = self.vehicle.gain
        reach = dict(zip(AXES, self.mixer.reach(gain), strict=True))
        parts = ", ".join(f"{part:.0%} of {axis}" for axis, part in reach.items() if part > 0.005)
        none = [axis for axis, part in reach.items() if part <= 0.005]
        return (
            f"ArduSub's mixer ({self.mixer.frame.name}) at joystick gain {gain:g} reaches these shares of the vehicle's"
            f" largest forces: {parts}" + "".join(f"; it does not steer {axis}" for axis in none)
        )

    @property
    def cue(self) -> str:
        """Return a text that says when the pilot begins to steer if --arm is not given."""
        begins = "when you arm it in MANUAL"
        return (
            f"{begins}; it is armed already: disarm it first, or give --arm" if self.vehicle.armed else begins
        )

    # Methods by which `loop.Pilot` uses the network.

    def _receive(self, seconds: float) -> None:
        vehicle = self.vehicle
        vehicle.receive(seconds)
        self._take_telemetry()
        if self.armed and not vehicle.armed:
            self.disarm(f"ArduSub disarmed{': ' + vehicle.warning if vehicle.warning else ''}")
        elif self.armed and vehicle.mode != MANUAL:
            self.disarm(f"ArduSub left the mode MANUAL for {vehicle.mode}")
        elif self._owes_rest:
            self._rest_and_release()
        elif vehicle.armed and not self._was_armed and not self.armed:
            self._armed_elsewhere()
        self._was_armed = vehicle.armed
        now = time.monotonic()
        if self.age > 1.0 and now - self._asked > 1.0:  # the vehicle may have restarted
            self._asked = now
            vehicle.ask_telemetry()

    def _armed_elsewhere(self) -> None:
        mode = self.vehicle.mode
        why = self.arm() if mode == MANUAL else f"its mode is {mode}, must be MANUAL ({MANUAL})"
        if why:
            self._report(f"ArduSub was armed, but the pilot does not steer it: {why}")

    def _take_telemetry(self) -> None:
        if (state := self.vehicle.telemetry.state) is not None:
            self._take_pose(*state)
            self._take_time(state[0] / 1e9)

    def _ages(self) -> dict[str, float]:
        return {**super()._ages(), "the heartbeat": self.vehicle.telemetry.overdue}

    def _command(self, quantities: Floats) -> None:
        if not np.any(quantities):
            self.vehicle.manual_control(NEUTRAL)
            return
        gain = self.vehicle.gain
        axes = self.mixer.axes(quantities, self.mixer.limits(gain))
        self.vehicle.manual_control(self.mixer.sticks(axes, gain))

    def _take_over(self) -> str:
        if company := self.vehicle.company:
            return f"a second vehicle is on {self.link.address}: {company}; give each its own port"
        if warning := weak(self.vehicle.parameters):
            self._report(warning)
        try:
            why = self.vehicle.take_over()
        except BaseException:  # e.g. a second Ctrl-C
            self.vehicle.disarm(0.5)
            raise
        self._take_telemetry()
        return why

    def _rest(self) -> bool:
        super()._rest()
        # In another mode a person or a failsafe controls the vehicle.
        if self.vehicle.mode != MANUAL:
            return True
        disarmed = self.vehicle.disarm(1.5)
        self.vehicle.manual_control(
            NEUTRAL
        )  # the first neutral sticks may have reached the supervisor too late
        if disarmed:
            return True
        if not self._owes_rest:
            self._report("ArduSub has not confirmed that it is disarmed; the order is repeated")
        return False

    def _leave(self, was_armed: bool) -> None:
        self.link.close()
