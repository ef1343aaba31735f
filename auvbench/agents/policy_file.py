"""Steer with an ONNX file that was trained or written elsewhere (`algo=onnx`)."""

from __future__ import annotations

import time
from hashlib import sha256
from pathlib import Path

from auvbench.agents.base import Actions, Integers, Observations
from auvbench.config import schema
from auvbench.config.algorithms.onnx import ONNX
from auvbench.policies import exported
from auvbench.tasks.observation_spec import observation_spec
from auvbench.vehicles.vehicle_model import VehicleModel


class PolicyFile:
    """Agent that acts by the ONNX file in a run's `model/`; `load` reads the file."""

    def __init__(self, config: schema.TrainConfig, vehicle: VehicleModel) -> None:
        algo = config.algo
        assert isinstance(algo, ONNX)
        self._sha256 = algo.sha256
        self._n_u = len(vehicle.actuators)
        self._spec = observation_spec(config.task, vehicle.actuators)
        self.policy: exported.Policy | None = None

    def load(self, folder: Path) -> None:
        """Read the file in a run's `model/`.

        Raises:
            PolicyError: the file is missing, damaged, of another shape, or not the run's original file.
            MissingExtraError: ONNX Runtime is not installed.
        """
        path = folder / exported.NETWORK
        data, card, _ = exported.read(path)
        if sha256(data).hexdigest() != self._sha256:
            raise exported.PolicyError(
                f"{path}: is not the file that the run was made with (algo.sha256 differs); restore that file"
            )
        sizes = {"observations": self._spec.size, "actions": self._n_u}
        self.policy = exported.Policy(data, str(path), card=card, **sizes)

    def processor_time(self) -> float:
        """Return the processor time in s of this process plus the processor time of the policy's process."""
        assert self.policy is not None, "load comes first"
        return time.process_time() + self.policy.seconds

    def reset(self, episodes: Integers) -> None:
        """Do nothing: the network has no state."""

    def act(self, observation: Observations) -> Actions:
        """Return actions (n, n_u).

        Raises:
            PolicyError: the file returns an invalid action.
        """
        assert self.policy is not None, "load comes first"
        return self.policy.act(observation)
