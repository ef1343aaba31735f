"""The waypoint task against section 3 of the thesis page, by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from auvbench.envs.batch import Batch
from auvbench.errors import ConfigError
from auvbench.tasks import rows
from auvbench.tasks.waypoint import WaypointTask
from auvbench.vehicles import sheet
from tests import configs


def make(*overrides: str, n: int = 1) -> WaypointTask:
    config = configs.training("noise=none", *overrides)
    task = WaypointTask(config, sheet.load(config.vehicle), n, seed=7)
    task.reset(np.arange(n))
    return task


def put(task: WaypointTask, waypoint, distance_before: float) -> None:
    task.episodes[0].reference = waypoint
    task.episodes[0].distance = distance_before


def step(task: WaypointTask, position, force=None, power=0.0, action=None) -> tuple[float, int]:
    pose = np.array([[*position, 1.0, 0.0, 0.0, 0.0]])
    force = np.zeros((1, 6)) if force is None else np.asarray(force, dtype=float)[None]
    action = np.zeros((1, 6)) if action is None else np.asarray(action, dtype=float)[None]
    task.checked(task.advance(pose, np.zeros((1, 6)), action, force, np.array([power])))
    return float(task.reward[0]), int(task.outcome[0])


@pytest.mark.parametrize("K", [1.0, 40.0, 100.0])
def test_reward_of_a_step_nearer_is_k_exp_of_minus_d_over_20(K):
    task = make(f"reward.k={K}")
    put(task, (10.0, 0.0, -20.0), distance_before=9.0)
    reward, outcome = step(task, (2.0, 0.0, -20.0))
    assert reward == pytest.approx(K * math.exp(-8.0 / 20.0), rel=1e-15)
    assert outcome == -1


def test_a_step_that_does_not_come_nearer_costs_10():
    task = make()
    put(task, (10.0, 0.0, -20.0), distance_before=8.0)
    assert step(task, (2.0, 0.0, -20.0)) == (-10.0, -1)  # as far as before
    assert step(task, (1.0, 0.0, -20.0)) == (-10.0, -1)


def test_success_within_three_metres():
    task = make()
    put(task, (10.0, 0.0, -20.0), distance_before=9.0)
    assert step(task, (7.0, 0.0, -20.0))[1] == -1  # at 3 m exactly: not yet
    assert step(task, (7.001, 0.0, -20.0)) == (500.0, rows.SUCCESS)


@pytest.mark.parametrize("z", [-60.001, -0.999])
def test_leaving_the_depth_limits_is_a_collision_even_at_the_goal(z):
    task = make()
    put(task, (0.0, 0.0, z), distance_before=9.0)
    assert step(task, (0.0, 0.0, z)) == (-550.0, rows.COLLISION)


@pytest.mark.parametrize("z", [-60.0, -1.0])
def test_the_limits_themselves_are_inside(z):
    task = make()
    put(task, (20.0, 0.0, -30.0), distance_before=90.0)
    assert step(task, (0.0, 0.0, z))[1] == -1


def test_timeout_after_1000_steps_and_success_in_the_last_one_counts():
    task = make()
    put(task, (10.0, 0.0, -20.0), distance_before=9.0)
    task.episodes[0].steps = 998
    assert step(task, (0.0, 0.0, -20.0))[1] == -1
    assert step(task, (0.0, 0.0, -20.0)) == (-10.0, rows.TIMEOUT)
    task.episodes[0].steps = 999
    assert step(task, (9.0, 0.0, -20.0)) == (500.0, rows.SUCCESS)


def test_timeout_is_a_truncation_and_the_others_are_terminations():
    config = configs.training("task.max_steps=3", "task.goal_radius=0.001")
    batch = Batch(config, 2)
    batch.reset()
    for _ in range(2):
        result = batch.step(np.zeros((2, 6)))
    result = batch.step(np.zeros((2, 6)))
    assert result.truncated.all()
    assert not result.terminated.any()


def test_observation_is_yaw_error_position_error_and_previous_action():
    task = make()
    task.episodes[0].reference = (3.0, 4.0, -30.0)
    task.previous[0] = np.linspace(-1, 1, 6)
    yaw = 0.5
    pose = np.array([[0.0, 0.0, -20.0, math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)]])
    observed = task.observe(pose, np.zeros((len(pose), 6)))[0]
    expected = [math.atan2(4, 3) - yaw, 3.0, 4.0, -10.0, *np.linspace(-1, 1, 6)]
    np.testing.assert_allclose(observed, expected, rtol=1e-6)
    body = make("task.position_frame=body")
    body.episodes[0] = task.episodes[0]
    c, s = math.cos(yaw), math.sin(yaw)
    np.testing.assert_allclose(
        body.observe(pose, np.zeros((1, 6)))[0, 1:4], [c * 3 + s * 4, -s * 3 + c * 4, -10.0], rtol=1e-6
    )


def test_angles_wrap_to_minus_pi_inclusive_pi_exclusive():
    assert rows.wrap(math.pi) == -math.pi
    assert rows.wrap(-math.pi) == -math.pi
    assert rows.wrap(3 * math.pi / 2) == pytest.approx(-math.pi / 2)
    assert -math.pi <= rows.wrap(np.nextafter(-math.pi, -4)) < math.pi


def test_scenarios_are_uniform_in_the_box_and_in_yaw():
    n = 20_000
    config = configs.training()
    task = WaypointTask(config, sheet.load(config.vehicle), n, seed=1)
    pose = task.reset(np.arange(n))
    low, high = np.array([-20.0, -20.0, -60.0]), np.array([20.0, 20.0, -1.0])
    unit = (task.episodes.reference[:] - low) / (high - low)
    yaw = (task.episodes.start_yaw[:] + math.pi) / (2 * math.pi)
    for sample in (*unit.T, yaw):
        assert 0.0 <= sample.min() < 0.001
        assert 0.999 < sample.max() <= 1.0
        # Kolmogorov-Smirnov distance; its 99.9 % quantile is 1.95 / sqrt(n).
        assert np.abs(np.sort(sample) - np.arange(1, n + 1) / n).max() < 1.95 / math.sqrt(n)
    np.testing.assert_array_equal(pose[:, :3], np.broadcast_to([0.0, 0.0, -20.0], (n, 3)))
    np.testing.assert_allclose(np.linalg.norm(pose[:, 3:], axis=1), 1.0)
    np.testing.assert_allclose(2 * np.arctan2(pose[:, 6], pose[:, 3]), task.episodes.start_yaw[:])


@pytest.mark.parametrize(("sign", "negative"), [("both", 0.5), ("positive", 0.0)])
def test_noise_has_the_stated_magnitudes_and_signs(sign, negative):
    n = 5000
    config = configs.training(f"noise.sign={sign}")
    task = WaypointTask(config, sheet.load(config.vehicle), n, seed=1)
    pose = task.reset(np.arange(n))
    observed = task.observe(pose, np.zeros((len(pose), 6))).astype(float)
    error = task.episodes.reference[:] - pose[:, :3]
    position_noise = error - observed[:, 1:4]
    assert np.abs(position_noise).min() >= 0.05 - 1e-5
    assert np.abs(position_noise).max() <= 0.1 + 1e-5
    assert np.mean(position_noise < 0) == pytest.approx(negative, abs=0.02)
    command = task.add_noise(np.zeros((n, 6))).copy()
    newtons = np.abs(command) * 40.0  # +-40 N for actions in [-1, 1]
    assert newtons.min() >= 0.01 - 1e-12
    assert newtons.max() <= 0.05 + 1e-12
    task.episodes.steps[:] += 1
    assert (command != task.add_noise(np.zeros((n, 6)))).mean() > 0.999, "drawn anew each step"


def test_metrics_of_a_hand_made_episode():
    task = make("step.frequency=10")
    put(task, (40.0, 0.0, -20.0), distance_before=40.0)
    task.episodes[0].initial_distance = 40.0
    step(task, (3.0, 4.0, -20.0), force=[3, 0, 0, 4, 0, 0], power=10.0, action=[0.3, 0, 0, 0.4, 0, 0])
    step(task, (6.0, 0.0, -20.0), force=[0, 0, 0, 0, 0, 12], power=30.0, action=[0.3, 0, 0, 0.4, 0, 0])
    step(task, (38.0, 0.0, -20.0), force=[0] * 6, power=0.0, action=[0] * 6)
    (row,) = task.records(np.array([0]))
    assert row["outcome"] == "success"
    assert row["steps"] == 3
    assert row["duration_s"] == pytest.approx(0.3)
    assert row["deviation_mean_m"] == pytest.approx(4.0 / 3)
    assert row["deviation_std_m"] == pytest.approx(np.std([4.0, 0.0, 0.0]))
    assert row["command_norm_mean_N"] == pytest.approx((5 + 12 + 0) / 3)
    assert row["command_norm_sum_N"] == pytest.approx(17.0)
    assert row["energy_J"] == pytest.approx(4.0)
    assert row["path_length_m"] == pytest.approx(5 + 5 + 32)
    assert row["path_efficiency"] == pytest.approx((40.0 - 2.0) / 42.0)
    assert row["smoothness_per_s"] == pytest.approx((0.5 + 0.0 + 0.5) / 3 / 0.1)
    assert row["depth_margin_m"] == pytest.approx(19.0)
    assert row["final_distance_m"] == pytest.approx(2.0)
    expected = math.exp(-math.hypot(37, 4) / 20) + math.exp(-34 / 20) + 500
    assert row["return"] == pytest.approx(expected)


def test_a_position_that_is_not_finite_stops_the_run():
    from auvbench.errors import TrainingError

    task = make()
    with pytest.raises(TrainingError, match=r"environment 0 is not finite after step 1 of its episode 0"):
        step(task, (math.nan, 0.0, -20.0))


def test_the_compiled_observation_has_the_declared_blocks() -> None:
    task = make()
    task.previous[:] = np.arange(6) / 10
    pose = np.array([[1.0, 2.0, -20.0, 1.0, 0.0, 0.0, 0.0]])
    put(task, (10.0, 0.0, -25.0), distance_before=9.0)
    seen, spec = task.observe(pose, np.zeros((len(pose), 6)))[0], task.spec
    np.testing.assert_allclose(seen[spec["position_error"]], [9.0, -2.0, -5.0])
    np.testing.assert_allclose(seen[spec["previous_action"]], task.previous[0], rtol=1e-6)
    assert spec.size == len(seen) == len(spec.bounds) == len(spec.card())
    with pytest.raises(ConfigError, match="does not observe depth"):
        spec["depth"]
