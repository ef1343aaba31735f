"""Learn the vehicle's motion, and plan with it: probabilistic ensembles with trajectory sampling (PETS).

Chua, Calandra, McAllister and Levine 2018, "Deep reinforcement learning in a handful of trials using probabilistic dynamics models",
NeurIPS. From this paper come the ensemble of probabilistic networks (`ensemble`), trajectory sampling (`imagined`), and the alternation of
acting and fitting. Unlike in the paper, plans are improved by the weights of MPPI (Williams et al. 2018; `classical.sampling.weights`)
instead of by the cross-entropy method, and the reward is the task's own (`imagined.Returns`). Networks and optimizer are PyTorch's; no
other library is used.

The learner knows the observation, the action and the reward's formula. About the vehicle, it knows only the number of actuators.

Draws are functions of the run's seed, the episode and the step, so a checkpoint needs no state of a generator.
"""

from __future__ import annotations

import io
import math
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from auvbench.agents.base import Actions, Callbacks, Components, Integers, Observations
from auvbench.agents.classical.sampling import weights as mppi_weights
from auvbench.agents.learned.ensemble import Ensemble, fit
from auvbench.agents.learned.imagined import MOTION, SIZE, Prediction, Returns, followed, require_known
from auvbench.agents.learned.state import plain
from auvbench.agents.learned.trained_policy import read_weights
from auvbench.config import schema
from auvbench.config.algorithms.pets import PETS
from auvbench.envs.batch import Batch, Transition
from auvbench.errors import ConfigError, RunError, TrainingError
from auvbench.tasks.observation_spec import observation_spec
from auvbench.vehicles.vehicle_model import VehicleModel

Floats = NDArray[np.float32]

FILE = "ensemble.pt"
FIRST_ITERATIONS = 4
"""number of improvements of an episode's first plan; later plans are improved once"""
SPREAD = 0.7
"""standard deviation of random actions"""
FIT, EXPLORE, TRAIN, TEST = range(4)
"""random streams of the draws: bootstrap and batches of the fit; random actions; plans in training; plans in tests"""


def check(config: schema.TrainConfig, vehicle: VehicleModel) -> None:
    """Refuse a task for which PETS cannot plan.

    Raises:
        ConfigError: the task's reward is not a function of the observation, the motion is not observed, or the training ends before the
            ensemble learns.
    """
    require_known(config)
    spec = observation_spec(config.task, vehicle.actuators)
    for block in ("position_error", "yaw_error", *MOTION, "previous_action"):
        spec[block]
    assert isinstance(config.algo, PETS)
    if config.train.total_steps <= config.algo.learning_starts:
        raise ConfigError(
            f"train.total_steps={config.train.total_steps}: must be more than algo.learning_starts="
            f"{config.algo.learning_starts}, the steps with random actions"
        )


class Transitions:
    """Ring buffer of transitions (`agents.base.Ring`)."""

    def __init__(self, rows: int, n_envs: int, n_obs: int, n_u: int) -> None:
        self.n_envs, self.buffer_size = n_envs, rows
        self.pos, self.full = 0, False
        self.observations = np.zeros((rows, n_envs, n_obs), dtype=np.float32)
        self.next_observations = np.zeros_like(self.observations)
        self.actions = np.zeros((rows, n_envs, n_u), dtype=np.float32)
        self.rewards = np.zeros((rows, n_envs), dtype=np.float32)
        self.dones = np.zeros((rows, n_envs), dtype=np.float32)
        self.timeouts = np.zeros((rows, n_envs), dtype=np.float32)

    def add(self, before: Floats, action: Floats, result: Transition) -> None:
        """Add a step of all environments: observations (n_envs, n_obs), actions (n_envs, n_u) and the results of these actions."""
        at = self.pos
        self.observations[at], self.actions[at], self.rewards[at] = before, action, result.reward
        self.next_observations[at] = result.observation
        self.next_observations[at, result.ended] = result.final_observation
        self.dones[at] = result.terminated | result.truncated
        self.timeouts[at] = result.truncated
        self.pos = (at + 1) % self.buffer_size
        self.full |= self.pos == 0

    def all(self) -> tuple[Floats, Floats, Floats]:
        """Return observations, actions and next observations (rows x n_envs, ...) of all stored steps."""
        rows = self.buffer_size if self.full else self.pos
        before, action, after = self.observations[:rows], self.actions[:rows], self.next_observations[:rows]
        n_obs, n_u = before.shape[2], action.shape[2]
        return before.reshape(-1, n_obs), action.reshape(-1, n_u), after.reshape(-1, n_obs)


class Plans:
    """Plans of a batch of episodes, with the stream, episodes and steps from which their random draws follow."""

    def __init__(self, episodes: Integers, stream: int, horizon: int, n_u: int) -> None:
        self.stream = stream
        self.episodes: Integers = np.array(episodes, dtype=np.int64)
        self.steps = np.zeros(len(episodes), dtype=np.int64)
        self.actions: Floats = np.zeros((len(episodes), horizon, n_u), dtype=np.float32)
        self.aims: Floats = np.zeros((len(episodes), 4), dtype=np.float32)
        """(n, 4) estimates of position error (m, level axes) and yaw error (rad)"""
        self.motions: Floats = np.zeros((len(episodes), SIZE), dtype=np.float32)
        """(n, 9) motions at the previous step"""
        self.running = np.arange(len(episodes))

    def begin(self, rows: NDArray[np.integer]) -> None:
        """Begin the next episode in each of the given rows."""
        self.episodes[rows] += 1
        self.steps[rows] = 0
        self.actions[rows] = 0.0


class PETSLearner:
    """Probabilistic ensembles with trajectory sampling, with the interface of `auvbench.agents.base.Learner`.

    Attributes:
        row_by_row: True: the learner computes the actions of a batch one row after the other, so a test divides its episodes among
            processes.
    """

    exact_resume = True
    row_by_row = True

    def __init__(self, config: schema.TrainConfig, vehicle: VehicleModel) -> None:
        check(config, vehicle)
        torch.set_num_threads(1)
        algo = config.algo
        assert isinstance(algo, PETS)
        self.algo, self._seed = algo, config.seed
        self._dt = 1.0 / config.step.frequency
        spec = observation_spec(config.task, vehicle.actuators)
        self._columns = np.concatenate([np.arange(spec.size)[spec[block]] for block in MOTION])
        self._previous, self._error = spec["previous_action"], spec["position_error"]
        self._yaw = spec["yaw_error"].start
        self._n_obs, self._n_u = spec.size, len(vehicle.actuators)
        self._horizon = max(1, round(algo.horizon / self._dt))
        self._returns = Returns(config)
        n_in = SIZE + 2 * self._n_u
        self.ensemble = Ensemble(algo.members, n_in, SIZE, algo.net_arch, config.seed)
        self._keep = math.exp(-self._dt / algo.correlation) if algo.correlation > 0.0 else 0.0
        self._prediction: Prediction | None = None
        self.replay: Transitions | None = None
        self._optimizer: torch.optim.Optimizer | None = None
        self._training: Plans | None = None
        self._observation: Floats | None = None
        self._explored: Floats | None = None
        self._environment: Batch | None = None
        self._tested = self._plans(np.empty(0, dtype=np.int64), TEST)
        self.planned = self.failed = self.late = 0

    def _plans(self, episodes: Integers, stream: int) -> Plans:
        return Plans(episodes, stream, self._horizon, self._n_u)

    def reset(self, episodes: Integers) -> None:
        self._tested = self._plans(episodes, TEST)

    def ended(self, rows: NDArray[np.intp]) -> None:
        """Stop computing actions for episodes that have ended."""
        self._tested.running = np.setdiff1d(self._tested.running, rows)

    def act(self, observation: Observations) -> Actions:
        return self._act(observation, self._tested)

    def _act(self, observation: Observations, plans: Plans) -> Floats:
        """Improve the plans of a batch's rows, and return their first actions (n, n_u)."""
        action = np.zeros((len(observation), self._n_u), dtype=np.float32)
        for i in plans.running.tolist():
            begun = time.perf_counter()
            action[i] = self._plan(observation[i], plans, i)
            self.late += time.perf_counter() - begun > self._dt
            self.planned += 1
        return action

    def _plan(self, reading: Floats, plans: Plans, i: int) -> Floats:
        """Improve row i's plan, and return its first action (n_u,)."""
        if self._prediction is None:
            self._prediction = Prediction(self.ensemble)
        plan, step = plans.actions[i], int(plans.steps[i])
        if step:
            plan[:-1] = plan[1:].copy()
        generator = np.random.default_rng([self._seed, plans.stream, int(plans.episodes[i]), step])
        self._estimate(reading, plans, i)
        for _ in range(1 if step else FIRST_ITERATIONS):
            self.failed += not self._improve(plan, reading, plans.aims[i], generator)
        plans.steps[i] += 1
        return np.array(plan[0])

    def _estimate(self, reading: Floats, plans: Plans, i: int) -> None:
        """Estimate row i's position and yaw errors by the mean of all readings, each corrected for the motion since the reading.

        After 1 / `reading_share` steps, each new reading has the weight `reading_share`, so that old readings fade.
        """
        motion, read = reading[self._columns], np.append(reading[self._error], reading[self._yaw])
        share = max(1.0 / (1.0 + plans.steps[i]), self.algo.reading_share)
        if plans.steps[i]:
            states = torch.from_numpy(np.stack([plans.motions[i], motion]))
            aim = followed(torch.from_numpy(plans.aims[i]), states, self._dt).numpy()
            off = read - aim
            off[3] = (off[3] + math.pi) % (2.0 * math.pi) - math.pi
            read = aim + np.float32(share) * off
        plans.aims[i], plans.motions[i] = read, motion

    def _improve(self, plan: Floats, reading: Floats, aim: Floats, generator: np.random.Generator) -> bool:
        """Replace a plan (H, n_u) by the weighted mean of samples about it. Return False, with the plan unchanged, if no sample has a
        finite return.
        """
        assert self._prediction is not None
        actions = self._samples(plan, generator)
        noise = generator.standard_normal((self._horizon, self._prediction.members, 1, SIZE), np.float32)
        with torch.inference_mode():
            observation = torch.from_numpy(reading)
            previous, candidates = observation[self._previous], torch.from_numpy(actions)
            motion = observation[self._columns]
            states = self._prediction.roll_out(motion, previous, candidates, torch.from_numpy(noise))
            value = self._returns(torch.from_numpy(aim), previous, candidates, states).mean(0)
        weight = mppi_weights(
            -value.numpy().astype(np.float64), np.zeros(len(value)), self.algo.temperature, 0.0
        )
        if weight is None:
            return False
        plan[:] = np.einsum("i,kia->ka", weight, actions)
        return True

    def _samples(self, plan: Floats, generator: np.random.Generator) -> Floats:
        """Return samples (H, n, n_u) of a plan: first the plan itself, then the plan plus noises, then the plan minus the same noises."""
        n = self.algo.samples
        white = generator.standard_normal((self._horizon, n // 2, self._n_u), np.float32)
        noise, fresh = white * self.algo.noise, math.sqrt(1.0 - self._keep**2)
        for k in range(1, self._horizon):
            noise[k] = self._keep * noise[k - 1] + fresh * noise[k]
        both = np.concatenate([np.zeros_like(noise[:, :1]), noise, -noise], axis=1)[:, :n]
        return np.asarray(np.clip(plan[:, None] + both, -1.0, 1.0))

    def learn(self, environment: Batch, config: schema.TrainConfig, callbacks: Callbacks) -> None:
        """Train as `Learner.learn` requires: act, and fit the ensemble to all transitions every `algo.fit_every` steps.

        Raises:
            TrainingError: a weight, an observation or a reward is not finite.
        """
        algo, n = self.algo, environment.n
        self._environment = environment
        rows = max(1, algo.buffer_size // n)
        self.replay = memory = Transitions(rows, n, self._n_obs, self._n_u)
        self._optimizer = torch.optim.AdamW(
            self.ensemble.parameters(), lr=algo.learning_rate, weight_decay=algo.weight_decay
        )
        self._training = self._plans(np.arange(n) << 32, TRAIN)
        self._explored = np.zeros((n, self._n_u), dtype=np.float32)
        self._observation = environment.reset().copy()
        steps = callbacks.begin()
        while steps < callbacks.total_steps:
            callbacks.checkpoint(steps)
            action = self._explore(steps) if steps < algo.learning_starts else self._pursue()
            result = environment.step(action)
            before = steps
            steps += n
            memory.add(self._observation, environment.acted.astype(np.float32), result)
            self._observation = result.observation.copy()
            self._training.begin(result.ended)
            if steps >= algo.learning_starts and _passed(before, steps, algo):
                self._fit(steps, callbacks)
            callbacks.step(steps, result)

    def _pursue(self) -> Floats:
        assert self._training is not None
        assert self._observation is not None
        return self._act(self._observation, self._training)

    def _explore(self, steps: int) -> Floats:
        """Return random actions (n, n_u), correlated in time like the noise of the samples."""
        assert self._explored is not None
        white = np.random.default_rng([self._seed, EXPLORE, steps]).standard_normal(self._explored.shape)
        fresh = math.sqrt(1.0 - self._keep**2)
        self._explored = (self._keep * self._explored + fresh * white).astype(np.float32)
        return np.asarray(np.clip(SPREAD * self._explored, -1.0, 1.0))

    def _fit(self, steps: int, callbacks: Callbacks) -> None:
        """Fit the ensemble to all transitions."""
        assert self.replay is not None
        assert self._optimizer is not None
        before, action, after = self.replay.all()
        motion = before[:, self._columns]
        inputs = np.concatenate([motion, before[:, self._previous], action], axis=1)
        loss = fit(
            self.ensemble,
            self._optimizer,
            inputs,
            after[:, self._columns] - motion,
            steps=self.algo.gradient_steps,
            batch=self.algo.batch_size,
            generator=np.random.default_rng([self._seed, FIT, steps]),
        )
        if not all(bool(torch.isfinite(parameter).all()) for parameter in self.ensemble.parameters()):
            raise TrainingError(f"step {steps}: the weights of the ensemble are not finite")
        self._prediction = None
        callbacks.log({"train/loss": loss, "train/transitions": float(len(inputs))}, steps)

    def save(self, folder: Path) -> None:
        """Write ensemble.pt, a plain dictionary of tensors."""
        stream = io.BytesIO()
        torch.save(plain(dict(self.ensemble.state_dict())), stream)
        (folder / FILE).write_bytes(stream.getvalue())

    def load(self, folder: Path) -> None:
        """Read the file of `save` without unpickling.

        Raises:
            RunError: the file is missing, damaged, or does not fit the networks of the configuration.
        """
        weights = read_weights(folder / FILE, self.ensemble.state_dict())
        for name in ("input_scale", "output_scale"):
            if not bool((weights[name] > 0.0).all()):
                raise RunError(f"{folder / FILE}: {name} contains a number that is not positive")
        self.ensemble.load_state_dict(weights)
        self._prediction = None

    def state(self) -> Components:
        """Return networks, optimizer, plans and the present observations."""
        plans, observation, explored = self._training, self._observation, self._explored
        assert plans is not None
        assert self._optimizer is not None
        assert observation is not None
        assert explored is not None
        arrays: dict[str, NDArray[Any]] = {
            "episodes": plans.episodes,
            "steps": plans.steps,
            "actions": plans.actions,
            "aims": plans.aims,
            "motions": plans.motions,
            "observation": observation,
            "explored": explored,
        }
        networks = {"networks": dict(self.ensemble.state_dict()), "optimizer": self._optimizer.state_dict()}
        return Components(tensors={"ensemble": plain(networks)}, arrays={"plans": arrays})

    def restore(self, components: Components) -> None:
        """Restore the result of `state` in a learner whose `learn` is running.

        Raises:
            RunError: the checkpoint belongs to other networks.
        """
        plans = self._training
        assert plans is not None
        assert self._optimizer is not None
        assert self._environment is not None
        try:
            tensors, arrays = components.tensors["ensemble"], components.arrays["plans"]
            self.ensemble.load_state_dict(tensors["networks"])
            self._optimizer.load_state_dict(tensors["optimizer"])
        except (RuntimeError, ValueError, KeyError) as error:
            raise RunError(
                f"the checkpoint does not fit the networks of this configuration: {error}"
            ) from error
        self._prediction = None
        for name in ("episodes", "steps", "actions", "aims", "motions"):
            setattr(plans, name, arrays[name].copy())
        self._explored, self._observation = arrays["explored"].copy(), arrays["observation"].copy()
        if (restarted := self._environment.restarted) is not None:
            self._observation = restarted.copy()
            plans.begin(np.arange(len(restarted)))

    def notes(self) -> dict[str, int]:
        """Return counters since the creation: steps, plans without a finite sample, and steps whose plan took longer
        than the agent's step.
        """
        return {"plans": self.planned, "failed_plans": self.failed, "late_plans": self.late}


def _passed(before: int, steps: int, algo: Any) -> bool:
    """Return whether a fit became due between `before` and `steps`: one is due after the random actions, then every `fit_every` steps."""
    start, every = algo.learning_starts, algo.fit_every
    return bool(before < start or (steps - start) // every > (before - start) // every)
