"""Keep parameters of SB3's networks and states of its optimizers in flat arrays, and draw batches from a
replay buffer.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from sb3_contrib.common.torch_layers import BatchRenorm1d
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm

from auvbench.agents.learned.compiled.arithmetic import adam
from auvbench.agents.learned.compiled.networks import BATCH, RENORM, RUNNING, backward, forward

Floats = NDArray[np.float32]


def rows(networks: Sequence[Sequence[torch.Tensor]]) -> torch.Tensor:
    """Move the parameters of K networks of one shape into an array (K, P), and return it. The tensors become views of it."""
    none = torch.empty(0)  # `torch.cat` needs a tensor, and a network may have no parameter
    flat = torch.stack(
        [
            torch.cat([none, *(tensor.detach().reshape(-1) for tensor in parameters)])
            for parameters in networks
        ]
    )
    for k, parameters in enumerate(networks):
        for tensor, view in zip(parameters, _views(flat[k], parameters), strict=True):
            tensor.data = view
    return flat


def _views(flat: torch.Tensor, like: Sequence[torch.Tensor]) -> list[torch.Tensor]:
    parts = torch.split(flat, [tensor.numel() for tensor in like])
    return [part.view(tensor.shape) for part, tensor in zip(parts, like, strict=True)]


class Trained:
    """Parameters of K networks in one array, with arrays of the same shape for their gradient and for the moments of
    SB3's optimizer.

    Args:
        networks: parameters of each network.
        optimizer: optimizer of these parameters; None if they are never updated by gradients.

    Attributes:
        values: (K, P) parameters.
        gradient: (K, P) gradient of the parameters.
    """

    def __init__(self, networks: Sequence[Sequence[torch.Tensor]], optimizer: Any) -> None:
        self._networks, self._optimizer = networks, optimizer
        flat = rows(networks)
        self.values: Floats = flat.numpy()
        self.gradient: Floats = np.zeros_like(self.values)
        self._step = torch.tensor(0.0)
        self._moments = torch.zeros(2, *flat.shape)
        self._mean, self._square = self._moments.numpy()
        if optimizer is not None:
            optimizer.register_load_state_dict_post_hook(self._adopt)
            self._adopt()

    def _adopt(self, *_: Any) -> None:
        """Copy the optimizer's state, if it has any, into this object's arrays, and let the optimizer use these arrays.

        Called also after the optimizer's `load_state_dict`, which gives the optimizer new tensors.
        """
        state = self._optimizer.state
        self._step.zero_()
        self._moments.zero_()
        for k, network in enumerate(self._networks):
            views = [_views(moment[k], network) for moment in self._moments]
            for tensor, mean, square in zip(network, *views, strict=True):
                if previous := state.get(tensor):
                    self._step.copy_(previous["step"])
                    mean.copy_(previous["exp_avg"])
                    square.copy_(previous["exp_avg_sq"])
                state[tensor] = {"step": self._step, "exp_avg": mean, "exp_avg_sq": square}

    def update(self) -> None:
        """Take one step of Adam along `gradient`."""
        (group,) = self._optimizer.param_groups
        self._step += 1
        step, (beta1, beta2) = int(self._step), group["betas"]
        arrays = (array.reshape(-1) for array in (self.values, self.gradient, self._mean, self._square))
        adam(*arrays, step, group["lr"], beta1, beta2, group["eps"])


Gradient = Callable[[Floats, bool], Floats]
"""Function of the outputs' gradient (K, n, o) and a flag. If the flag is True, it stores the gradient of the parameters.
Otherwise it returns the gradient of the inputs (n, d), summed over networks.
"""


class Networks(Trained):
    """Networks of one shape: linear layers with ReLU between them, some with batch renormalisation of their
    inputs.

    Args:
        networks: modules of each network.
        optimizer: optimizer of their parameters; None for target networks.
        heads: linear layers with the same inputs that replace the last layer, such as mean and log_std of a policy.
    """

    def __init__(
        self,
        networks: Iterable[Iterable[torch.nn.Module]],
        optimizer: Any = None,
        heads: Sequence[torch.nn.Linear] = (),
    ) -> None:
        modules: list[list[Any]] = [list(network) for network in networks]
        self._renorms: list[list[Any]] = [
            [module for module in network if isinstance(module, BatchRenorm1d)] for network in modules
        ]
        head = [head.weight for head in heads] + [head.bias for head in heads]
        super().__init__([[*_parameters(network), *head] for network in modules], optimizer)
        linear = [module for module in modules[0] if isinstance(module, torch.nn.Linear)]
        widths = [layer.out_features for layer in linear]
        if heads:
            widths.append(sum(head.out_features for head in heads))
        self._sizes = np.array([[*linear, *heads][0].in_features, *widths])
        self._normalised = np.arange(len(widths)) < len(self._renorms[0])
        self._running_mean = rows(
            [[module.ra_mean for module in network] for network in self._renorms]
        ).numpy()
        self._running_variance = rows(
            [[module.ra_var for module in network] for network in self._renorms]
        ).numpy()

    def forward(self, x: Floats, training: bool = False, first: int | None = None) -> tuple[Gradient, Floats]:
        """Return the backward pass (see `Gradient`) and the outputs (K, n, o) for inputs (n, d).

        Args:
            x: inputs (n, d).
            training: whether to normalise by the batch, and to count the batch in the running statistics; otherwise
                normalise by the running statistics.
            first: number of networks to use, from the first on; not for training.
        """
        mode, momentum = RUNNING, 0.0
        if training and self._renorms[0]:
            counts = self._renorms[0][0]
            mode = RENORM if int(counts.steps) > counts.warmup_steps else BATCH
            momentum = counts.momentum
            for normalisation in (normalisation for network in self._renorms for normalisation in network):
                normalisation.steps += 1
        network = self.values[:first], self._sizes, self._normalised
        *passed, out = forward(*network, self._running_mean, self._running_variance, x, mode, momentum)

        def gradient(upstream: Floats, weights: bool) -> Floats:
            to = self.gradient[:first] if weights else np.empty((len(upstream), 0), np.float32)
            total: Floats = backward(*network, x, *passed, upstream, to, mode, not weights)
            return total

        return gradient, out


def _parameters(network: Sequence[Any]) -> list[torch.Tensor]:
    parameters: list[torch.Tensor] = []
    for module in network:
        if isinstance(module, BatchRenorm1d):
            parameters += [module.scale, module.bias]
        elif isinstance(module, torch.nn.Linear):
            parameters += [module.weight, module.bias]
    return parameters


def batch(model: OffPolicyAlgorithm, n: int) -> tuple[Floats, ...]:
    """Draw n transitions as SB3 does. A transition has `model.n_steps` steps, or fewer if the episode ended earlier.

    Returns:
        Observation (n, d), action (n, n_u), following observation (n, d), reward (n, 1) and discount (n, 1). The
            discount is 0 if the episode ended for another reason than its time limit.
    """
    assert model.replay_buffer is not None
    drawn: Any = model.replay_buffer.sample(n, env=model.get_vec_normalize_env())
    discount = (1.0 - drawn.dones) * (model.gamma if drawn.discounts is None else drawn.discounts)
    tensors = drawn.observations, drawn.actions, drawn.next_observations, drawn.rewards, discount
    return tuple(tensor.numpy() for tensor in tensors)
