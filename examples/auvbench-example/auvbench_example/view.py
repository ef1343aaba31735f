"""A reward for small distance to the reference, small yaw error, and little effort."""

import math
from dataclasses import dataclass

from auvbench.plugin import RewardConfig, RewardSpec, number
from auvbench.tasks.rewards import effort, failed
from auvbench.tasks.rows import row


@dataclass(kw_only=True)
class ViewConfig(RewardConfig):
    """Parameters of the reward in addition to `k`."""

    length: float = number(0.0, 1e3, open_low=True)  # m
    effort: float = number(0.0, 1e3)
    failure: float = number(-1e6, 1e6)


@row
def view(e, v, p):
    """Return the reward of a step of the episode e with the vehicle v and the parameters p."""
    if failed(e):
        return p.k * p.failure
    seen = max(0.0, math.cos(e.yaw_error)) * math.exp(-e.to_go / p.length)
    return p.k * (seen - p.effort * effort(v) / len(v.action))


SPEC = RewardSpec(
    name="view",
    function="auvbench_example.view:view",
    schema=ViewConfig,
    tasks=("station_keeping", "trajectory_tracking"),
)
