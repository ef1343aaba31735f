"""Check policy files: the observations they are tried on, and that each is answered by itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from auvbench.agents.base import Agent, Observations
from auvbench.agents.policy_file import PolicyFile
from auvbench.config import schema
from auvbench.config.simulators import Fossen
from auvbench.evaluation.rollout import batch_of
from auvbench.policies.cards import PolicyError
from auvbench.policies.exported import SLACK, Policy
from auvbench.tasks.waypoint import bounded_spec
from auvbench.vehicles import sheet

EPISODES = 64
STEPS = 32
"""of each episode, for a policy that enters"""
CORNERS = 256


def observe_episodes(
    config: schema.TrainConfig, agent: Agent, steps: int, scenarios: str = "test"
) -> Observations:
    """Return what an agent observes in the first steps of `EPISODES` episodes on the embedded simulator.

    Raises:
        ActionError: the agent's actions are not valid.
    """
    embedded = replace(config, simulator=Fossen(name="fossen", max_step=0.01, threads=1))
    batch = batch_of(scenarios, embedded, EPISODES, 0)
    batch.task.assign(np.arange(EPISODES))
    observation = batch.reset()
    agent.reset(np.arange(EPISODES))
    seen = []
    for _ in range(steps):
        seen.append(observation.copy())
        observation = batch.step(agent.act(observation)).observation
    return np.concatenate(seen)


def observe_edges(config: schema.TrainConfig) -> Observations:
    """Return the middle of the observation space, its bounds one by one and all at once, and random points (m, size)."""
    high = bounded_spec(config, sheet.load(config.vehicle)).bounds.astype(np.float64)
    n = len(high)
    rng = np.random.default_rng(0)
    corners = rng.choice([-1.0, 1.0], size=(CORNERS, n))
    between = rng.uniform(-1.0, 1.0, size=(CORNERS, n))
    points = np.concatenate([np.zeros((1, n)), np.eye(n), -np.eye(n), corners, between])
    return np.asarray(points * high, dtype=np.float32)


def check_policy(config: schema.TrainConfig, agent: PolicyFile) -> None:
    """Try the policy of a run on observations of episodes and on the edges of the observation space.

    Raises:
        PolicyError: an answer is no action, differs the second time, or depends on the other observations of the batch.
    """
    policy = agent.policy
    assert policy is not None
    policy.act(observe_edges(config))
    seen = observe_episodes(config, agent, STEPS, scenarios="validation")
    if not np.array_equal(policy.act(seen), policy.act(seen)):
        raise PolicyError(f"{policy.where}: answers the same observations differently the second time")
    _check_rows(policy, seen[:: max(1, len(seen) // 64)][:64])


def _check_rows(policy: Policy, rows: Observations) -> None:
    """Compare the answers to observations in another order, and to each alone."""
    together, turned = policy.act(rows), policy.act(rows[::-1])[::-1]
    alone = np.concatenate([policy.act(row[None]) for row in rows[:8]])
    differs = max(float(np.abs(together - turned).max()), float(np.abs(together[:8] - alone).max()))
    if differs > SLACK:
        raise PolicyError(
            f"{policy.where}: its action for one observation depends on the others in the batch (it differs by "
            f"{differs:.2g}); each row of the input must be answered by itself"
        )
