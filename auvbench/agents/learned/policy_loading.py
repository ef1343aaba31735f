"""A trained model as it lies on disk, read without unpickling and checked before an agent acts with it.

A damaged file may still load: a flipped bit gives an infinite weight, a scalar stands in for a vector, a variance
is negative. Every such model would drive the vehicle and be scored.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from auvbench.errors import RunError
from auvbench.untrusted import archives

Floats = NDArray[np.float64]


def weights(data: bytes, path: Path, expected: Mapping[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    """The tensors of a policy.

    Args:
        data: content of the file.
        path: the file, for messages.
        expected: the network's own, by name: shapes and types that must agree.

    Raises:
        RunError: it cannot be read, is of another network, or holds a number that is not finite.
    """
    try:
        found = archives.weights(data)
    except ValueError as error:
        raise RunError(f"{path}: the weights cannot be read: {error}") from error
    for name in [*expected, *(name for name in found if name not in expected)]:
        wrong = _tensor_fault(found.get(name), expected.get(name))
        # Running variance of a layer that normalises (CrossQ).
        if not wrong and name.endswith("ra_var") and bool((found[name] < 0.0).any()):
            wrong = "holds a negative number"
        if wrong:
            raise RunError(
                f"{path}: {name} {wrong}; the weights are not those of this run's network, or damaged"
            )
    return dict(found)


def _tensor_fault(value: Any, wanted: torch.Tensor | None) -> str:
    if wanted is None:
        return "is of no part of the network"
    if not isinstance(value, torch.Tensor):
        return "is missing" if value is None else f"is a {type(value).__name__}, not a tensor"
    if value.shape != wanted.shape:
        return f"has shape {tuple(value.shape)}, expected {tuple(wanted.shape)}"
    if value.dtype != wanted.dtype or value.layout != wanted.layout:
        return f"has type {value.dtype}, expected {wanted.dtype}"
    if value.is_floating_point() and not bool(torch.isfinite(value).all()):
        return "holds a number that is not finite"
    return ""


def statistics(data: bytes, path: Path, size: int) -> dict[str, Floats]:
    """The running statistics that scale observations: mean and variance (size,), epsilon and clip ().

    Args:
        data: content of the file.
        path: the file, for messages.
        size: length of an observation.

    Raises:
        RunError: it cannot be read, lacks an entry, or holds one of another shape or an impossible value.
    """
    try:
        found = archives.arrays(data)
    except ValueError as error:
        raise RunError(f"{path}: the statistics cannot be read: {error}") from error
    shapes: dict[str, tuple[int, ...]] = {
        "observation_mean": (size,),
        "observation_variance": (size,),
        "epsilon": (),
        "clip_observations": (),
    }
    for name, shape in shapes.items():
        if wrong := _array_fault(found.get(name), shape, positive=not name.startswith("observation")):
            raise RunError(f"{path}: {name} {wrong}")
    if bool((found["observation_variance"] < 0.0).any()):
        raise RunError(f"{path}: observation_variance holds a negative number")
    return {name: found[name] for name in shapes}


def _array_fault(value: Any, shape: tuple[int, ...], *, positive: bool) -> str:
    if value is None:
        return "is missing"
    if value.shape != shape:
        return f"has shape {value.shape}, expected {shape}"
    if value.dtype != np.float64:
        return f"has type {value.dtype}, expected float64"
    if not bool(np.isfinite(value).all()):
        return "holds a number that is not finite"
    return "is not positive" if positive and not bool((value > 0.0).all()) else ""
