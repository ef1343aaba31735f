"""Draw uncertain properties of the vehicle anew in each episode."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.config.disturbances import SCALES, Randomisation
from auvbench.dynamics.random import RANDOMISATION, uniform4
from auvbench.errors import ConfigError
from auvbench.tasks.disturbances.base import Disturbance
from auvbench.tasks.records import Record
from auvbench.tasks.rows import row
from auvbench.vehicles.vehicle_model import VehicleModel

_MASS, _BUOYANCY = SCALES.index("mass"), SCALES.index("buoyancy")


@row
def draw(e: Record, d: Record, p: Record, stream: int) -> None:
    """Draw factors on mass, buoyancy, inertia, added mass, damping and thrust.

    With `keep_trim` the factor on buoyancy is multiplied by (B + (s - 1) W) / B, where s is the factor on mass.
    Then the net buoyancy B - W depends on the drawn factor on buoyancy, but not on the factor on mass.
    """
    u = uniform4(e.seed, RANDOMISATION | stream, 0, 0, e.episode, e.environment)
    v = uniform4(e.seed, RANDOMISATION | stream, 1, 0, e.episode, e.environment)
    mass = 1.0
    for j in range(6):
        low, high = p.low[j], p.high[j]
        fraction = u[j] if j < 4 else v[j - 4]
        if p.logarithmic > 0:
            factor = low * math.exp(fraction * math.log(high / low))
        else:
            factor = low + (high - low) * fraction
        if j == _MASS:
            mass = factor
        elif j == _BUOYANCY and p.keep_trim > 0:
            factor *= 1.0 + (mass - 1.0) * p.weight_ratio
        d.scales[j] = factor


class DrawnVehicles(Disturbance):
    """The vehicles of N episodes.

    Raises:
        ConfigError: see `check`.
    """

    draw = staticmethod(draw)
    fields = (("scales", "f8", (len(SCALES),)),)

    def own_parameters(self, settings: Randomisation) -> dict[str, Any]:
        self.check(settings, self.vehicle)
        ends = settings.ranges().values()
        return {
            "low": [low for low, _ in ends],
            "high": [high for _, high in ends],
            "logarithmic": settings.distribution == "log_uniform",
            "keep_trim": settings.keep_trim,
            "weight_ratio": _weight_ratio(self.vehicle),
        }

    @staticmethod
    def check(settings: Randomisation, vehicle: VehicleModel) -> None:
        """With `keep_trim`, check that every vehicle that may be drawn has buoyancy.

        Raises:
            ConfigError: the lightest drawn vehicle would have no buoyancy.
        """
        low, ratio = settings.mass.low, _weight_ratio(vehicle)
        if settings.keep_trim and 1.0 + (low - 1.0) * ratio <= 0.0:
            raise ConfigError(
                f"disturbance.randomisation.mass.low={low:g}: keep_trim would leave {vehicle.name} without "
                f"buoyancy; must be more than {1.0 - 1.0 / ratio:.3g}"
            )

    def scales(self, indices: NDArray[np.int64]) -> NDArray[np.float64]:
        return self.field["scales"][indices]


def _weight_ratio(vehicle: VehicleModel) -> float:
    """Return the ratio of the sheet's weight to its buoyancy; 0 without buoyancy."""
    return vehicle.weight / vehicle.buoyancy if vehicle.buoyancy > 0.0 else 0.0
