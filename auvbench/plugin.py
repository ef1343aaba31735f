"""What a package imports to bring agents, tasks or rewards to auvbench (docs/adding-a-controller.md).

An agent is made by `factory(config, vehicle)` from the whole configuration; the entry point names the
factory, and its attribute `Config` is the dataclass of what its YAML file says. A task is a `TaskSpec`, a reward a
`RewardSpec` (docs/adding-a-task.md); their code takes `auvbench.tasks.base` and `auvbench.tasks.kernels` too.
"""

from auvbench.agents.base import Agent, Callbacks, Components, Learner
from auvbench.config.algorithms import AgentConfig
from auvbench.config.rewards import RewardConfig, RewardSpec
from auvbench.config.schema import TrainConfig, choice, number
from auvbench.config.tasks import ERRORS, TaskConfig, TaskSpec
from auvbench.envs.batch import Batch, Transition
from auvbench.errors import AgentError, ConfigError, RunError, TrainingError
from auvbench.metrics import column
from auvbench.vehicles.vehicle_model import VehicleModel

__all__ = [
    "ERRORS",
    "Agent",
    "AgentConfig",
    "AgentError",
    "Batch",
    "Callbacks",
    "Components",
    "ConfigError",
    "Learner",
    "RewardConfig",
    "RewardSpec",
    "RunError",
    "TaskConfig",
    "TaskSpec",
    "TrainConfig",
    "TrainingError",
    "Transition",
    "VehicleModel",
    "choice",
    "column",
    "number",
]
