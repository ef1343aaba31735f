"""Public names for packages that add agents, tasks, rewards, blocks of observations, disturbances, simulators,
launchers, trackers or commands to auvbench.

The entry point of an agent names a function `factory(config, vehicle)`, where `config` is the whole configuration of the run.
The function's attribute `Config` is a dataclass with the keys of the agent's YAML file. The entry point of a task names a `TaskSpec`,
the entry point of a reward a `RewardSpec`, and so on (docs/adding-a-package.md). The code of tasks and rewards also
imports `auvbench.tasks.base` and `auvbench.tasks.rows`; the code of disturbances also imports
`auvbench.tasks.disturbances.base`.
"""

from auvbench.agents.base import Agent, Callbacks, Components, Learner
from auvbench.blocks import BlockSpec
from auvbench.config.algorithms import AgentConfig, AgentSpec
from auvbench.config.commands import CommandSpec
from auvbench.config.disturbances import DisturbanceConfig, DisturbanceSpec, Need, forces
from auvbench.config.fields import below
from auvbench.config.launchers import LauncherConfig, LauncherSpec
from auvbench.config.rewards import RewardConfig, RewardSpec
from auvbench.config.schema import TrainConfig, choice, number
from auvbench.config.simulators import Capabilities, SimulatorConfig, SimulatorSpec
from auvbench.config.tasks import ERRORS, TaskConfig, TaskSpec
from auvbench.config.trackers import TrackerSpec
from auvbench.envs.batch import Batch, Transition
from auvbench.errors import AgentError, ConfigError, RunError, TrainingError
from auvbench.metrics import column
from auvbench.observation import Block
from auvbench.vehicles.vehicle_model import VehicleModel

__all__ = [
    "ERRORS",
    "Agent",
    "AgentConfig",
    "AgentError",
    "AgentSpec",
    "Batch",
    "Block",
    "BlockSpec",
    "Callbacks",
    "Capabilities",
    "CommandSpec",
    "Components",
    "ConfigError",
    "DisturbanceConfig",
    "DisturbanceSpec",
    "LauncherConfig",
    "LauncherSpec",
    "Learner",
    "Need",
    "RewardConfig",
    "RewardSpec",
    "RunError",
    "SimulatorConfig",
    "SimulatorSpec",
    "TaskConfig",
    "TaskSpec",
    "TrackerSpec",
    "TrainConfig",
    "TrainingError",
    "Transition",
    "VehicleModel",
    "below",
    "choice",
    "column",
    "forces",
    "number",
]
