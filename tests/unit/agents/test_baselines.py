"""The classical baseline flies every vehicle; what it knows is what the observation says."""

from __future__ import annotations

import numpy as np
import pytest

from auvbench.agents.classical.cascade import Estimator
from auvbench.envs.batch import Batch
from auvbench.evaluation.rollout import roll_out
from auvbench.registry import AGENTS, resolve
from auvbench.vehicles import sheet
from tests import configs


def success_rate(vehicle: str, episodes: int, *overrides: str) -> float:
    config = configs.training("algo=pid", f"vehicle={vehicle}", *overrides)
    agent = resolve(AGENTS["pid"].factory)(config, sheet.load(config.vehicle))
    rows = np.arange(episodes)
    agent.reset(rows)
    result = roll_out(config, agent, episodes=rows, seed=123, batch=500)
    return float(np.mean([record["outcome"] == "success" for record in result.records]))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("vehicle", "at_least"),
    [
        ("bluerov2", 0.99),
        ("bluerov2_realistic_inertia", 0.99),
        ("bluerov2_wu2018", 0.99),
        ("bluerov2_heavy", 0.95),
        ("bluerov2_heavy_wu2018", 0.99),
        ("rexrov", 0.99),
        # A turning circle of 14 m, 20 s to gather way and 100 s in all: many waypoints are out of its reach.
        ("lrauv", 0.2),
    ],
)
def test_pid_flies_every_vehicle(vehicle, at_least):
    assert success_rate(vehicle, 100) >= at_least


@pytest.mark.slow
def test_pid_also_flies_by_the_body_frame():
    assert success_rate("bluerov2", 100, "task.position_frame=body") >= 0.95


def test_pid_holds_against_a_current():
    assert success_rate("bluerov2", 100, "disturbance.current.speed=0.5") >= 0.95


def test_the_estimator_reads_yaw_and_velocity_from_the_observation():
    config = configs.training("noise=none", "task.goal_radius=0.01", "algo=pid")
    batch = Batch(config, 20, autoreset=False)
    estimator = Estimator(0.1, 0.3, batch.task.spec)
    estimator.reset(20)
    observation = batch.reset()
    action = np.random.default_rng(0).uniform(-0.4, 0.4, (20, 6))
    for _ in range(60):
        estimator.update(observation.astype(float))
        observation = batch.step(action).observation
    estimator.update(observation.astype(float))
    pose, velocity = batch.simulator.pose, batch.simulator.velocity
    w, x, y, z = pose[:, 3:].T
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    np.testing.assert_allclose(np.sin(estimator.yaw - yaw), 0.0, atol=1e-5)
    speed = np.linalg.norm(velocity[:, :3], axis=1)
    np.testing.assert_allclose(np.linalg.norm(estimator.velocity, axis=1), speed, rtol=0.15, atol=0.03)
    np.testing.assert_allclose(estimator.yaw_rate, velocity[:, 5], rtol=0.25, atol=0.02)


def test_pid_never_asks_for_more_than_there_is():
    config = configs.training("algo=pid", "algo.effort=0.5")
    agent = resolve(AGENTS["pid"].factory)(config, sheet.load(config.vehicle))
    agent.reset(np.arange(300))
    rng = np.random.default_rng(1)
    for _ in range(5):
        observation = rng.normal(0, 30, (300, 10)).astype(np.float32)
        assert np.abs(agent.act(observation)).max() <= 0.5 + 1e-12
