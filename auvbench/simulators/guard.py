"""Simulators of installed packages behind the contract: what they give is checked before it is used."""

from __future__ import annotations

from typing import Any

import numpy as np

from auvbench.errors import AgentError
from auvbench.registry import telling
from auvbench.simulators.base import Simulator

_METHODS = ("reset", "set_current", "step", "state_dict", "load_state_dict")
_SHAPES = {"pose": 7, "velocity": 6, "command_force": -1, "power": 0, "effectiveness": -1}
"""Columns of each array; -1: as many as actuators, 0: one number per vehicle."""


def checked(made: Any, who: str) -> Simulator:
    """Return a simulator after a look at its methods and arrays; its steps are checked too.

    Args:
        made: what a package's factory returned.
        who: the simulator with its package, for messages.

    Raises:
        AgentError: a method, an array or the capabilities are missing or of another kind.
    """
    needed = (
        *_METHODS,
        *(["set_waves"] if getattr(getattr(made, "capabilities", None), "waves", False) else []),
    )
    lacking = [name for name in needed if not callable(getattr(made, name, None))]
    lacking += [
        name for name in ("vehicle", "n", "capabilities", "actuators", *_SHAPES) if not hasattr(made, name)
    ]
    if lacking:
        raise AgentError(f"{who}: what it makes, a {type(made).__name__}, lacks {', '.join(lacking)}")
    for name, columns in _SHAPES.items():
        width = len(made.vehicle.units) if columns < 0 else columns
        shape = (made.n, width) if width else (made.n,)
        value = getattr(made, name)
        if not isinstance(value, np.ndarray) or value.shape != shape or value.dtype != np.float64:
            given = f"{value.dtype} {value.shape}" if isinstance(value, np.ndarray) else type(value).__name__
            raise AgentError(f"{who}: {name} is {given}; it must be float64 {shape}")
    step, reset = made.step, made.reset

    def checked_step(command: Any, duration: float) -> None:
        with telling(who, "step fails"):
            step(command, duration)
        _refuse_infinite(made, who, "step")

    def checked_reset(*arguments: Any, **words: Any) -> None:
        with telling(who, "reset fails"):
            reset(*arguments, **words)
        _refuse_infinite(made, who, "reset")

    made.step, made.reset = checked_step, checked_reset
    simulator: Simulator = made
    return simulator


def _refuse_infinite(made: Any, who: str, what: str) -> None:
    for name in _SHAPES:
        value = getattr(made, name).reshape(made.n, -1)
        if not (finite := np.isfinite(value).all(axis=1)).all():
            row = int(np.argmin(finite))
            raise AgentError(f"{who}: {what} gives {name} of vehicle {row} a number that is not finite")
