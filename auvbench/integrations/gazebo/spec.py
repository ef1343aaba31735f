"""Define the simulator Gazebo: its schema and its spec."""

from __future__ import annotations

from dataclasses import dataclass, replace

from auvbench.config.fields import choice, number
from auvbench.config.simulators import Capabilities, Simulator, SimulatorSpec


@dataclass(kw_only=True)
class Gazebo(Simulator):
    """Gazebo Harmonic in this process."""

    max_step: float = number(0.0, 1.0, open_low=True)  # s
    hydrodynamics: str = choice("corrected", "published")

    def limited(self, capabilities: Capabilities) -> Capabilities:
        # The published plugin takes a current only when a vehicle is created.
        return replace(capabilities, currents="steady") if self.hydrodynamics == "published" else capabilities


simulator = SimulatorSpec(
    "gazebo",
    "auvbench.integrations.gazebo.simulator:make",
    Capabilities(exact_resume=False, deterministic=True, scales=True, currents="sheared", forces=True),
    Gazebo,
    full="simulator.hydrodynamics=corrected",
    check="auvbench.integrations.gazebo.simulator:check",
)
