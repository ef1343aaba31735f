"""Draw the vehicle of each episode from the joint covariance that `auvbench identify` wrote into its sheet."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from auvbench.config.disturbances import DisturbanceSpec, Factor, Need
from auvbench.config.fields import number
from auvbench.dynamics.compiled import compiled
from auvbench.dynamics.random import IDENTIFIED, normal4
from auvbench.errors import ConfigError
from auvbench.simulators.base import DrawnSimulator, Simulator
from auvbench.tasks.disturbances.base import Array, Disturbance
from auvbench.vehicles.drawn import DrawnVehicles
from auvbench.vehicles.vehicle_model import VehicleModel

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(kw_only=True)
class Identified(Factor):
    """Vehicles drawn from the covariance of an identification."""

    spread: float = number(0.0, 2.0)  # factor on the standard deviations; 0: inactive

    @property
    def active(self) -> bool:
        return self.spread > 0.0

    def needs(self, key: str) -> Iterator[Need]:
        yield Need(key, "vehicles drawn from an identification", lambda can: can.vehicles)


@compiled("dynamics")
def draw_differences(
    indices: Integers, episodes: Any, root: Floats, reach: Floats, test: int, x: Floats
) -> None:
    """Draw the normalised parameters of each new episode's vehicle; write parameter minus estimate to x (n, n_p).

    The differences are normal, with the covariance `root` `root`^T, and clipped to +-`reach` (n_p,).
    """
    size = root.shape[0]
    z = np.empty(size + 3)
    for k in range(indices.shape[0]):
        i = indices[k]
        e = episodes[i]
        for block in range((size + 3) // 4):
            first = 4 * block
            z[first], z[first + 1], z[first + 2], z[first + 3] = normal4(
                e.seed, IDENTIFIED | test, block, 0, e.episode, e.environment
            )
        for j in range(size):
            total = 0.0
            for m in range(size):
                total += root[j, m] * z[m]
            x[i, j] = min(max(total, -reach[j]), reach[j])


class IdentifiedVehicles(Disturbance):
    """The vehicles of N episodes.

    Raises:
        ConfigError: see `check`.
    """

    settings: Identified

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.drawn = drawn(self.settings, self.vehicle)
        self.x: Floats = np.zeros((self.task.n, len(self.drawn.reach)))
        """(n, n_p) differences of normalised parameters from their estimates"""
        self._new: Integers = np.empty(0, dtype=np.int64)

    @staticmethod
    def check(settings: Identified, vehicle: VehicleModel) -> None:
        """Check that the vehicle's sheet has an identification.

        Raises:
            ConfigError: the sheet has no identification, or the identification names a parameter that the vehicle does not have.
        """
        if settings.active:
            drawn(settings, vehicle)

    @staticmethod
    def extreme(settings: Identified, vehicle: VehicleModel, damping: float) -> VehicleModel:
        return drawn(settings, vehicle).extreme(damping)

    def draw_rows(self, indices: Integers) -> None:
        task, own = self.task, self.drawn
        draw_differences(indices, task.rows, own.root, own.reach, task.stream, self.x)
        self._new = indices

    def give(self, simulator: Simulator) -> None:
        """Give a simulator the vehicles of the episodes that were drawn last."""
        changes, gains = self.drawn.changes(self.x[self._new])
        # A configuration with this disturbance always has a DrawnSimulator.
        cast(DrawnSimulator, simulator).set_vehicles(self._new, changes)
        simulator.effectiveness[self._new] *= gains

    def arrays(self) -> dict[str, Array]:
        return {"x": self.x}


def drawn(settings: Identified, vehicle: VehicleModel) -> DrawnVehicles:
    """Return the distribution from which vehicles are drawn.

    Raises:
        ConfigError: see `IdentifiedVehicles.check`.
    """
    if vehicle.identified is None:
        raise ConfigError(
            f"disturbance.identified.spread={settings.spread:g}: the sheet of vehicle={vehicle.name} has no identification with a"
            " covariance; use a sheet that auvbench identify has written"
        )
    return DrawnVehicles.of(vehicle, vehicle.identified, settings.spread)


identified = DisturbanceSpec(
    "identified",
    "vehicles drawn from an identification",
    "auvbench.tasks.disturbances.identified:IdentifiedVehicles",
    Identified,
)
