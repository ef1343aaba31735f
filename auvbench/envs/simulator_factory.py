"""Create the simulator of a configuration, with its number of vehicles and its longest step."""

from __future__ import annotations

import dataclasses

from auvbench.config import schema, simulators
from auvbench.registry import SIMULATORS, owner, resolve, telling
from auvbench.simulators.base import Simulator
from auvbench.tasks.disturbances.base import extreme
from auvbench.vehicles import sheet
from auvbench.vehicles.inspect import shortest_drawn_time_constant, shortest_time_constant
from auvbench.vehicles.vehicle_model import VehicleModel


def at_once(config: schema.TrainConfig, vehicles: int) -> int:
    """Return how many of `vehicles` the simulator can simulate at once: all, or at most the number of vehicles of its ROS 2 server.

    Raises:
        ConfigError: the server does not exist.
    """
    served = SIMULATORS[config.simulator.name].served
    if not served:
        return vehicles
    return min(vehicles, int(resolve(served).vehicles(config.simulator, sheet.load(config.vehicle))))


def make_simulator(
    config: simulators.Simulator,
    vehicle: VehicleModel,
    n: int,
    disturbance: schema.Disturbance | None = None,
    stand_in: VehicleModel | None = None,
) -> Simulator:
    """Return the simulator that the configuration names.

    The simulator's step is at most the shortest time constant of all vehicles that may be drawn, even if the
    configuration allows a longer step. RK4 is stable up to 2.78 time constants. The margin between
    1 and 2.78 is for currents, and for vehicles that turn faster than their thrust could turn them.

    Args:
        disturbance: disturbance that may draw vehicles; None if all vehicles equal the sheet.
        stand_in: model to simulate instead of `vehicle`: the same vehicle with other commands. The longest step still
            follows from `vehicle`.
    """
    limit = _shortest_time_constant(vehicle, disturbance)
    sheet.refuse_stiff_vehicle(vehicle.name, limit)
    vehicle = stand_in or vehicle
    spec = SIMULATORS[config.name]
    if not isinstance(config, simulators.SimulatorConfig):
        own: Simulator = resolve(spec.code)(config, vehicle, n, limit)
        return own
    from auvbench.simulators import guard

    owner_name = owner("simulator", config)
    with telling(owner_name, "cannot be made"):
        instance = resolve(spec.code)(config, vehicle, n, limit)
    return guard.checked(instance, owner_name)


def _shortest_time_constant(vehicle: VehicleModel, disturbance: schema.Disturbance | None) -> float:
    if disturbance is None:
        return shortest_time_constant(vehicle)
    drawn = disturbance.randomisation
    vehicle = extreme(vehicle, disturbance, 1.0)
    return shortest_drawn_time_constant(vehicle, drawn.ranges(), keep_trim=drawn.keep_trim)


def at_frequency(config: schema.TrainConfig, frequency: float) -> schema.TrainConfig:
    """Return the configuration with another frequency of agent steps, Hz."""
    return dataclasses.replace(config, step=dataclasses.replace(config.step, frequency=frequency))
