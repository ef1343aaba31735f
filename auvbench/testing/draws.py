"""Provide the functions that the conformance checks share.

These are the loop over the checks, their error, and tests for equal bits, for draws from global generators and for pickles.
"""

from __future__ import annotations

import pickle
import random
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.errors import AgentError, AuvbenchError


class ConformanceError(AssertionError):
    """A part, such as an agent or a task, breaks its contract; the message names the part and the fault."""


def run_checks(
    checks: Sequence[Callable[..., None]],
    only: Callable[..., None] | None,
    overrides: Sequence[str],
    run: Callable[[Callable[..., None]], None],
) -> None:
    """Call `run` with each check, or only with `only`; an error names the overrides and the check."""
    for check in checks:
        if only is not None and check is not only:
            continue
        try:
            run(check)
        except (ConformanceError, AgentError) as error:
            name = check.__name__.replace("_", " ")
            raise ConformanceError(f"{' '.join(overrides)}: {name}: {error}") from error


@contextmanager
def failing(what: str) -> Iterator[None]:
    """Turn an unexpected exception into a `ConformanceError`: `write fails: ValueError: ...`."""
    try:
        yield
    except (ConformanceError, AuvbenchError):
        raise
    except Exception as error:
        raise ConformanceError(f"{what} fails: {type(error).__name__}: {error}") from error


def actions(step: int, n: int, n_u: int, first: int = 0) -> NDArray[np.float64]:
    """Return actions (n, n_u) in [-1, 1] that differ in every row and step."""
    rows = first + np.arange(n)[:, None]
    return np.asarray(np.sin(0.7 * step + 1.3 * rows + 0.9 * np.arange(n_u)))


def same(first: Any, second: Any, what: str) -> None:
    """Raise `ConformanceError` unless two arrays have the same shape, type and bits."""
    a, b = np.asarray(first), np.asarray(second)
    if a.shape != b.shape or a.dtype != b.dtype:
        raise ConformanceError(f"{what}: {a.dtype}{a.shape} and {b.dtype}{b.shape}")
    if a.tobytes() != b.tobytes():
        differing = np.argwhere(~((a == b) | ((a != a) & (b != b))))
        where = f"first at {differing[0].tolist()}" if len(differing) else "in the sign of a zero"
        largest = float(np.max(np.abs(a.astype(np.float64) - b.astype(np.float64))))
        raise ConformanceError(f"{what}: they differ by up to {largest:.3g}, {where}")


def generators() -> dict[str, bytes]:
    """Return the state of the global generators: Python's, NumPy's and, if imported, torch's."""
    states = {
        "random": repr(random.getstate()).encode(),
        "numpy.random": repr(np.random.get_state(legacy=True)).encode(),  # noqa: NPY002
    }
    torch = sys.modules.get("torch")
    if torch is not None:
        states["torch"] = torch.get_rng_state().numpy().tobytes()
    return states


def reseed_generators(seed: int) -> None:
    """Seed the global generators, so that every draw from them changes."""
    random.seed(seed)
    np.random.seed(seed)  # noqa: NPY002
    torch = sys.modules.get("torch")
    if torch is not None:
        torch.manual_seed(seed)


@contextmanager
def untouched(what: str) -> Iterator[None]:
    """Raise `ConformanceError` if the code inside this context draws from a global generator."""
    before = generators()
    yield
    after = generators()
    for name in before:
        if before[name] != after[name]:
            raise ConformanceError(
                f"{what} must not draw from the global generator of {name}; use a separate generator"
            )


_watching: list[str] = []
_hooked = False


def _hear(event: str, arguments: tuple[Any, ...]) -> None:
    if event == "pickle.find_class" and _watching:
        _watching.append(f"{arguments[0]}.{arguments[1]}")


@contextmanager
def no_unpickling(what: str) -> Iterator[None]:
    """Raise `ConformanceError` if the code inside this context unpickles anything that could run code."""
    global _hooked
    if not _hooked:
        # Python cannot remove an audit hook: it stays, but does nothing outside this context.
        sys.addaudithook(_hear)
        _hooked = True
    _watching.append("")
    try:
        yield
        heard = [name for name in _watching if name]
    finally:
        _watching.clear()
    if heard:
        raise ConformanceError(
            f"{what} unpickles {heard[0]}, and a pickle could run code; load plain arrays instead"
        )


def is_pickle(data: bytes) -> bool:
    """Return whether a file's whole content is a pickle; parts of torch's and NumPy's archives are not examined."""
    if data[:1] != pickle.PROTO or len(data) < 2 or data[1] > pickle.HIGHEST_PROTOCOL:
        return False
    return data.rstrip(b"\n")[-1:] == pickle.STOP
