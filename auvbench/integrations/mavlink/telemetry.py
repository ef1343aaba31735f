"""Read the vehicle's motion from ArduSub's telemetry; times are by ArduSub's clock."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.dynamics import frames

Floats = NDArray[np.float64]

FIELDS = {
    "ATTITUDE": ("roll", "pitch", "yaw", "rollspeed", "pitchspeed", "yawspeed"),
    "LOCAL_POSITION_NED": ("x", "y", "z", "vx", "vy", "vz"),
}
"""messages of telemetry, with their fields"""
BACK = 500
"""time in ms by which a message may be older than the last message of its kind; an older message means that the clock restarted"""
BEAT = 1000
"""longest regular interval between heartbeats, ms"""
TURNED = 7.0
"""largest valid angle of an attitude, rad"""


class Telemetry:
    """Last telemetry message of each kind, and the times of heartbeats."""

    def __init__(self) -> None:
        self.told: dict[str, tuple[int, Floats]] = {}
        """last message of each kind: time in ms since boot, and its numbers"""
        self._beaten: tuple[int, int] | None = None  # time of the last heartbeat, and interval before it, ms

    def take(self, message: Any) -> None:
        """Store a message of a kind in `FIELDS`, unless the message is old or its numbers are invalid."""
        kind, stamp = message.get_type(), message.time_boot_ms
        numbers = [getattr(message, name) for name in FIELDS[kind]]
        last = self.told.get(kind, (-1, None))[0]
        if not all(map(math.isfinite, numbers)):
            return
        if kind == "ATTITUDE" and max(map(abs, numbers[:3])) > TURNED:
            return
        if stamp < last - BACK:
            self.told.clear()  # ArduSub restarted, and the other messages are from before the restart
            self._beaten = None
        elif stamp <= last:
            return
        self.told[kind] = (stamp, np.array(numbers, dtype=np.float64))

    def beat(self) -> None:
        """Record a heartbeat."""
        if self.told:
            now = self._time
            self._beaten = (now, min(now - self._beaten[0], BEAT) if self._beaten else BEAT)

    @property
    def _time(self) -> int:
        return max(stamp for stamp, _ in self.told.values())

    @property
    def overdue(self) -> float:
        """Return by how many seconds the next heartbeat is late while other telemetry continues.

        Only heartbeats show a change of mode.
        """
        if self._beaten is None:
            return 0.0
        last, interval = self._beaten
        return (self._time - last - interval) / 1e3

    @property
    def state(self) -> tuple[int, Floats, Floats] | None:
        """Return time in ns, pose in ENU and velocity in body axes FLU; None until both kinds of messages have arrived.

        The time is the time of the older message. The pose has shape (7,), the velocity (6,).
        """
        if len(self.told) < 2:
            return None
        (turned, attitude), (placed, position) = self.told["ATTITUDE"], self.told["LOCAL_POSITION_NED"]
        turn = frames.quaternion(attitude[:3])
        straight = frames.rotation(turn).T @ position[3:]
        # Each of the two conversions is its own inverse.
        pose = np.array([*frames.ned(position[:3].tolist()), *frames.ned_attitude(turn.tolist())])
        return min(turned, placed) * 1_000_000, pose, frames.flip([*straight, *attitude[3:]])

    @property
    def missing(self) -> str:
        """Return the kind of telemetry message that has not arrived yet, for error messages; '' if each kind has arrived."""
        return next((kind for kind in FIELDS if kind not in self.told), "")
