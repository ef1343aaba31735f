"""Waves of episodes: their draws, their clock, and what they leave as it was."""

from __future__ import annotations

import numpy as np
import pytest
from omegaconf import OmegaConf

from auvbench.config.compose import typed
from auvbench.dynamics import waves
from auvbench.envs.batch import Batch
from auvbench.evaluation import protocol
from auvbench.runs.identity import LATER, digest
from auvbench.tasks.bounds import position_bounds
from auvbench.tasks.disturbances.waves import spread
from auvbench.testing import check_task
from auvbench.testing.tasks import TASK_CHECKS
from auvbench.vehicles import sheet
from tests import configs
from tests.unit.tasks.test_disturbances import alone, configuration, fly


def angles(*overrides: str, n: int = 2000) -> np.ndarray:
    """Directions (n, m) of the components of n episodes, in rad."""
    rays = alone(*overrides, n=n)["waves"].waves.rays
    rows = rays.transpose(0, 3, 1, 2).reshape(-1, waves.COMPONENTS, 3)[:n]
    return np.arctan2(rows[:, :, waves.SINE], rows[:, :, waves.COSINE])


def test_components_spread_about_the_direction_as_the_cosine_squared():
    apart = angles("disturbance=sea_state_3", "disturbance.waves.direction=0.5") - 0.5
    # Of 2/pi cos^2 on a half circle: variance pi^2/12 - 1/2.
    assert np.std(apart) == pytest.approx(np.sqrt(np.pi**2 / 12 - 0.5), rel=0.01)
    assert abs(np.mean(apart)) < 0.01
    assert np.abs(apart).max() < np.pi / 2
    assert not np.any(apart[:, 0] == apart[:, 1])


def test_quantiles_are_symmetric_and_narrow_with_the_exponent():
    for exponent in (1.0, 2.0, 50.0):
        np.testing.assert_allclose(spread(exponent)[::-1], -spread(exponent), atol=1e-3)
    assert spread(1000.0).std() < 0.05


def test_long_crests_run_in_one_direction_drawn_per_episode():
    found = angles("disturbance=waves", "disturbance.waves.spreading=null")
    assert np.all(found == found[:, :1])
    counts, _ = np.histogram(found[:, 0], bins=8, range=(-np.pi, np.pi))
    assert np.all(np.abs(counts - 250) < 80)
    given = angles(
        "disturbance=waves", "disturbance.waves.spreading=null", "disturbance.waves.direction=2", n=3
    )
    np.testing.assert_allclose(given, 2.0, rtol=1e-12)


def test_phases_are_uniform_and_leave_other_draws_as_they_were():
    sea = alone("disturbance=waves", "disturbance.current.speed=0.3", n=2000)
    phases = sea["waves"].waves.rays[:, :, waves.PHASE].ravel()
    counts, _ = np.histogram(phases, bins=10, range=(0.0, 1.0))
    assert np.all(np.abs(counts / len(phases) - 0.1) < 0.005)
    calm = alone("disturbance=current", n=2000)
    np.testing.assert_array_equal(sea["current"].state, calm["current"].state)


def test_an_episode_is_the_same_whatever_ran_before():
    config = configuration("disturbance=sea_state_4", "disturbance.current.speed=0.2", "task.start=[0,0,-6]")

    def tested(episodes):
        batch = Batch(config, len(episodes), seed=123, test=True, autoreset=False)
        batch.task.assign(np.array(episodes))
        return fly(batch, np.tile([0.3, -0.2, 0.5, 0.1, 0.4, -0.1], (20, len(episodes), 1)))

    every = tested(list(range(20)))
    np.testing.assert_array_equal(every[:, 17], tested([17])[:, 0])
    assert not np.array_equal(every[-1, 17], every[-1, 16])


def test_a_new_episode_begins_with_its_own_waves_at_time_0():
    config = configuration("disturbance=sea_state_4", "task.max_steps=7", "task.start=[0,0,-6]")
    batch = Batch(config, 2)
    paths = fly(batch, np.zeros((20, 2, 6)))
    assert batch.task.episodes[0].episode == 2
    assert batch.simulator.waves.time[0] == pytest.approx(0.6)
    second = Batch(config, 2)
    second.task.assign(np.array([1, 1]))
    np.testing.assert_array_equal(fly(second, np.zeros((5, 2, 6)))[:, 0], paths[7:13][:, 0])


@pytest.mark.parametrize("delay", ["{action: 0.0, observation: 0.03}", "{action: 0.07, observation: 0.0}"])
def test_a_split_step_keeps_the_clock_of_the_waves(delay):
    sea = ("disturbance=sea_state_4", "task.start=[0,0,-6]")
    whole = fly(Batch(configuration(*sea), 3), np.zeros((50, 3, 6)))
    split = fly(Batch(configuration(*sea, f"disturbance.delay={delay}"), 3), np.zeros((50, 3, 6)))
    np.testing.assert_allclose(split, whole, atol=2e-5)
    assert np.ptp(whole[:, :, 0], axis=0).min() > 0.05


def test_waves_fade_with_depth():
    reach = []
    for depth in (5, 20):
        config = configuration("disturbance=sea_state_4", f"task.start=[0,0,-{depth}]")
        poses = fly(Batch(config, 8), np.zeros((100, 8, 6)))
        reach.append(np.ptp(poses[:, :, :2], axis=0).mean())
    assert reach[1] < 0.7 * reach[0]


@pytest.mark.slow
@pytest.mark.parametrize("check", TASK_CHECKS, ids=lambda check: check.__name__)
@pytest.mark.parametrize(
    "task", ["waypoint", "station_keeping", "trajectory_tracking", "path_following", "docking"]
)
def test_every_task_keeps_its_contract_in_waves(task, check):
    check_task(
        f"task={task}",
        "vehicle=bluerov2_heavy",
        "disturbance=sea_state_3",
        "disturbance.current.speed=0.3",
        only=check,
    )


@pytest.mark.slow
def test_a_vehicle_with_fins_and_a_delay_keeps_the_contract():
    check_task(
        "vehicle=lrauv", "disturbance=waves", "disturbance.delay.action=0.15", "disturbance.current.speed=0.2"
    )


# --- what is older than waves -----------------------------------------------------------------------------


def test_a_configuration_without_the_keys_is_the_same_run_on_a_calm_sea():
    now = configs.plain("algo=pid", "disturbance=severe")
    assert now["disturbance"]["waves"] == LATER["disturbance.waves"]
    earlier = configs.plain("algo=pid", "disturbance=severe")
    del earlier["disturbance"]["waves"]
    read = typed(OmegaConf.create(earlier))
    assert not read.disturbance.waves.active
    assert "waves" not in Batch(read, 1).disturbances.parts
    assert digest(earlier) == digest(now)
    assert digest(configs.plain("algo=pid", "disturbance=severe", "disturbance.waves.height=1")) != digest(
        now
    )


def test_waves_enter_the_fingerprint_of_a_protocol_only_where_there_are_any():

    def physics(*overrides):
        given = configs.protocol(*overrides)
        condition = protocol.resolve_conditions(given, configs.plain("algo=pid"))[0]
        return protocol._physics(condition)["disturbance"]

    assert "waves" not in physics()
    assert physics('protocol.overrides=["disturbance=sea_state_3"]')["waves"]["height"] == 0.88


def test_the_bounds_of_an_observation_hold_the_motion_of_the_water():
    vehicle = sheet.load(configs.training().vehicle)
    calm, sea = (position_bounds(configs.training(*o), vehicle) for o in ([], ["disturbance=sea_state_4"]))
    assert np.all(sea[:2] > calm[:2])
