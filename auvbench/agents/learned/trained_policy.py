"""Act with a trained policy in a test.

The actions are deterministic and do not depend on the batch size. The files are read without unpickling, and checked:
a damaged file may still load with an infinite weight or a negative variance, and the damaged policy would be scored.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.policies import BasePolicy

from auvbench.agents.base import Actions, Integers, Observations
from auvbench.agents.learned import learners
from auvbench.config import schema
from auvbench.config.algorithms.residual import PPOResidual, SACResidual
from auvbench.errors import RunError
from auvbench.registry import AGENTS, resolve
from auvbench.tasks.observation_spec import observation_spec
from auvbench.untrusted import archives, reading
from auvbench.vehicles.vehicle_model import VehicleModel

Floats = NDArray[np.float64]

ROWS = 64
"""Number of rows of every forward pass. It is fixed because matrix products of another shape may round differently,
and an episode's result must not depend on how many episodes are tested together.
"""

ALIGNED = 16
"""Strides between rows are a multiple of this number of floats. With unaligned rows, matrix products with
fewer than twelve columns sum every second row in a different order (MKL with AVX-512 on AMD EPYC), so that an
episode's actions would depend on its index in the batch.
"""


@contextmanager
def aligned(layers: list[torch.nn.Linear]) -> Iterator[None]:
    """Give the layers inputs with aligned rows (see ALIGNED)."""
    hooks = [layer.register_forward_pre_hook(_spaced) for layer in layers]
    try:
        yield
    finally:
        for hook in hooks:
            hook.remove()


def _spaced(layer: torch.nn.Module, inputs: tuple[torch.Tensor, ...]) -> tuple[torch.Tensor, ...]:
    (rows,) = inputs
    width = rows.shape[-1]
    return (torch.nn.functional.pad(rows, (0, -width % ALIGNED))[..., :width],)


class Forward:
    """Forward pass of a policy that uses only the present observation."""

    def __init__(self, policy: BasePolicy) -> None:
        self._policy = policy
        self._uneven = [
            layer
            for layer in policy.modules()
            if isinstance(layer, torch.nn.Linear) and layer.in_features % ALIGNED
        ]

    def reset(self, n: int) -> None:
        """Begin `n` episodes."""

    def __call__(self, block: int, rows: torch.Tensor) -> torch.Tensor:
        """Return actions (ROWS, n_u) for observations (ROWS, d), which are block number `block` of the batch."""
        with aligned(self._uneven):
            return self._policy._predict(rows, deterministic=True)


class RecurrentForward(Forward):
    """Forward pass of a policy with an LSTM: each episode's row keeps its own state, zeros at the beginning."""

    _policy: Any

    def reset(self, n: int) -> None:
        lstm = self._policy.lstm_actor
        shape = (lstm.num_layers, ROWS, lstm.hidden_size)
        self._states = [(torch.zeros(shape), torch.zeros(shape)) for _ in range(0, n, ROWS)]
        self._begins = torch.zeros(ROWS)  # 0: only `reset` begins episodes

    def __call__(self, block: int, rows: torch.Tensor) -> torch.Tensor:
        with aligned(self._uneven):
            action, self._states[block] = self._policy._predict(
                rows, lstm_states=self._states[block], episode_starts=self._begins, deterministic=True
            )
        return torch.as_tensor(action)


def forward_of(policy: BasePolicy) -> Forward:
    """Return the forward pass of a policy; call `reset` next."""
    return RecurrentForward(policy) if hasattr(policy, "lstm_actor") else Forward(policy)


Scaling = tuple[Floats, Floats, float]
Network = tuple[BasePolicy, Scaling | None]
"""policy, and mean, scale and clip that normalise its observations (None: no normalisation)"""


class FrozenPolicy:
    """Policy for tests: deterministic, with frozen statistics of its observations.

    It draws no random number and does not change the policy, so a policy can be tested during its training.
    """

    def __init__(
        self, policy: BasePolicy, arrays: Mapping[str, NDArray[np.float64]], normalise: bool, n_u: int
    ) -> None:
        self.policy = policy
        self._forward = forward_of(policy)
        self._normalise = normalise
        self._mean = np.array(arrays["observation_mean"])
        self._scale = np.sqrt(arrays["observation_variance"] + arrays["epsilon"])
        self._clip = float(arrays["clip_observations"])
        self._n_u = n_u

    def reset(self, episodes: Integers) -> None:
        self._forward.reset(len(episodes))

    def network(self) -> Network | None:
        """Return the policy's network with the scaling of its observations; None for a policy with a state (LSTM)."""
        if type(self._forward) is not Forward:
            return None
        return self.policy, (self._mean, self._scale, self._clip) if self._normalise else None

    def act(self, observation: Observations) -> Actions:
        """Return deterministic actions (n, n_u)."""
        if self._normalise:
            scaled = (observation - self._mean) / self._scale
            observation = np.clip(scaled, -self._clip, self._clip).astype(np.float32)
        action = np.empty((len(observation), self._n_u), dtype=np.float32)
        rows = np.zeros((ROWS, observation.shape[1]), dtype=np.float32)
        with torch.no_grad():
            for start in range(0, len(observation), ROWS):
                part = observation[start : start + ROWS]
                rows[: len(part)] = part
                output = self._forward(start // ROWS, torch.from_numpy(rows))
                action[start : start + len(part)] = output.numpy()[: len(part)]
        return np.clip(action, -1.0, 1.0)


class LearnedPolicy(FrozenPolicy):
    """Trained policy in a test: its weights and statistics are read without unpickling.

    Raises:
        RunError: a file is missing, damaged, or does not fit the network of the configuration.
    """

    def __init__(self, config: schema.TrainConfig, folder: Path, vehicle: VehicleModel) -> None:
        torch.set_num_threads(1)
        policy = _policy(config, vehicle)
        weights = read_weights(folder / learners.WEIGHTS, policy.state_dict())
        statistics = _read_statistics(folder / learners.STATISTICS, observed(config, vehicle))
        policy.load_state_dict(weights)
        policy.set_training_mode(False)
        super().__init__(policy, statistics, config.train.normalise_observations, len(vehicle.actuators))


def _read(path: Path) -> bytes:
    try:
        return reading.content(path, reading.WEIGHTS)
    except FileNotFoundError as error:
        raise RunError(f"{path.parent}: no trained model here ({path.name} is missing)") from error
    except (OSError, ValueError) as error:
        raise RunError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from error


def observed(config: schema.TrainConfig, vehicle: VehicleModel) -> int:
    """Return the length of a learner's observation, including the controller's action for a residual learner."""
    residual = isinstance(config.algo, PPOResidual | SACResidual)
    n_u = len(vehicle.actuators)
    return observation_spec(config.task, vehicle.actuators).size + (n_u if residual else 0)


def _policy(config: schema.TrainConfig, vehicle: VehicleModel) -> BasePolicy:
    """Return the network of `config.algo` without an environment or a learner."""
    algo = config.algo
    observation_space = spaces.Box(-np.inf, np.inf, (observed(config, vehicle),), dtype=np.float32)
    action_space = spaces.Box(-1.0, 1.0, (len(vehicle.actuators),), dtype=np.float32)
    learner = resolve(AGENTS[algo.agent].algorithm)
    kind = learner.policy_aliases[learners.policy_name(algo)]
    arguments = learners.policy_arguments(algo)
    if algo.agent == "ddpg":
        arguments["n_critics"] = 1
    policy: BasePolicy = kind(
        observation_space, action_space, lambda _: 0.0, optimizer_class=NoOptimizer, **arguments
    )
    return policy


class NoOptimizer:
    """Stand-in for the optimizer of a policy that is only tested. The first real optimizer in a process imports torch._dynamo, which takes
    a second.
    """

    def __init__(self, *_: object, **__: object) -> None:
        pass


def read_weights(path: Path, expected: Mapping[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    """Return the tensors of a policy.

    Raises:
        RunError: the file cannot be read, belongs to another network, or contains a number that is not finite.
    """
    try:
        weights = archives.weights(_read(path))
    except ValueError as error:
        raise RunError(f"{path}: the weights cannot be read: {error}") from error
    for name in [*expected, *(name for name in weights if name not in expected)]:
        wrong = (
            _fault(weights.get(name), expected[name]) if name in expected else "is not part of the network"
        )
        # Running variance of a normalisation layer (CrossQ).
        if not wrong and name.endswith("ra_var") and bool((weights[name] < 0.0).any()):
            wrong = "contains a negative number"
        if wrong:
            raise RunError(f"{path}: {name} {wrong}; the weights are damaged or of another network")
    return dict(weights)


def _fault(value: Any, like: Any) -> str:
    """Return what is wrong with an array or tensor: a shape or type that differs from `like`, or a number that is not finite; else ''."""
    if value is None:
        return "is missing"
    if not isinstance(value, type(like)):
        return f"is a {type(value).__name__}, not a {'tensor' if isinstance(like, torch.Tensor) else 'array'}"
    if value.shape != like.shape:
        return f"has shape {tuple(value.shape)}, expected {tuple(like.shape)}"
    if value.dtype != like.dtype or getattr(value, "layout", None) != getattr(like, "layout", None):
        return f"has type {value.dtype}, expected {like.dtype}"
    return (
        "" if bool(torch.isfinite(torch.as_tensor(value)).all()) else "contains a number that is not finite"
    )


def _read_statistics(path: Path, size: int) -> dict[str, Floats]:
    """Return the running statistics that scale observations: mean and variance (size,), epsilon and clip ().

    Raises:
        RunError: the file cannot be read, lacks an entry, or an entry has a wrong shape or an impossible
            value.
    """
    try:
        statistics = archives.arrays(_read(path))
    except ValueError as error:
        raise RunError(f"{path}: the statistics cannot be read: {error}") from error
    shapes: dict[str, tuple[int, ...]] = {
        "observation_mean": (size,),
        "observation_variance": (size,),
        "epsilon": (),
        "clip_observations": (),
    }
    for name, shape in shapes.items():
        wrong = _fault(statistics.get(name), np.zeros(shape))
        if not wrong and not name.startswith("observation") and not statistics[name] > 0.0:
            wrong = "is not positive"
        if wrong:
            raise RunError(f"{path}: {name} {wrong}")
    if bool((statistics["observation_variance"] < 0.0).any()):
        raise RunError(f"{path}: observation_variance contains a negative number")
    return {name: statistics[name] for name in shapes}
