"""Run agents of installed packages, and check their results before they steer a vehicle."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from auvbench import registry
from auvbench.agents.base import Actions, Agent, Components, Integers, Learner, Observations
from auvbench.config import schema
from auvbench.errors import AgentError
from auvbench.vehicles.vehicle_model import VehicleModel


def make(config: schema.TrainConfig, vehicle: VehicleModel) -> Agent:
    """Return the agent of an installed package, for `config.algo`.

    Raises:
        ConfigError: the package is not installed, has another version, or cannot be imported.
        AgentError: the agent cannot be created, or lacks a required method.
    """
    algo = config.algo
    label = f"{algo.agent} of {algo.package}"
    factory = registry.resolve(registry.AGENTS.choose(algo.agent, algo.package).code)
    with registry.telling(label, "cannot be made"):
        agent = factory(config, vehicle)
    lacking = [name for name in ("reset", "act") if not callable(getattr(agent, name, None))]
    if lacking:
        raise AgentError(
            f"{label}: its result, a {type(agent).__name__}, lacks {' and '.join(lacking)}; an agent needs reset and act"
        )
    kind = PluginLearner if algo.learns else PluginAgent
    return kind(agent, label, len(vehicle.actuators))


class PluginAgent:
    """Wrapper that checks every action of a plug-in agent.

    Attributes:
        inner: the plug-in's own agent.
    """

    def __init__(self, agent: Any, owner: str, n_u: int) -> None:
        self.inner = agent
        self._owner = owner
        self._n_u = n_u
        # The wrapper has an optional method only if the plug-in's agent has it.
        for name, checked in (("ended", self._ended), ("notes", self._notes)):
            if callable(getattr(agent, name, None)):
                setattr(self, name, checked)

    def _ended(self, rows: Integers) -> None:
        with registry.telling(self._owner, "ended fails"):
            self.inner.ended(rows.copy())

    def _notes(self) -> dict[str, int]:
        with registry.telling(self._owner, "notes fails"):
            notes = dict(self.inner.notes())
        if not all(isinstance(name, str) and type(number) is int for name, number in notes.items()):
            raise AgentError(f"{self._owner}: notes must give a dict of whole numbers by name")
        return notes

    def reset(self, episodes: Integers) -> None:
        """Reset the agent with a copy of the episodes.

        Raises:
            AgentError: the agent raises an exception.
        """
        with registry.telling(self._owner, "reset fails"):
            self.inner.reset(episodes.copy())

    def act(self, observation: Observations) -> Actions:
        """Return the agent's actions for a copy of the observations.

        Raises:
            AgentError: the agent raises an exception, or its actions have a wrong shape or type, or are not
                finite or out of range.
        """
        with registry.telling(self._owner, "act fails"):
            action = self.inner.act(observation.copy())
        if fault := action_fault(action, len(observation), self._n_u):
            raise AgentError(f"{self._owner}: {fault}")
        return np.asarray(action)


def action_fault(action: Any, n: int, n_u: int) -> str:
    """Return what is wrong with actions for n episodes, or '' for numbers in [-1, 1] of shape (n, n_u).

    >>> import numpy as np
    >>> action_fault(np.full((2, 6), 1.5), 2, 6)
    'actuator 0 of episode 0 gets the action 1.5; actions must be in [-1, 1]'
    """
    if not isinstance(action, np.ndarray):
        return f"act gives a {type(action).__name__}; it must give a numpy array of shape ({n}, {n_u})"
    if action.shape != (n, n_u):
        return f"act gives actions of shape {action.shape}; it must be ({n}, {n_u}), episodes times actuators"
    if action.dtype.kind not in "fiu":
        return f"act gives actions of type {action.dtype}; they must be numbers"
    wrong = ~(np.abs(action) <= 1.0)  # NaN included
    if wrong.any():
        row, column = (int(index[0]) for index in np.nonzero(wrong))
        return f"actuator {column} of episode {row} gets the action {action[row, column]:g}; actions must be in [-1, 1]"
    return ""


class PluginLearner(PluginAgent):
    """Wrapper of a plug-in agent that learns.

    `learn`, `save`, `restore`, `replay` and `exact_resume` come directly from the plug-in's agent, without checks: the
    worker reports exceptions during training.
    """

    inner: Learner

    def __getattr__(self, name: str) -> Any:
        if name in ("learn", "save", "restore", "replay", "exact_resume"):
            return getattr(self.inner, name)
        raise AttributeError(name)

    def load(self, folder: Path) -> None:
        """Load the agent's files.

        Raises:
            AgentError: the agent raises an exception.
        """
        with registry.telling(self._owner, f"load fails on {folder}"):
            self.inner.load(folder)

    def state(self) -> Components:
        """Return the agent's state.

        Raises:
            AgentError: `state` of the agent does not return Components.
        """
        state = self.inner.state()
        if not isinstance(state, Components):
            raise AgentError(f"{self._owner}: state gives a {type(state).__name__}; it must give Components")
        return state
