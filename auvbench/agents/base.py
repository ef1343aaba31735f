"""Agent and Learner protocols, the components of a learner's checkpoint, and the agent factory."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from auvbench.config import schema
from auvbench.registry import AGENTS, resolve
from auvbench.untrusted import archives, reading
from auvbench.vehicles.vehicle_model import VehicleModel

if TYPE_CHECKING:
    from auvbench.envs.batch import Batch, Transition

Integers = NDArray[np.int64]
Observations = NDArray[np.float32]
Actions = NDArray[np.floating]


class Agent(Protocol):
    """Controller that maps a batch of observations to actions. `factory(config, vehicle)` creates it.

    An agent may also have:

    * `load(folder)`: read the run's `model/`; called before the first `reset`;
    * `row_by_row = True` in its class: the agent computes the actions of a batch one row after the other, so a test
      divides its episodes among processes;
    * `ended(rows)`: called with the indices of the batch's rows whose episodes have ended;
    * `simulator(config, vehicle, navigation)`: return the simulator for the agent's tests, with one vehicle. Only an
      agent that drives the actuators itself within an agent step has this method. The test then records the actions
      of `act`, but does not apply them. `navigation` describes the vehicle's sensors; None if agents observe the true state;
    * `notes()`: return counters by name, counted since the agent's creation. A test's summary contains the increase of
      each counter during the test.
    """

    def reset(self, episodes: Integers) -> None:
        """Begin the episodes with the given indices (n,), one per row, and forget all earlier episodes."""

    def act(self, observation: Observations) -> Actions:
        """Return actions (n, n_u) in [-1, 1] for observations (n, n_obs)."""


class Callbacks(Protocol):
    """Methods of a run that its learner calls.

    Call `begin` once, then `step` for each step of the environment, and `checkpoint` whenever the learner's
    state is complete. All methods may raise exceptions, which the learner must not catch.
    """

    total_steps: int  # budget in environment steps, summed over the n environments

    def begin(self) -> int:
        """Call this when everything is built, before the first step.

        If the run continues from a checkpoint, this method restores the environment, and calls the learner's
        `restore`. Returns the number of environment steps already done: 0 for a new run.
        """

    def step(self, steps: int, transition: Transition) -> float:
        """Call this after each step of the environment, with the number of steps so far and the step's result.

        Records the episodes that ended, reports progress, and tests the policy if `train.evaluate_every` requires
        it. The test calls the learner's own `reset` and `act`. Returns the time in s that the test took, 0 without
        a test.

        Raises:
            TrainingError: an observation or a reward is not finite.
        """

    def checkpoint(self, steps: int) -> None:
        """Call this at least every few hundred steps, when `state()` returns everything that training needs to
        continue.

        Saves the learner if a checkpoint is due, and raises an exception if the run was asked to stop.
        """

    def log(self, scalars: Mapping[str, float], steps: int) -> None:
        """Add scalars, by name, to the run's TensorBoard file."""


class Ring(Protocol):
    """A learner's memory of transitions, which checkpoints store incrementally; SB3's `ReplayBuffer` is one.

    A row contains one step of all environments. The r-th row of a run is at index r % buffer_size in each of the
    arrays `observations`, `next_observations`, `actions`, `rewards`, `dones` and `timeouts`.
    """

    n_envs: int
    buffer_size: int  # number of rows
    pos: int  # index of the next row
    full: bool  # whether every row has been written at least once


@dataclass(slots=True)
class Components:
    """Components of a checkpoint by name; `files` converts them to files. Nothing is unpickled."""

    tensors: dict[str, dict[str, Any]] = field(default_factory=dict)  # state dicts, saved as `<name>.pt`
    arrays: dict[str, dict[str, NDArray[Any]]] = field(default_factory=dict)  # arrays, saved as `<name>.npz`
    values: dict[str, Any] = field(default_factory=dict)  # plain data, saved as `<name>.json`

    def files(self) -> Iterator[tuple[str, bytes]]:
        """Yield file name and content of each component.

        Raises:
            TypeError: an array contains Python objects, or a value cannot be written as JSON.
        """
        if self.tensors:
            import torch  # imported late: a learner without tensors does not need torch

        for name, tensors in self.tensors.items():
            stream = io.BytesIO()
            torch.save(tensors, stream)
            yield f"{name}.pt", stream.getvalue()
        for name, arrays in self.arrays.items():
            stream = io.BytesIO()
            for key, array in arrays.items():
                if np.asarray(array).dtype.hasobject:
                    raise TypeError(
                        f"{name}.{key} has Python objects, which only a pickle could store; use numbers"
                    )
            np.savez(stream, **arrays)  # type: ignore[arg-type]
            yield f"{name}.npz", stream.getvalue()
        for name, value in self.values.items():
            yield f"{name}.json", json.dumps(value, indent=1, sort_keys=True).encode()

    @classmethod
    def read(cls, contents: Mapping[str, bytes]) -> Components:
        """Return the components in files; the inverse of `files`.

        Raises:
            ValueError: a file is damaged or would need unpickling.
        """
        components = cls()
        for file_name, data in contents.items():
            name, _, kind = file_name.rpartition(".")
            if kind == "pt":
                components.tensors[name] = archives.weights(data)
            elif kind == "npz":
                components.arrays[name] = archives.arrays(data)
            else:
                components.values[name] = reading.json_value(data, whole=2**128)
        return components


class Learner(Agent, Protocol):
    """Agent that learns. Tests, also tests during its training, treat it like every other agent.

    `reset` and `act` must neither draw from training's random generators nor change training's state: tests
    during training must not change the trained policy. Nothing is pickled.
    """

    exact_resume: bool
    """Whether `restore` restores everything, so that a continued run has bit-identical results. If False,
    the learner has no checkpoints, and `state` and `restore` are never called. An interrupted run then starts
    from the beginning, and its manifest records the restart.
    """

    def learn(self, environment: Batch, config: schema.TrainConfig, callbacks: Callbacks) -> None:
        """Train for at least `callbacks.total_steps` environment steps; the state must be complete on return.

        Args:
            environment: new environment with `config.algo.n_envs` parallel episodes.
            config: configuration of the run.
            callbacks: methods of the run to call during training; their docstrings say when.

        Raises:
            TrainingError: a number is NaN, or the run fails otherwise.
        """

    def save(self, folder: Path) -> None:
        """Write the trained policy as files into an empty folder: arrays, tensors, JSON, never a pickle."""

    def load(self, folder: Path) -> None:
        """Read the files of `save` in a process that has not trained; `act` must then give the same actions.

        The caller has checked the digests of the files.

        Raises:
            RunError: a file is missing, damaged, or contains a policy that does not fit the configuration.
        """

    def state(self) -> Components:
        """Return the arrays, tensors and plain values that training needs to continue.

        `replay` and the environment are saved separately. Called within `callbacks.checkpoint`, and once more
        when `learn` has returned.

        Raises:
            TrainingError: the state must not be saved, e.g. because it contains a NaN.
        """

    def restore(self, components: Components) -> None:
        """Restore a state from `state`; called within `callbacks.begin`, after the environment was restored.

        Raises:
            RunError: the state belongs to another learner.
        """


def replay(learner: Learner) -> Ring | None:
    """Return the memory of transitions that a learner's checkpoints store incrementally: its attribute
    `replay`, or None.
    """
    ring: Ring | None = getattr(learner, "replay", None)
    return ring


def make(config: schema.TrainConfig, vehicle: VehicleModel) -> Agent:
    """Return the agent of `config.algo` for a vehicle; a learner is untrained."""
    name = config.algo.agent
    if name not in AGENTS.own:
        from auvbench.agents import installed

        return installed.make(config, vehicle)
    agent: Agent = resolve(AGENTS[name].code)(config, vehicle)
    return agent


def learner_of(config: schema.TrainConfig, vehicle: VehicleModel) -> Learner:
    """Return the learner of `config.algo`."""
    return cast(Learner, make(config, vehicle))
