"""Refuse a run that cannot work on this machine before anything of it is written."""

from __future__ import annotations

from auvbench.agents import base as agents
from auvbench.config import schema, simulators
from auvbench.config.agents import AGENTS, learns
from auvbench.vehicles import sheet


def check_runnable(config: schema.TrainConfig) -> None:
    """Make the controller that a checked configuration names, and load its simulator.

    Learners are left out: they work with every vehicle and take seconds to build. So are ROS 2 servers, which may
    start later.

    Raises:
        ConfigError: the controller cannot steer the vehicle, or Gazebo is not installed.
        VehicleError: Gazebo cannot simulate the vehicle.
        MissingExtraError: the controller needs a package that is not installed.
    """
    vehicle = sheet.load(config.vehicle)
    if isinstance(config.simulator, simulators.Gazebo):
        from auvbench.simulators.gazebo import bindings, sdf

        sdf.check_vehicle(vehicle, config.simulator.hydrodynamics)
        bindings.modules()
    if config.algo.agent in AGENTS and not learns(config.algo):
        agents.make(config, vehicle)
