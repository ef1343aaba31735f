"""Random generators that belong to the whole process, and pickles: neither is an agent's to use."""

from __future__ import annotations

import pickle
import random
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from auvbench.testing.failing import ConformanceError


def generators() -> dict[str, bytes]:
    """The state of the process's generators: Python's, numpy's and, where it is imported, torch's."""
    found = {
        "random": repr(random.getstate()).encode(),
        "numpy.random": repr(np.random.get_state(legacy=True)).encode(),  # noqa: NPY002
    }
    torch = sys.modules.get("torch")
    if torch is not None:
        found["torch"] = torch.get_rng_state().numpy().tobytes()
    return found


def reseed_generators(seed: int) -> None:
    """Seeds the process's generators, so that every draw from them changes."""
    random.seed(seed)
    np.random.seed(seed)  # noqa: NPY002
    torch = sys.modules.get("torch")
    if torch is not None:
        torch.manual_seed(seed)


@contextmanager
def untouched(what: str) -> Iterator[None]:
    """Raises `ConformanceError` if the process's generators have moved inside."""
    before = generators()
    yield
    after = generators()
    for name in before:
        if before[name] != after[name]:
            raise ConformanceError(f"{what} draws from the process's generator of {name}; use one of its own")


_watching: list[str] = []
_hooked = False


def _hear(event: str, arguments: tuple[Any, ...]) -> None:
    if event == "pickle.find_class" and _watching:
        _watching.append(f"{arguments[0]}.{arguments[1]}")


@contextmanager
def no_unpickling(what: str) -> Iterator[None]:
    """Raises `ConformanceError` if anything is unpickled inside that could run code."""
    global _hooked
    if not _hooked:
        sys.addaudithook(_hear)  # Python offers no way to take one away: it stays, and is deaf outside
        _hooked = True
    _watching.append("")
    try:
        yield
        heard = [name for name in _watching if name]
    finally:
        _watching.clear()
    if heard:
        raise ConformanceError(f"{what} unpickles {heard[0]}: a file from a stranger could so run code")


def is_pickle(data: bytes) -> bool:
    """Whether a file's content is a pickle, as it lies there; archives of torch and numpy have parts of their own."""
    if data[:1] != pickle.PROTO or len(data) < 2 or data[1] > pickle.HIGHEST_PROTOCOL:
        return False
    return data.rstrip(b"\n")[-1:] == pickle.STOP
