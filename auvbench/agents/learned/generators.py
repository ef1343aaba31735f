"""The generators of random numbers that a learner draws from, saved and restored bit by bit.

Scenarios and sensor noise are functions of counters (`dynamics/random.py`) and need nothing here.
"""

from __future__ import annotations

import random
from typing import Any

import numpy as np
import torch

from auvbench.agents.components import Components

NAME = "generators"


def capture(components: Components, generators: dict[str, np.random.Generator]) -> None:
    """Adds Python's, numpy's and torch's global generators, and numpy Generators by name."""
    version, words, gauss = random.getstate()
    kind, keys, position, has_gauss, cached = np.random.get_state(legacy=True)  # noqa: NPY002
    components.arrays[NAME] = {
        "python": np.asarray(words, dtype=np.uint64),
        "numpy": np.asarray(keys, dtype=np.uint32),
        "torch": torch.get_rng_state().numpy(),
    }
    components.values[NAME] = {
        "python": {"version": version, "gauss": gauss},
        "numpy": {"kind": kind, "position": position, "has_gauss": has_gauss, "cached": float(cached)},
        "numpy_generators": {name: _plain(item.bit_generator.state) for name, item in generators.items()},
    }


def restore(components: Components, generators: dict[str, np.random.Generator]) -> None:
    """The inverse of `capture`; call it last, since building and loading anything may draw."""
    arrays, values = components.arrays[NAME], components.values[NAME]
    python, legacy = values["python"], values["numpy"]
    random.setstate((python["version"], tuple(int(word) for word in arrays["python"]), python["gauss"]))
    np.random.set_state(  # noqa: NPY002
        (legacy["kind"], arrays["numpy"], legacy["position"], legacy["has_gauss"], legacy["cached"])
    )
    torch.set_rng_state(torch.from_numpy(arrays["torch"].copy()))
    for name, state in values["numpy_generators"].items():
        generators[name].bit_generator.state = state


def _plain(state: Any) -> Any:
    """A bit generator's state as JSON; its integers have up to 128 bits, which JSON does not mind."""
    if isinstance(state, dict):
        return {key: _plain(value) for key, value in state.items()}
    if isinstance(state, np.ndarray):
        raise TypeError("only bit generators whose state is plain integers, such as PCG64, can be saved")
    return int(state) if isinstance(state, np.integer) else state
