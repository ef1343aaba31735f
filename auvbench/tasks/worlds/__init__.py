"""Worlds: the solids in the water of an episode.

`base` defines a world, `surroundings` has the solids of N episodes, `contact` measures clearances, and each other file is one world.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from auvbench.config import schema
    from auvbench.tasks.worlds.surroundings import Surroundings
    from auvbench.vehicles.vehicle_model import VehicleModel


def make(config: schema.TrainConfig, vehicle: VehicleModel, n: int) -> Surroundings | None:
    """Return the surroundings of N episodes; None in open water."""
    if not config.world.solid:
        return None
    from auvbench.tasks.worlds.surroundings import Surroundings  # with the geometry of solids

    return Surroundings(config, vehicle, n)
