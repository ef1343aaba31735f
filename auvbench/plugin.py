"""What a package needs that enters agents or simulators into auvbench (docs/adding-a-controller.md).

An agent is made by `factory(config, vehicle)` from the whole configuration, a simulator by `factory(config, vehicle, n,
max_step)` from its own part of it, for n vehicles and steps of at most `max_step` s; the entry point names
the factory, and its attribute `Config` is the dataclass of what its YAML file says.
"""

from auvbench.agents.base import Agent, Callbacks, Environment, Learner, Transition
from auvbench.agents.components import Components
from auvbench.config.installed import AgentConfig, SimulatorConfig
from auvbench.config.schema import TrainConfig, choice, number
from auvbench.config.simulators import Capabilities
from auvbench.errors import AgentError, ConfigError, RunError, TrainingError
from auvbench.simulators.base import Simulator
from auvbench.vehicles.vehicle_model import VehicleModel

__all__ = [
    "Agent",
    "AgentConfig",
    "AgentError",
    "Callbacks",
    "Capabilities",
    "Components",
    "ConfigError",
    "Environment",
    "Learner",
    "RunError",
    "Simulator",
    "SimulatorConfig",
    "TrainConfig",
    "TrainingError",
    "Transition",
    "VehicleModel",
    "choice",
    "number",
]
