"""Names, types and frames of the interface: that of Centrale Nantes' BlueROV2, and services of a benchmark.

World ENU (frame `world`, surface at z = 0), body FLU (frame `<namespace>/base_link`), as in REP-103. Users read
docs/ros2.md.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from auvbench.errors import ConfigError

WORLD = "world"
CLOCK = "/clock"
CURRENT = "/current"
NODE = "simulator"
"""Name of the node in a vehicle's namespace that has its parameters."""

DEPTH = 10
"""Messages kept for a slow reader; QoS is reliable, volatile, keep last."""

_TOKEN = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


@dataclass(frozen=True, slots=True)
class Names:
    """Topics and services of one vehicle."""

    namespace: str

    def of(self, name: str) -> str:
        """Return the full name of a topic or service in the vehicle's namespace."""
        return f"/{self.namespace}/{name}"

    def command(self, actuator: str) -> str:
        """Return the topic of an actuator's command: std_msgs/Float64; N of a thruster, else rad, m or m3."""
        return self.of(f"cmd_{actuator}")

    @property
    def pose(self) -> str:
        """geometry_msgs/Pose in the world."""
        return self.of("pose_gt")

    @property
    def odometry(self) -> str:
        """nav_msgs/Odometry: pose in the world, twist in the body."""
        return self.of("odom")

    @property
    def reset(self) -> str:
        """std_srvs/Trigger: to the parameters `start_pose` and `start_velocity`, the rest at rest."""
        return self.of("reset")

    @property
    def pause(self) -> str:
        """std_srvs/SetBool: stop the world, or let it go on."""
        return self.of("pause")

    @property
    def step(self) -> str:
        """std_srvs/Trigger: `steps` steps of `step_duration`, answered when done; the world is paused then."""
        return self.of("step")

    @property
    def lockstep(self) -> str:
        """std_srvs/SetBool: let each step wait for a new command to every actuator; answers the time in ns."""
        return self.of("lockstep")

    @property
    def parameters(self) -> str:
        """rcl_interfaces/SetParameters of the vehicle's node."""
        return self.of(f"{NODE}/set_parameters")


def namespaces(base: str, n: int) -> list[str]:
    """Return the namespaces of n vehicles in one world; the first has the world's services.

    Raises:
        ConfigError: `base` is not a valid namespace.

    >>> namespaces("bluerov2", 1), namespaces("bluerov2", 2)
    (['bluerov2'], ['bluerov2_1', 'bluerov2_2'])
    """
    name = base.strip("/")
    if not name or not all(_TOKEN.fullmatch(token) for token in name.split("/")):
        raise ConfigError(
            f"namespace {base!r}: must have letters, digits and underscores, and must not begin with a digit, e.g. bluerov2"
        )
    return [name] if n == 1 else [f"{name}_{i + 1}" for i in range(n)]


def nanoseconds(duration: float) -> int:
    """Return a step's length in ns, as the clock counts it.

    >>> nanoseconds(0.1)
    100000000
    """
    return round(duration * 1e9)
