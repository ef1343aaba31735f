"""A reward: near the reference with the bow on it, and little effort."""

import math
from dataclasses import dataclass

from auvbench.plugin import RewardConfig, RewardSpec, number
from auvbench.tasks.kernels import COLLISION, OUT_OF_BOUNDS


@dataclass(kw_only=True)
class ViewConfig(RewardConfig):
    """The parameters behind `k`, in their order."""

    length: float = number(0.0, 1e3, open_low=True)  # m
    effort: float = number(0.0, 1e3)
    failure: float = number(-1e6, 1e6)


def view(i, outcome, distance, yaw_error, pose, velocity, action, previous, F, p):
    """Return the reward of a step of environment i; p holds the parameters, k first."""
    k, length, effort, failure = p[0], p[1], p[2], p[3]
    if outcome in (COLLISION, OUT_OF_BOUNDS):
        return k * failure
    squared = 0.0
    for j in range(action.shape[1]):
        squared += action[i, j] ** 2
    seen = max(0.0, math.cos(yaw_error)) * math.exp(-distance / length)
    return k * (seen - effort * squared / action.shape[1])


SPEC = RewardSpec(
    name="view",
    function="auvbench_example.view:view",
    schema=ViewConfig,
    tasks=("station_keeping", "trajectory_tracking"),
)
