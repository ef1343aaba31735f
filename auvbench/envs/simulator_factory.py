"""The simulator that a configuration names, and what follows from it: how many vehicles it has, how long its step may be."""

from __future__ import annotations

import dataclasses

from auvbench.config import schema, simulators
from auvbench.config.schema import SCALES
from auvbench.registry import SIMULATORS, owner, resolve, telling
from auvbench.simulators.base import Simulator
from auvbench.vehicles import sheet
from auvbench.vehicles.inspect import shortest_drawn_time_constant, shortest_time_constant
from auvbench.vehicles.vehicle_model import VehicleModel


def at_once(config: schema.TrainConfig, wanted: int) -> int:
    """Return how many of `wanted` vehicles the simulator can have: all of them, or those of the ROS 2 server.

    Raises:
        ConfigError: there is no such server.
    """
    served = SIMULATORS[config.simulator.name].served
    if not served:
        return wanted
    return min(wanted, int(resolve(served).vehicles(config.simulator, sheet.load(config.vehicle))))


def make_simulator(
    config: simulators.Simulator,
    vehicle: VehicleModel,
    n: int,
    drawn: schema.Randomisation | None = None,
    stand_in: VehicleModel | None = None,
) -> Simulator:
    """Return the simulator that the configuration names.

    Its step is no longer than the shortest time constant of any vehicle that may be drawn, even if the configuration
    allows. RK4 would be stable up to 2.78 of them: the rest is for currents and what turns faster than thrust alone
    makes it.

    Args:
        drawn: the ranges from which vehicles are drawn; None where all are the sheet's.
        stand_in: what is simulated in the vehicle's place, with the vehicle's step: the same, commanded otherwise.
    """
    limit = _shortest_time_constant(vehicle, drawn)
    sheet.refuse_stiff_vehicle(vehicle.name, limit)
    vehicle = stand_in or vehicle
    spec = SIMULATORS[config.name]
    if not isinstance(config, simulators.SimulatorConfig):
        own: Simulator = resolve(spec.code)(config, vehicle, n, limit)
        return own
    from auvbench.simulators import guard

    who = owner("simulator", config)
    with telling(who, "cannot be made"):
        made = resolve(spec.code)(config, vehicle, n, limit)
    return guard.checked(made, who)


def _shortest_time_constant(vehicle: VehicleModel, drawn: schema.Randomisation | None) -> float:
    if drawn is None:
        return shortest_time_constant(vehicle)
    ranges = {name: getattr(drawn, name) for name in SCALES}
    factors = {name: (scale.low, scale.high) for name, scale in ranges.items()}
    return shortest_drawn_time_constant(vehicle, factors, keep_trim=drawn.keep_trim)


def at_frequency(config: schema.TrainConfig, frequency: float) -> schema.TrainConfig:
    """Return the configuration with another agent step."""
    return dataclasses.replace(config, step=dataclasses.replace(config.step, frequency=frequency))
