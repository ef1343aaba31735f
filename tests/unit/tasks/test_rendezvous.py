"""Docking with a moving vehicle, against its definition in docs/moving-targets.md."""

from __future__ import annotations

import math

import numpy as np
import pytest

from auvbench.envs.batch import Batch
from auvbench.errors import ConfigError
from auvbench.tasks import rows
from tests import configs
from tests.unit.tasks.test_tasks import HEAVY, advance, batch_of, put

BLOCKS = "task.observation=[position_error,yaw_error,velocity_error,goal_error,velocity,angular_velocity,gravity,previous_action]"


def test_a_dock_at_rest_has_the_bits_of_docking() -> None:
    """Only the blocks differ: docking does not observe the velocity error by default."""
    still = "task.course_speed_low=0", "task.course_speed_high=0"
    moving = Batch(configs.training("task=rendezvous", HEAVY, "disturbance=moderate", *still), 3, seed=5)
    dock = Batch(configs.training("task=docking", HEAVY, "disturbance=moderate", BLOCKS), 3, seed=5)
    np.testing.assert_array_equal(moving.reset(), dock.reset())
    rng = np.random.default_rng(1)
    for _ in range(20):
        action = rng.uniform(-1, 1, (3, 8))
        mine, theirs = moving.step(action), dock.step(action)
        np.testing.assert_array_equal(mine.observation, theirs.observation)
        np.testing.assert_array_equal(mine.reward, theirs.reward)
    np.testing.assert_array_equal(moving.simulator.pose, dock.simulator.pose)


def test_the_dock_moves_along_its_course_at_its_speed() -> None:
    batch = batch_of("rendezvous", n=20)
    e = batch.task.episodes
    first, velocity = e.goal.copy(), e.reference_velocity.copy()
    ends = np.array([batch.task.goal(i) for i in range(20)])
    speed = np.linalg.norm(velocity, axis=1)
    assert 0.2 <= speed.min() < 0.25
    assert 0.35 < speed.max() <= 0.4
    np.testing.assert_allclose(
        velocity[:, :2], speed[:, None] * np.stack([np.cos(e.reference_yaw), np.sin(e.reference_yaw)], axis=1)
    )
    for _ in range(7):
        batch.step(np.zeros((20, 8)))
    np.testing.assert_allclose(e.goal, first + 0.7 * velocity, atol=1e-12)
    np.testing.assert_allclose(ends, first + 60.0 * velocity, atol=1e-12)


@pytest.mark.parametrize(
    ("along", "outcome"), [(0.3, rows.SUCCESS), (0.0, rows.GOES_ON), (-0.3, rows.GOES_ON)]
)
def test_success_is_slowness_relative_to_the_moving_dock(along: float, outcome: int) -> None:
    batch = batch_of("rendezvous", "task.course_speed_low=0.3", "task.course_speed_high=0.3")
    e = batch.task.episodes[0]
    yaw = float(e.reference_yaw)
    # The dock moves by 0.03 m before the step is judged.
    put(batch, batch.task.episodes[0].goal, yaw=yaw, velocity=(along, 0.0, 0.0))
    assert advance(batch)[1] == outcome
    assert e.speed == pytest.approx(0.3 - along)
    assert e.dock_distance == pytest.approx(0.03)


def test_it_is_a_collision_to_come_from_ahead() -> None:
    batch = batch_of("rendezvous")
    yaw, goal = float(batch.task.episodes[0].reference_yaw), np.array(batch.task.episodes[0].goal)
    bow = np.array([math.cos(yaw), math.sin(yaw), 0.0])
    put(batch, goal - 0.8 * bow, yaw=yaw)
    assert advance(batch)[1] == rows.GOES_ON
    put(batch, goal + 0.9 * bow, yaw=yaw)
    assert advance(batch)[1] == rows.COLLISION
    record = batch.task.records(np.array([0]))[0]
    assert (record["final_gap_m"], record["final_course_error_rad"]) == (25.0, math.pi)


@pytest.mark.parametrize(
    ("override", "message"),
    [
        (
            "task.course_speed_low=0.5",
            "task.course_speed_low=0.5: must be at most task.course_speed_high=0.4",
        ),
        ("task.start_low=0.5", "task.start_low=0.5: must be at least task.clearance=1"),
        ("task.vehicles=2", "task.vehicles"),
    ],
)
def test_wrong_values_are_refused_in_one_line(override: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message) as caught:
        configs.training("task=rendezvous", override)
    assert "\n" not in str(caught.value)
