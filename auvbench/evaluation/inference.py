"""How long an agent takes for an action, on one core of this machine: noise, and so no part of any row or digest.

One episode at a time, as a vehicle would ask: an agent's first action of an episode may take longer than the others.
Processor time of the whole process is counted, not that of a clock on the wall: an action that had to wait for other work
on the machine (trainings beside a test are usual) would seem several times as long.
The embedded simulator makes the observations, whatever simulator the test is on.
"""

from __future__ import annotations

import os
import time
from dataclasses import replace
from typing import Any

import numpy as np

from auvbench.agents.base import Agent
from auvbench.config import schema
from auvbench.config.simulators import Fossen
from auvbench.evaluation.rollout import batch_of
from auvbench.runs import provenance

ACTIONS = 200
SECONDS = 3.0
"""after which no further action is timed, however few were"""


def measure(agent: Agent, config: schema.TrainConfig) -> dict[str, Any]:
    """Median and 95th percentile of the ms of processor time that an action takes, and on what machine.

    Args:
        agent: fresh; nobody asks it for anything afterwards.
        config: of the condition, whose validation episodes it steers.

    Raises:
        ActionError, RunError: the agent's actions are none.
    """
    config = replace(config, simulator=Fossen(name="fossen", max_step=0.01, threads=1))
    times: list[float] = []
    begun = time.perf_counter()
    episode = 0
    _act(agent, config, 0, [], begun, most=3)  # what is compiled or built at the first call is none of it
    while len(times) < ACTIONS and time.perf_counter() - begun < SECONDS:
        _act(agent, config, episode, times, begun, most=ACTIONS)
        episode += 1
    ms = 1e3 * np.asarray(times)
    return {
        "actions": len(times),
        "median_ms": round(float(np.median(ms)), 4),
        "p95_ms": round(float(np.percentile(ms, 95)), 4),
        "clock": "processor",
        "threads": 1,
        "cpu": provenance.host()["cpu"],
        "cores": os.cpu_count(),
        "load": round(os.getloadavg()[0], 2),
    }


def _act(
    agent: Agent, config: schema.TrainConfig, episode: int, times: list[float], begun: float, most: int
) -> None:
    """One episode to its end, to `most` actions in all, or to the end of the time."""
    batch = batch_of("validation", config, 1, 0)
    numbers = np.array([episode])
    batch.task.assign(numbers)
    observation = batch.reset()
    agent.reset(numbers)
    while len(times) < most and (not times or time.perf_counter() - begun < SECONDS):
        before = time.process_time()
        action = agent.act(observation)
        times.append(time.process_time() - before)
        result = batch.step(action)
        observation = result.observation
        if len(result.ended):
            return
