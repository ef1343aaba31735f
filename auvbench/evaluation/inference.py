"""Time the actions of an agent on one core of this machine. The result is noise, and part of no row and no digest.

One episode at a time, as on a vehicle: the first action of an episode may take longer than the others. The processor
time of the whole process counts, not wall time, so that other work on the machine does not. The embedded simulator
makes the observations, whichever simulator the test uses.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from dataclasses import replace
from itertools import count, islice
from typing import Any

import numpy as np

from auvbench.agents.base import Agent
from auvbench.config import schema
from auvbench.config.simulators import Fossen
from auvbench.evaluation.rollout import batch_of
from auvbench.runs import provenance

ACTIONS = 200
WARM_UP = 3
"""actions that are not counted: the first calls compile and build"""
SECONDS = 3.0
"""of wall time after which no further action is timed; the first one always is"""


def measure(agent: Agent, config: schema.TrainConfig) -> dict[str, Any]:
    """Return median and 95th percentile of the ms of processor time per action, and the machine.

    Raises:
        ActionError, RunError: the agent's actions are not valid.
    """
    config = replace(config, simulator=Fossen(name="fossen", max_step=0.01, threads=1))
    actions = _times(agent, config)
    for _ in islice(actions, WARM_UP):
        pass
    times: list[float] = []
    begun = time.perf_counter()
    for seconds in islice(actions, ACTIONS):
        times.append(seconds)
        if time.perf_counter() - begun > SECONDS:
            break
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


def _times(agent: Agent, config: schema.TrainConfig) -> Iterator[float]:
    """Yield the processor time of each action in s, episode after episode."""
    for episode in count():
        batch = batch_of("validation", config, 1, 0)
        numbers = np.array([episode])
        batch.task.assign(numbers)
        observation = batch.reset()
        agent.reset(numbers)
        ended = False
        while not ended:
            before = time.process_time()
            action = agent.act(observation)
            yield time.process_time() - before
            result = batch.step(action)
            observation, ended = result.observation, len(result.ended) > 0
