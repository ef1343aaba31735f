"""Numbers and statements in the text of docs/, computed anew."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from auvbench.agents.base import make
from auvbench.agents.classical.mpc import MPCController
from auvbench.envs.batch import Batch
from auvbench.registry import AGENTS
from auvbench.simulators.fossen import FossenSimulator
from auvbench.tasks import trajectory_tracking as curves
from auvbench.vehicles import sheet
from tests import configs

DOCS = Path(__file__).parents[2] / "docs"


def found(page: str, pattern: str) -> list[str]:
    """Return the groups of the only match in a page, whose line breaks count as spaces."""
    text = re.sub(r"\s+", " ", (DOCS / page).read_text(encoding="utf-8"))
    (match,) = re.finditer(pattern, text)
    return list(match.groups())


def learned(*more: str) -> tuple[float, float]:
    """Return beta and the angle of the bow to the path in rad: bluerov2_heavy on a straight path, across a current."""
    straight = ("task.turn=0", "task.climb=0", "task.waypoints=2", "task.spacing=500", "task.speed=0.6")
    water = ("disturbance.current.speed=0.25", "disturbance.current.direction=0.3", "noise=none")
    path = ("task=path_following", "algo=alos", "vehicle=bluerov2_heavy")
    config = configs.training(*path, *straight, *water, *more)
    batch = Batch(config, 4, seed=2)
    agent = make(config, batch.vehicle)
    observation = batch.reset()
    agent.reset(np.arange(4))
    for _ in range(2000):
        observation = batch.step(agent.act(observation)).observation
    yaw_error = observation[:, batch.task.spec["yaw_error"]][:, 0]
    w, z = batch.simulator.pose[:, 3], batch.simulator.pose[:, 6]
    azimuth = 2.0 * np.arctan2(z, w) + yaw_error
    row = 3  # a current from the side and from behind
    east, north, _ = batch.simulator.velocity[row, :3]
    yaw = azimuth[row] - yaw_error[row]
    through = math.hypot(east - 0.25 * math.cos(0.3 - yaw), north - 0.25 * math.sin(0.3 - yaw))
    return float(agent.estimate.crab[row]), math.asin(0.25 * math.sin(0.3 - azimuth[row]) / through)


@pytest.mark.slow
def test_beta_of_alos_is_the_crab_angle_and_the_error_of_the_heading_loop() -> None:
    beta, crab = map(
        float,
        found("controllers.md", r"in the current: ([\d.]+) instead of ([\d.]+) rad on `bluerov2_heavy`"),
    )
    assert learned() == pytest.approx((beta, crab), abs=5e-3)
    (key,) = found("controllers.md", r"`(algo\.heading_integral_time=\d+)` removes this error")
    assert learned(key) == pytest.approx((crab, crab), abs=5e-3)


def half_widths(curve: str) -> NDArray[np.float64]:
    """Return how far 1,000 curves reach from their centre along east, north and up in an episode, (1000, 3) m."""
    config = configs.training("task=trajectory_tracking", f"task.curve={curve}", "vehicle=bluerov2_heavy")
    batch = Batch(config, 1000)
    batch.reset()
    e = batch.task.episodes
    s = e.rate[:, None] * np.linspace(0.0, config.task.time_limit, 241)
    reach = np.zeros((1000, 3))
    for axis in range(3):
        place = e.slope[:, axis, None] * s
        for j in range(curves.SINES):
            a, w, f = (sines[:, axis, j, None] for sines in (e.amplitude, e.frequency, e.phase))
            place += a * np.sin(w * s + f)
        reach[:, axis] = np.abs(place).max(axis=1)
    return reach


@pytest.mark.slow
def test_curves_are_as_wide_as_the_page_says() -> None:
    size = sorted(map(float, found("task.md", r"Its size a is drawn from (\d) to (\d) m")))
    for curve, share in (("circle", (1.0, 1.0)), ("helix", (1.0, 1.0)), ("lemniscate", (1.0, 0.5))):
        level = half_widths(curve)[:, :2] / share
        np.testing.assert_allclose(
            [level.min(axis=0), level.max(axis=0)], np.transpose([size, size]), atol=0.1
        )
    low, high = map(
        float, found("task.md", r"In 90 % of episodes the sines reach ([\d.]+) to ([\d.]+) m from")
    )
    assert np.percentile(half_widths("random")[:, 0], [5, 95]) == pytest.approx([low, high], abs=0.1)


@pytest.mark.slow
def test_mpc_knows_depth_limits_in_waypoint_and_transit_only() -> None:
    assert found("controllers.md", r"in `waypoint` and `transit` the depth limits are (soft constraints)")
    for task in (
        "waypoint",
        "transit_solids",
        "station_keeping",
        "trajectory_tracking",
        "path_following",
        "docking",
    ):
        config = configs.training(f"task={task}", "algo=mpc", "vehicle=bluerov2_heavy")
        room = MPCController(config, sheet.load("bluerov2_heavy")).room
        assert np.isfinite(room).all() == (task in ("waypoint", "transit_solids")), task


def test_the_page_names_each_kind_of_learner_that_cannot_be_exported() -> None:
    (refused,) = found("policies-as-files.md", r"\| refused \| (.*?) \|")
    kept = {name for name, spec in AGENTS.items() if spec.learns and not spec.exportable}
    assert kept == {"recurrent_ppo", "ppo_residual", "sac_residual", "pets"}
    for kind in ("recurrent policies", "residual policies", "PETS", "controllers"):
        assert kind in refused


@pytest.mark.slow
@pytest.mark.parametrize("vehicle", ["bluerov2_realistic_inertia", "rexrov", "bluerov2"])
def test_steps_of_the_integrator_are_as_accurate_as_the_page_says(vehicle: str) -> None:
    pattern = (
        rf"at most (\S+) m after 60 s \({vehicle};"
        if "realistic" in vehicle
        else rf"\b{vehicle}: (\S+) m[,;]"
    )
    (stated,) = found("physics.md", pattern)
    model, largest = sheet.load(vehicle), 0.0
    for seed in range(3):
        coarse, fine = FossenSimulator(model, 32), FossenSimulator(model, 32, max_step=0.001)
        rng = np.random.default_rng(seed)
        for _ in range(600):
            command = rng.uniform(-1.0, 1.0, (32, len(model.actuators)))
            coarse.step(command, 0.1)
            fine.step(command, 0.1)
        largest = max(largest, float(np.linalg.norm(coarse.pose[:, :3] - fine.pose[:, :3], axis=1).max()))
    assert largest == pytest.approx(float(stated), rel=0.02)
