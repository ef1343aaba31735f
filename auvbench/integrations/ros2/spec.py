"""Define the simulator of a ROS 2 server: its schema and its spec."""

from __future__ import annotations

from dataclasses import dataclass, replace

from auvbench.config.fields import choice, number
from auvbench.config.simulators import Capabilities, Simulator, SimulatorSpec


@dataclass(kw_only=True)
class Ros2(Simulator):
    """Simulator on a server with auvbench's ROS 2 interface."""

    namespace: str | None
    clock: str = choice("auto", "lockstep", "clock", "wall")
    timeout: float = number(0.0, 1e4, open_low=True)  # s

    def limited(self, capabilities: Capabilities) -> Capabilities:
        if self.clock == "lockstep":
            return capabilities
        # The capabilities of the server are unknown, and messages arrive late.
        return replace(capabilities, deterministic=False, scales=False, currents="steady")


simulator = SimulatorSpec(
    "ros2",
    "auvbench.integrations.ros2.simulator:make",
    Capabilities(exact_resume=False, deterministic=True, scales=True, currents="sheared"),
    Ros2,
    full="simulator.clock=lockstep",
    served="auvbench.integrations.ros2.simulator:Served",
)
