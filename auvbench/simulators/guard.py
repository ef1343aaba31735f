"""Check simulators of installed packages: methods and arrays at creation, and the arrays again after each step and reset."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from auvbench.errors import AgentError
from auvbench.registry import telling
from auvbench.simulators.base import Simulator

_METHODS = ("reset", "set_current", "step", "state_dict", "load_state_dict")
_ARRAYS = ("pose", "velocity", "command_force", "power", "effectiveness")


def shapes(simulator: Simulator) -> dict[str, tuple[int, ...]]:
    """Return the shapes of a simulator's arrays; all are float64."""
    n, n_u = simulator.n, len(simulator.vehicle.units)
    return dict(zip(_ARRAYS, ((n, 7), (n, 6), (n, n_u), (n,), (n, n_u)), strict=True))


def checked(made: Any, who: str) -> Simulator:
    """Check a simulator's methods and arrays; return it with a `step` and a `reset` that check the arrays after each call.

    Args:
        made: object that a package's factory returned.
        who: name of the simulator and its package, for messages.

    Raises:
        AgentError: a method or an attribute is missing, or an array has a wrong type or shape.
    """
    can = getattr(made, "capabilities", None)
    needed = (*_METHODS, *(f"set_{name}" for name in ("waves", "vehicles") if getattr(can, name, False)))
    lacking = [name for name in needed if not callable(getattr(made, name, None))]
    lacking += [
        name for name in ("vehicle", "n", "capabilities", "actuators", *_ARRAYS) if not hasattr(made, name)
    ]
    if lacking:
        raise AgentError(
            f"{who}: its factory returned a {type(made).__name__}, which lacks {', '.join(lacking)}"
        )
    for name, shape in shapes(made).items():
        value = getattr(made, name)
        if not isinstance(value, np.ndarray) or value.shape != shape or value.dtype != np.float64:
            given = f"{value.dtype} {value.shape}" if isinstance(value, np.ndarray) else type(value).__name__
            raise AgentError(f"{who}: {name} is {given}; it must be float64 {shape}")
    for name in ("step", "reset"):
        setattr(made, name, _Checked(made, name, getattr(made, name), who))
    simulator: Simulator = made
    return simulator


@dataclass(frozen=True)
class _Checked:
    """A method of a simulator that checks the simulator's arrays after each call.

    It is not a closure, so that a copy of the simulator checks the arrays of the copy.
    """

    made: Any
    name: str
    method: Callable[..., None]
    who: str

    def __call__(self, *arguments: Any, **words: Any) -> None:
        with telling(self.who, f"{self.name} fails"):
            self.method(*arguments, **words)
        _refuse_infinite(self.made, self.who, self.name)


def _refuse_infinite(made: Any, who: str, what: str) -> None:
    for name in _ARRAYS:
        value = getattr(made, name).reshape(made.n, -1)
        if not (finite := np.isfinite(value).all(axis=1)).all():
            row = int(np.argmin(finite))
            raise AgentError(f"{who}: {what} writes a number that is not finite into {name} of vehicle {row}")
