"""Give ArduSub a DVL in place of GPS, as BlueOS's extension for the Water Linked A50 does.

Source of the parameters, the message and the confidence: `dvl-a50/dvl.py` of bluerobotics/BlueOS-Water-Linked-DVL,
commit 6022f84.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from auvbench.config import schema
from auvbench.errors import ConfigError
from auvbench.integrations.ardusub.radio import Radio
from auvbench.integrations.ardusub.sensors import frd
from auvbench.tasks.navigation.dvl import ENOUGH
from auvbench.tasks.navigation.state import DVL

if TYPE_CHECKING:
    from auvbench.tasks.navigation.estimator import Navigation

NO_GPS = {"SIM_GPS1_ENABLE": 0.0}
EXTERNAL = {"VISO_TYPE": 1.0, "EK3_SRC1_POSXY": 6.0, "EK3_SRC1_VELXY": 6.0, "EK3_SRC1_POSZ": 1.0}
"""parameters by which ArduSub takes horizontal motion from MAVLink messages, and height from the pressure sensor"""
WORST = 0.4
"""figure of merit in m/s at and above which the confidence of a ping is 0"""


def parameters(config: schema.TrainConfig) -> dict[str, float]:
    """Return ArduSub's parameters for the sensors of a configuration; an empty dictionary without an estimator."""
    sensors = config.sensors
    if not sensors.names():
        return {}
    if sensors.dvl is None:
        return NO_GPS
    place = dict(zip("XYZ", frd(sensors.dvl.lever), strict=True))
    lever = {f"VISO_POS_{axis}": value for axis, value in place.items()}
    return NO_GPS | EXTERNAL | lever | {"VISO_DELAY_MS": float(round(1e3 * sensors.dvl.delay))}


def check(config: schema.TrainConfig, mode: str) -> None:
    """Raise ConfigError if ArduSub cannot use a configured sensor, or if `mode` needs a sensor that is not configured."""
    sensors = config.sensors
    names = sensors.names()
    if unread := [name for name in ("usbl", "gnss") if name in names]:
        raise ConfigError(f"sensors.{unread[0]}: cannot be given to algo=ardusub; use sensors=dvl_a50")
    if names and sensors.dvl is None and mode != "alt_hold":
        raise ConfigError(
            f"algo.mode={mode}: ArduSub refuses this mode if it has neither GPS nor a DVL; use algo.mode=alt_hold, or sensors=dvl_a50"
        )


class Forwarder:
    """Forwards the pings of a vehicle's DVL to ArduSub.

    Args:
        navigation: sensors and estimate of one vehicle.
    """

    def __init__(self, navigation: Navigation) -> None:
        self._state = navigation.state[0]
        self.begin()

    def begin(self) -> None:
        """Begin an episode at time 0."""
        self._seen = 0.0

    def forward(self, radio: Radio) -> None:
        """Send the newest bottom ping to ArduSub if it is valid and has arrived since the last call."""
        d = self._state
        measured = float(d.stamp[DVL])
        if d.beams < ENOUGH or d.on_water or measured <= self._seen:
            return
        elapsed, self._seen = measured - self._seen, measured
        confidence = 100.0 * (1.0 - min(float(d.merit), WORST) / WORST)
        radio.moved(elapsed, frd(d.dvl_velocity.tolist()), frd((d.rates - d.rate_bias).tolist()), confidence)
