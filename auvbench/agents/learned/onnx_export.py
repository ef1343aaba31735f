"""Write a trained policy as an ONNX file: observations scaled and clipped, the network, actions clipped.

PyTorch's exporter records the deterministic action, so any policy whose action depends only on the present
observation can be exported. Scaling is done in float64, as in the policy itself, so that the network gets
bit-identical inputs.
"""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.policies import BasePolicy

from auvbench.errors import MissingExtraError, RunError
from auvbench.policies import exported
from auvbench.untrusted.text import first_line

OPSET = 18
"""operator set of 2023, supported since ONNX Runtime 1.15"""

INPUT, OUTPUT = "observation", "action"

NOTES = (
    "doc_string",
    "metadata_props",
    "producer_name",
    "producer_version",
    "model_version",
    "value_info",
    "denotation",
    "overload",
)
"""Fields of onnx.proto that do not affect the computed actions"""

Floats = NDArray[np.float64]


def build(
    policy: BasePolicy,
    n_observations: int,
    scaling: tuple[Floats, Floats, float] | None,
    about: Mapping[str, str],
) -> bytes:
    """Return the ONNX file of a policy; the same policy gives the same bytes.

    Args:
        policy: policy in evaluation mode; its action is `policy._predict(observation, deterministic=True)`.
        n_observations: length of an observation.
        scaling: mean (n,), scale (n,) and clip of normalised observations; None without normalisation.
        about: readable entries for the file's metadata.

    Raises:
        RunError: the policy has a state, or uses an operation without an ONNX operator.
        MissingExtraError: the onnx package is not installed.
    """
    name = type(policy).__name__
    if not exported.installed("onnx"):
        raise MissingExtraError("onnx", extra="onnx", purpose="policies as ONNX files")
    try:
        with _quiet():
            program = torch.onnx.export(
                _Action(policy, scaling),
                (torch.zeros(3, n_observations),),
                dynamo=True,
                input_names=[INPUT],
                output_names=[OUTPUT],
                dynamic_shapes=({0: torch.export.Dim("n")},),
                opset_version=OPSET,
                external_data=False,
                verbose=False,
            )
        assert program is not None
        model = program.model_proto
    # PyTorch raises exceptions of many types for operations that it cannot record or translate.
    except Exception as error:
        cause = error
        while cause.__cause__ is not None and isinstance(cause.__cause__, Exception):
            cause = cause.__cause__
        raise RunError(f"a {name} cannot be written as a file: {first_line(cause)}") from error
    _drop_notes(model)
    model.producer_name = "auvbench"
    for key, text in about.items():
        model.metadata_props.add(key=key, value=text)
    return bytes(model.SerializeToString(deterministic=True))


def _drop_notes(model: Any) -> None:
    """Clear the exporter's notes, which contain paths of this machine, and the shapes that the exporter inferred."""
    waiting = [model]
    while waiting:
        message = waiting.pop()
        for descriptor, value in message.ListFields():
            if descriptor.name in NOTES:
                message.ClearField(descriptor.name)
            elif descriptor.message_type is not None:
                waiting += [value] if hasattr(value, "ListFields") else value


class _Action(torch.nn.Module):
    """Deterministic action of a policy for raw observations."""

    observation_mean: torch.Tensor
    observation_scale: torch.Tensor

    def __init__(self, policy: BasePolicy, scaling: tuple[Floats, Floats, float] | None) -> None:
        super().__init__()
        self.policy = policy
        self.clip: float | None = None
        if scaling is not None:
            mean, scale, self.clip = scaling
            self.register_buffer("observation_mean", torch.as_tensor(mean))
            self.register_buffer("observation_scale", torch.as_tensor(scale))

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        if self.clip is not None:
            scaled = (observation.double() - self.observation_mean) / self.observation_scale
            observation = scaled.clamp(-self.clip, self.clip).float()
        return self.policy._predict(observation, deterministic=True).clamp(-1.0, 1.0)


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence the exporter's messages, and switch off the argument checks of distributions."""
    distribution = torch.distributions.Distribution
    checked = distribution._validate_args
    log = logging.getLogger("torch.onnx")
    level = log.level
    # A distribution checks its parameters in Python code, which the exporter cannot record.
    distribution.set_default_validate_args(False)
    log.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        log.setLevel(level)
        distribution.set_default_validate_args(checked)
