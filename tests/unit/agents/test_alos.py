"""Adaptive line-of-sight guidance against the closed form of its theory, and on vehicles."""

from __future__ import annotations

import math

import numpy as np
import pytest

from auvbench.agents.base import make
from auvbench.agents.classical.alos import BEYOND, Guidance, projected
from auvbench.envs.batch import Batch
from auvbench.errors import ConfigError
from auvbench.evaluation.rollout import roll_out
from auvbench.vehicles import sheet
from tests import configs

PATH = ("task=path_following", "algo=alos")
SPEED, DT = 0.8, 0.1


def followed(azimuth: float, elevation: float, current: np.ndarray) -> tuple[Guidance, np.ndarray]:
    """Let a vehicle that goes exactly as it is steered follow a straight path for 400 s; return its errors at the end."""
    guidance = Guidance(configs.training(*PATH), sheet.load("bluerov2_heavy"))
    guidance.reset(1)
    along = np.array(
        [
            math.cos(azimuth) * math.cos(elevation),
            math.sin(azimuth) * math.cos(elevation),
            math.sin(elevation),
        ]
    )
    position, yaw = np.array([1.0, -2.0, 1.5]), azimuth + 0.4
    for _ in range(4000):
        error = (position @ along) * along - position
        turn = np.array(
            [[math.cos(yaw), math.sin(yaw), 0.0], [-math.sin(yaw), math.cos(yaw), 0.0], [0.0, 0.0, 1.0]]
        )
        guidance.yaw_error = np.array([(azimuth - yaw + math.pi) % (2 * math.pi) - math.pi])
        guidance.target, guidance.error = (SPEED * turn @ along)[None], (turn @ error)[None]
        yaw_error, climb = guidance.steer()
        yaw += float(yaw_error[0])
        heading = [
            math.cos(yaw) * math.cos(climb[0]),
            math.sin(yaw) * math.cos(climb[0]),
            math.sin(climb[0]),
        ]
        position = position + DT * (SPEED * np.array(heading) + current)
    return guidance, (position @ along) * along - position


@pytest.mark.parametrize("azimuth", [0.0, 2.5, -1.2])
@pytest.mark.parametrize("bearing", [0.4, -1.1, 2.0])
def test_the_crab_angle_is_learned(azimuth: float, bearing: float) -> None:
    """A current V_c at an angle to a level path is held off by sin(beta) = V_c sin(angle) / U."""
    current = 0.3 * np.array([math.cos(azimuth + bearing), math.sin(azimuth + bearing), 0.0])
    guidance, error = followed(azimuth, 0.0, current)
    assert guidance.crab[0] == pytest.approx(math.asin(0.3 * math.sin(bearing) / SPEED), abs=1e-3)
    assert guidance.attack[0] == pytest.approx(0.0, abs=1e-3)
    np.testing.assert_allclose(error, 0.0, atol=5e-3)


@pytest.mark.parametrize("elevation", [0.0, 0.25, -0.3])
@pytest.mark.parametrize("upwards", [0.12, -0.2])
def test_the_angle_of_attack_is_learned(elevation: float, upwards: float) -> None:
    """Across a rising path the current's part is V_c cos(pi_v): sin(alpha) = -V_c cos(pi_v) / U."""
    guidance, error = followed(0.7, elevation, np.array([0.0, 0.0, upwards]))
    assert guidance.attack[0] == pytest.approx(-math.asin(upwards * math.cos(elevation) / SPEED), abs=1e-3)
    assert guidance.crab[0] == pytest.approx(0.0, abs=1e-3)
    np.testing.assert_allclose(error, 0.0, atol=5e-3)


def test_the_projection_keeps_an_estimate_in_its_band() -> None:
    limit, half = 0.5, math.sqrt((0.5**2 + (0.5 + BEYOND) ** 2) / 2)
    estimate = np.array([0.2, 0.5, half, 0.5 + BEYOND, 0.9, 0.9, -half])
    error = np.array([3.0, 3.0, 3.0, 3.0, 3.0, -3.0, -2.0])
    # All of the error inside, half of it half way through the band, none at its end, all of it inwards.
    expected = [3.0, 3.0, 1.5, 0.0, 0.0, -3.0, -1.0]
    np.testing.assert_allclose(projected(estimate, error, limit), expected, atol=1e-9)
    guidance = Guidance(configs.training(*PATH), sheet.load("bluerov2_heavy"))
    guidance.reset(1)
    for _ in range(5000):
        guidance.learn(np.array([5.0]), np.array([-5.0]), np.array([True]))
    most = guidance.gains.largest_angle
    assert most <= guidance.crab[0] <= most + 2 * BEYOND
    assert -most - 2 * BEYOND <= guidance.attack[0] <= -most
    guidance.learn(np.array([-5.0]), np.array([5.0]), np.array([False]))
    assert guidance.crab[0] >= most, "nothing is learned while the vehicle turns"


def test_a_vehicle_takes_the_crab_angle_in_a_current() -> None:
    """The bow of a simulated vehicle stands against the current as the triangle of velocities asks."""
    speed = 0.25
    straight = ("task.turn=0", "task.climb=0", "task.waypoints=2", "task.spacing=500", "task.speed=0.6")
    water = (f"disturbance.current.speed={speed}", "disturbance.current.direction=0.3")
    config = configs.training(*PATH, *straight, *water, "vehicle=bluerov2_heavy", "noise=none")
    batch = Batch(config, 4, seed=2)
    agent = make(config, batch.vehicle)
    observation = batch.reset()
    agent.reset(np.arange(4))
    for _ in range(1500):
        observation = batch.step(agent.act(observation)).observation
    reference = batch.task.spec["position_error"], batch.task.spec["yaw_error"]
    error, yaw_error = (observation[:, columns] for columns in reference)
    w, z = batch.simulator.pose[:, 3], batch.simulator.pose[:, 6]
    azimuth = 2 * np.arctan2(z, w) + yaw_error[:, 0]
    over_ground = batch.simulator.velocity[:, :2]
    yaw = azimuth - yaw_error[:, 0]
    water_x, water_y = speed * np.cos(0.3 - yaw), speed * np.sin(0.3 - yaw)
    through = np.hypot(over_ground[:, 0] - water_x, over_ground[:, 1] - water_y)
    expected = np.arcsin(speed * np.sin(0.3 - azimuth) / through)
    np.testing.assert_allclose(yaw_error[:, 0], expected, atol=0.03)
    np.testing.assert_allclose(error, 0.0, atol=0.1)
    assert np.abs(expected).max() > 0.2


@pytest.mark.slow
@pytest.mark.parametrize("algo", ["pid", "alos"])
def test_fins_follow_a_path_that_their_turning_radius_allows(algo: str) -> None:
    path = ("task.spacing=60", "task.turn=0.4", "task.speed=0.9", "task.bounds=40", "task.time_limit=600")
    wide = [f"algo.look_ahead{plane}=10" for plane in ("", "_vertical")]
    wide += [f"algo.adaptation{plane}=0.002" for plane in ("", "_vertical")]
    gains = wide if algo == "alos" else []
    config = configs.training("task=path_following", f"algo={algo}", "vehicle=lrauv", *path, *gains)
    agent = make(config, sheet.load(config.vehicle))
    for record in roll_out(config, agent, episodes=np.arange(8), seed=123, batch=8).records:
        assert record["outcome"] == "success"
        assert record["speed_error_m_per_s"] < 0.2


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (
            ["task=waypoint"],
            "algo=alos follows a path, which task=waypoint does not have; use task=path_foll",
        ),
        (["task=docking"], "which task=docking does not have"),
        (
            ["task=path_following", "task.observation=[position_error,yaw_error,velocity]"],
            "has no velocity_error",
        ),
        (
            ["task=path_following", "task.observation=[position_error,yaw_error,velocity_error]"],
            "has no velocity$",
        ),
    ],
)
def test_what_alos_needs_is_named(overrides: list[str], message: str) -> None:
    config = configs.training("algo=alos", "vehicle=bluerov2_heavy", *overrides)
    with pytest.raises(ConfigError, match=message):
        make(config, sheet.load(config.vehicle))
