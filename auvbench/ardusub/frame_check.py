"""Whether ArduSub has the frame of the vehicle, by the channels that it uses."""

from __future__ import annotations

from collections.abc import Sequence

from auvbench.ardusub.frames import FRAMES, NEUTRAL, Motors, driven_pulse
from auvbench.errors import UserError

_DIFFERENCE = 5
"""us from neutral from which a motor turns"""
_SUSPICION = 50
"""packets in a row that look like those of another frame until they are believed"""


class FrameCheck:
    """Finds out from the channels in use whether ArduSub has the frame of the vehicle."""

    def __init__(self, motors: Motors) -> None:
        self._motors = motors
        self._suspicion = 0

    def check(self, pwm: Sequence[int]) -> None:
        """Take a packet's PWM in us.

        Raises:
            UserError: ArduSub drives fewer motors than the vehicle has, or the eight of another frame.
        """
        count = len(self._motors.order)
        turning = any(driven_pulse(p) and abs(p - NEUTRAL) > _DIFFERENCE for p in pwm[:count])
        if not turning:  # before ArduSub is set up, channels have no pulse
            return
        for channel, pulse in enumerate(pwm[:count], 1):
            if not driven_pulse(pulse):
                raise self._other(f"channel {channel} has no PWM: ArduSub has fewer than {count} motors")
        if self._motors.frame is not FRAMES["vectored"]:
            return
        # Of the four vertical motors of vectored_6dof, roll and pitch cancel on the diagonals; PWM is rounded.
        a, b, c, d = pwm[4:8]
        moved = all(driven_pulse(p) and abs(p - NEUTRAL) > _DIFFERENCE for p in (c, d))
        self._suspicion = self._suspicion + 1 if moved and abs(a + d - b - c) <= 4 else 0
        if self._suspicion >= _SUSPICION:
            raise self._other("channels 7 and 8 turn as motors of vectored_6dof (FRAME_CONFIG 2)")

    def _other(self, why: str) -> UserError:
        frame, name = self._motors.frame, self._motors.vehicle.name
        if frame is None:
            return UserError(f"{why}; {name} needs {len(self._motors.order)}, see FRAME_CONFIG and --motors")
        return UserError(
            f"{why}; vehicle={name} is {frame.name}: set FRAME_CONFIG to {frame.config} and reboot ArduSub, or serve another vehicle"
        )
