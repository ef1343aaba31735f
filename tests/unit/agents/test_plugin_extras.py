"""What an installed agent may have beside the contract reaches it, and is checked."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from auvbench.agents.installed import PluginAgent
from auvbench.errors import AgentError
from auvbench.evaluation.rollout import counted


class Plain:
    def reset(self, episodes: Any) -> None: ...

    def act(self, observation: Any) -> Any:
        return np.zeros((len(observation), 6))


class Counting(Plain):
    def __init__(self, notes: Any) -> None:
        self._notes = notes
        self.over: list[int] = []

    def notes(self) -> Any:
        return self._notes

    def ended(self, rows: Any) -> None:
        self.over += rows.tolist()


def test_an_agent_without_them_has_none() -> None:
    agent = PluginAgent(Plain(), "plain of x==1", 6)
    assert not hasattr(agent, "ended")
    assert counted(agent) == {}


def test_they_reach_the_agent() -> None:
    inner = Counting({"solves": 3})
    agent: Any = PluginAgent(inner, "counting of x==1", 6)
    agent.ended(np.array([1, 4]))
    assert inner.over == [1, 4]
    assert counted(agent) == {"solves": 3}


@pytest.mark.parametrize("notes", [{"solves": 1.5}, {3: 3}, {"solves": True}, 7, [("a",)]])
def test_counts_that_are_none_are_one_line(notes: Any) -> None:
    agent = PluginAgent(Counting(notes), "counting of x==1", 6)
    with pytest.raises(AgentError, match=r"counting of x==1: notes (fails|must give)"):
        counted(agent)
