"""Filters of commands.

`barrier` keeps a vehicle away from solids and limits, `rows` computes the constraints on the command, and `quadratic` finds the
nearest command that meets these constraints.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from auvbench.registry import FILTERS, resolve

if TYPE_CHECKING:
    from auvbench.config import schema
    from auvbench.observation import ObservationSpec
    from auvbench.vehicles.vehicle_model import VehicleModel


def make(config: schema.TrainConfig, vehicle: VehicleModel, spec: ObservationSpec, n: int) -> Any:
    """Return the command filter for `n` episodes whose observations have the layout `spec`; None without a filter.

    Raises:
        ConfigError: the filter cannot protect the vehicle.
    """
    if not config.filter.acts:
        return None
    return resolve(FILTERS[config.filter.name].code)(config, vehicle, spec, n)
