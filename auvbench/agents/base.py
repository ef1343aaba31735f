"""Agent and Learner protocols, what a learner's checkpoint is made of, and the function that makes an agent."""

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
    """A controller in a test: acts on a batch of observations. Made by `factory(config, vehicle)`.

    An agent may also have:

    * `load(folder)`: reads what its run keeps in `model/`, before the first `reset`;
    * `row_by_row = True`, of its class: an action takes as long in a batch as alone. Its tests are then shared among
      processes by episodes;
    * `ended(rows)`: called with the rows of the batch that have ended;
    * `simulator(config, vehicle)`: the simulator of its tests, one vehicle at a time, for an agent whose own loop moves the
      actuators within an agent step; its actions are then what is recorded, and command nothing;
    * `notes()`: whole numbers by name that it has counted since it was made; a test's summary holds their sums.
    """

    def reset(self, episodes: Integers) -> None:
        """Forget everything: the given episodes (n,) begin, one per row."""

    def act(self, observation: Observations) -> Actions:
        """Return actions (n, n_u) in [-1, 1] for observations (n, n_obs)."""


class Callbacks(Protocol):
    """What carries out a run, as its learner sees it: the learner calls these.

    `begin` once, then `step` after each step of the environment, and `checkpoint` at every point where the learner's state is
    whole. All of them may raise: let it through.
    """

    total_steps: int  # of environment steps, the sum over the n environments

    def begin(self) -> int:
        """Call when everything is built and before the first step.

        Where the run goes on from a checkpoint, the environment and the learner (its `restore`) are by then what
        they were; otherwise nothing happens. Returns the environment steps that lie behind: 0 for a new run.
        """

    def step(self, steps: int, transition: Transition) -> float:
        """Take one step of 1 / `step.frequency` s with actions (n, n_u), clipped to [-1, 1].

        Writes the rows of the episodes that ended, reports progress, and tests the policy where
        `train.evaluate_every` asks for it, by the learner's own `reset` and `act`. Returns the s that this took from
        training.

        Raises:
            TrainingError: an observation or a reward is not finite.
        """

    def checkpoint(self, steps: int) -> None:
        """Call where `state()` holds all that training goes on with, at least every few hundred steps.

        Saves the learner if that is due, and raises if the run was asked to stop.
        """

    def log(self, scalars: Mapping[str, float], steps: int) -> None:
        """Add scalars, by name, to the run's TensorBoard file."""


class Ring(Protocol):
    """A learner's memory of transitions, which checkpoints store by increments; SB3's `ReplayBuffer` is one.

    A row is what all environments did in one step. Row r of a run lies at r % buffer_size of each of the arrays
    `observations`, `next_observations`, `actions`, `rewards`, `dones` and `timeouts`.
    """

    n_envs: int
    buffer_size: int  # rows
    pos: int  # where the next row goes
    full: bool  # whether the oldest row has been overwritten


@dataclass(slots=True)
class Components:
    """What a checkpoint is made of, by name; `files` is its form on disk. Nothing is unpickled."""

    tensors: dict[str, dict[str, Any]] = field(default_factory=dict)  # state dicts -> `<name>.pt`
    arrays: dict[str, dict[str, NDArray[Any]]] = field(default_factory=dict)  # -> `<name>.npz`
    values: dict[str, Any] = field(default_factory=dict)  # plain data -> `<name>.json`

    def files(self) -> Iterator[tuple[str, bytes]]:
        """File name and content of each component.

        Raises:
            TypeError: an array holds Python objects, or JSON has no form for a value.
        """
        if self.tensors:
            import torch  # only here: a learner without tensors does not wait for it

        for name, tensors in self.tensors.items():
            stream = io.BytesIO()
            torch.save(tensors, stream)
            yield f"{name}.pt", stream.getvalue()
        for name, arrays in self.arrays.items():
            stream = io.BytesIO()
            for key, array in arrays.items():
                if np.asarray(array).dtype.hasobject:
                    raise TypeError(f"{name}.{key} holds Python objects, which only a pickle could store")
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
    """An agent that learns. In a test, and in the tests during its training, it acts as every agent does.

    `reset` and `act` must neither draw from what training draws from nor change what it goes on with: with and
    without tests on the way the same policy must come out. Nothing is pickled.
    """

    exact_resume: bool
    """Whether `restore` brings back everything, so that a run that was stopped ends with the same bits. A learner that
    cannot says False: it has no checkpoints, `state` and `restore` are never called, and a run that was stopped begins
    anew, which its manifest names."""

    def learn(self, environment: Batch, config: schema.TrainConfig, callbacks: Callbacks) -> None:
        """Train until at least `callbacks.total_steps` environment steps are done; the state is whole on return.

        Args:
            environment: fresh; `config.algo.n_envs` episodes side by side.
            config: of the run.
            callbacks: to be called as they say.

        Raises:
            TrainingError: a NaN, or another failure of the run.
        """

    def save(self, folder: Path) -> None:
        """Write the trained policy as files into an empty folder: arrays, tensors, JSON, never a pickle."""

    def load(self, folder: Path) -> None:
        """Read what `save` wrote, in a process that has not trained; `act` then gives the same actions.

        The caller has compared the files with their digests.

        Raises:
            RunError: a file is missing, damaged, or of another policy than the configuration's.
        """

    def state(self) -> Components:
        """Return everything that training continues with except `replay` and the environment: arrays, tensors, plain values.

        Called from within `callbacks.checkpoint`, and once more when `learn` has returned.

        Raises:
            TrainingError: it is not fit to be saved, for instance holds a NaN.
        """

    def restore(self, components: Components) -> None:
        """Return to what `state` gave; called from within `callbacks.begin`, after the environment was restored.

        Raises:
            RunError: it is of another learner.
        """


def replay(learner: Learner) -> Ring | None:
    """Return the memory of transitions that a learner's checkpoints store by increments: its attribute `replay`, if any."""
    ring: Ring | None = getattr(learner, "replay", None)
    return ring


def make(config: schema.TrainConfig, vehicle: VehicleModel) -> Agent:
    """Return the agent that `config.algo` names, for a vehicle; an agent that learns has learned nothing yet."""
    name = config.algo.agent
    if name not in AGENTS.own:
        from auvbench.agents import plugins

        return plugins.make(config, vehicle)
    agent: Agent = resolve(AGENTS[name].code)(config, vehicle)
    return agent


def learner_of(config: schema.TrainConfig, vehicle: VehicleModel) -> Learner:
    """Return the learner that `config.algo` names."""
    return cast(Learner, make(config, vehicle))
