"""`algo=onnx`: a controller from an ONNX file, trained or written elsewhere."""

from __future__ import annotations

import time
from hashlib import sha256
from pathlib import Path

from auvbench.agents.base import Actions, Integers, Observations
from auvbench.config import algorithms, schema
from auvbench.policies import exported
from auvbench.tasks.observation import observation_spec
from auvbench.vehicles.vehicle_model import VehicleModel


class PolicyFile:
    """The policy that a run keeps in its `model/`; `load` reads it."""

    def __init__(self, config: schema.TrainConfig, vehicle: VehicleModel) -> None:
        algo = config.algo
        assert isinstance(algo, algorithms.ONNX)
        self._sha256 = algo.sha256
        self._n_u = len(vehicle.actuators)
        self._spec = observation_spec(config.task, vehicle.actuators)
        self.policy: exported.Policy | None = None

    def load(self, folder: Path) -> None:
        """Read the file in a run's `model/`.

        Raises:
            PolicyError: it is missing, damaged, of another shape, or not the one that the run was made with.
            MissingExtraError: ONNX Runtime is not installed.
        """
        path = folder / exported.NETWORK
        data, card, _ = exported.read(path)
        if sha256(data).hexdigest() != self._sha256:
            raise exported.PolicyError(
                f"{path}: is not the file that the run was made with (algo.sha256 differs)"
            )
        sizes = {"observations": self._spec.size, "actions": self._n_u}
        self.policy = exported.Policy(data, str(path), card=card, **sizes)

    def processor_time(self) -> float:
        """Return the seconds of processor time that this process and that of the policy have taken."""
        assert self.policy is not None, "load comes first"
        return time.process_time() + self.policy.seconds

    def reset(self, episodes: Integers) -> None:
        """Do nothing: the network keeps no state."""

    def act(self, observation: Observations) -> Actions:
        """Return actions (n, n_u).

        Raises:
            PolicyError: the file answers what is no action.
        """
        assert self.policy is not None, "load comes first"
        return self.policy.act(observation)
