"""An example simulator of a package (docs/adding-a-package.md)."""

from dataclasses import dataclass

from auvbench.plugin import Capabilities, SimulatorConfig, SimulatorSpec, number
from auvbench.simulators.base import VehicleBatch


@dataclass(kw_only=True)
class StillConfig(SimulatorConfig):
    """Keys of simulator/still.yaml, with their types and ranges."""

    drift: float = number(0.0, 1.0)  # m/s


CAN = Capabilities(exact_resume=True, deterministic=True, scales=False, currents="none")


class Still(VehicleBatch):
    """Vehicles that drift eastwards."""

    capabilities = CAN

    def __init__(self, vehicle, n, drift):
        super().__init__(vehicle, n, max_step=0.01)
        self.drift = drift

    def reset(self, indices, pose, velocity, scales=None):
        self._place(indices, pose, velocity)

    def step(self, command, duration):
        self.pose[:, 0] += self.drift * duration

    def state_dict(self):
        return {"pose": self.pose.copy()}

    def load_state_dict(self, state):
        self.pose[:] = state["pose"]


def make(settings, vehicle, n, longest):
    return Still(vehicle, n, settings.drift)


SPEC = SimulatorSpec("still", "still:make", CAN, StillConfig)
