"""Agents that avoid obstacles: along the shortest way on a known map, and by a potential field on a sonar (docs/transit.md)."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from auvbench.agents.base import make
from auvbench.agents.classical.potential import PotentialGuidance
from auvbench.blocks import LOOK_AHEAD
from auvbench.cli import main
from auvbench.dynamics import frames
from auvbench.envs.settings import configuration
from auvbench.errors import ConfigError
from auvbench.evaluation.rollout import batch_of, roll_out
from auvbench.vehicles import sheet
from auvbench.worlds.routes import CORNERS, MARGIN, route
from auvbench.worlds.solids import NO_HEIGHTS, box, sphere
from tests.reference import solids as oracle

Floats = NDArray[np.float64]
SEED = 123
"""of protocol=transit"""


def typed(*words: str) -> Any:
    return configuration(overrides=[*words, "vehicle=bluerov2_2026"])


def controller(*words: str) -> Any:
    config = typed(*words)
    return make(config, sheet.load(config.vehicle))


def along(corners: Floats) -> Floats:
    """Return points (k, 3) of a line through corners, 5 cm apart."""
    parts = [
        a + np.linspace(0.0, 1.0, 2 + int(np.linalg.norm(b - a) / 0.05))[:, None] * (b - a)
        for a, b in pairwise(corners)
    ]
    return np.concatenate(parts)


def clearance(solids: Any, points: Floats) -> float:
    return min(float(oracle.signed_distance(solid, points).min()) for solid in solids)


# --- The way ------------------------------------------------------------------------------------------------------------------------------


def test_a_way_leads_round_a_wall_with_room_for_the_vehicle() -> None:
    # A wall across the line from start to goal that ends 3 m to port, in an arena that is turned by 90 degrees.
    wall = box([2.0, 10.0, 0.0], [10.0, 1.0, 40.0])
    solids = np.concatenate([wall, sphere([-6.0, 15.0, 0.0], 1.0)])
    out = np.zeros((CORNERS, 3))
    count = route(solids, NO_HEIGHTS, (0.0, 0.0, -1.0), (0.0, 20.0, 1.0), 0.3, 8.0, out)
    way = out[:count]
    np.testing.assert_array_equal(way[[0, -1]], [[0.0, 0.0, -1.0], [0.0, 20.0, 1.0]])
    assert clearance(solids, along(way)) >= 0.3 + MARGIN
    assert (np.diff(way[:, 2]) > 0.0).all()
    # At least round the two corners of the wall; at most round them with the room and a cell.
    length = float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())
    assert 2.0 * math.hypot(3.0, 9.5) + 1.0 < length < 2.0 * math.hypot(4.5, 9.5) + 2.0
    assert count <= 5
    closed = box([0.0, 10.0, 0.0], [40.0, 1.0, 40.0])
    assert route(closed, NO_HEIGHTS, (0.0, 0.0, 0.0), (0.0, 20.0, 0.0), 0.3, 8.0, out) == 0


def test_the_observation_has_the_point_of_the_way_ahead_and_the_scenario_stays() -> None:
    config = typed("task=transit_map", "algo=pid", "noise=none")
    one = batch_of("test", config, np.arange(4), SEED)
    seen = one.reset()[:, one.task.spec["way"]]
    for i in range(4):
        e = one.task.episodes[i]
        way = along(np.array(e.way[: e.way_corners]))
        assert clearance(one.task.world.solids[i, : e.solids], way) > one.task.world.radius  # type: ignore[union-attr]
        yaw = float(frames.yaw(one.simulator.pose[i : i + 1, 3:])[0])
        c, s = math.cos(yaw), math.sin(yaw)
        x, y, z = seen[i]
        point = e.start + np.array([c * x - s * y, s * x + c * y, z])
        passed = np.linalg.norm(np.diff(way, axis=0), axis=1).cumsum()
        assert np.linalg.norm(point - way[1 + np.searchsorted(passed, LOOK_AHEAD)]) < 0.06
    blind = typed("task=transit", "algo=pid", "noise=none", "task.observation=[position_error,yaw_error]")
    other = batch_of("test", blind, np.arange(4), SEED)
    other.reset()
    np.testing.assert_array_equal(other.task.scenario(), one.task.scenario())
    world: Any = one.task.world
    world.radius = 5.0
    with pytest.raises(ConfigError, match="way: no way for a vehicle of 5 m radius leads from the start"):
        world.draw(one.task, np.arange(1))


@pytest.mark.slow
@pytest.mark.parametrize("algo", ["pid", "lqr"])
def test_a_controller_follows_the_way_through_dense_fields(algo: str) -> None:
    config = typed("task=transit_map", f"algo={algo}", "world.density=0.03")
    agent = make(config, sheet.load(config.vehicle))
    records = roll_out(config, agent, episodes=np.arange(20), seed=SEED, batch=20).records
    assert [record["outcome"] for record in records].count("success") >= 19
    assert np.mean([record["duration_s"] for record in records]) < 40.0


# --- The potential field --------------------------------------------------------------------------------------------------------------------


def test_the_nearest_echo_of_each_sector_repels_as_in_the_source() -> None:
    guidance = controller("task=transit", "algo=apf", "algo.influence=2", "algo.repulsion=0.3").ranging
    assert isinstance(guidance, PotentialGuidance)
    rho = 1.0
    near = guidance.hull + rho
    # Two echoes ahead, of which the farther one adds nothing, one out of reach, and in the second row one to port.
    echoes = np.array([[[near, 0.1], [near + 0.3, 0.1], [-9.0, 0.0]], [[0.1, near], [9.0, 9.0], [9.0, -9.0]]])
    force = guidance.repelled(echoes)
    away = math.hypot(near, 0.1)
    rho = away - guidance.hull
    size = 0.3 * (1.0 / rho - 0.5) / rho**2
    np.testing.assert_allclose(force[0], -size * echoes[0, 0] / away, rtol=1e-12)
    np.testing.assert_allclose(force[1], -size * echoes[1, 0] / away, rtol=1e-12)


@pytest.mark.slow
def test_the_potential_field_passes_most_fields() -> None:
    config = typed("task=transit", "algo=apf")
    agent = make(config, sheet.load(config.vehicle))
    records = roll_out(config, agent, episodes=np.arange(20), seed=SEED, batch=20).records
    outcomes = [record["outcome"] for record in records]
    assert outcomes.count("success") >= 14
    assert outcomes.count("collision") <= 3


# --- The heading --------------------------------------------------------------------------------------------------------------------------


def test_the_heading_withstands_the_current_where_a_guidance_turns_the_bow() -> None:
    """A vehicle at rest, 45 degrees across a current of 0.25 m/s, is turned by (Y_v' - X_u') u v."""
    steered, free = controller("task=transit", "algo=pid"), controller("task=waypoint_state", "algo=pid")
    vehicle = steered.vehicle
    moment = float(vehicle.M_A[1, 1] - vehicle.M_A[0, 0]) * 0.5 * 0.25**2
    off = [
        moment / (one.turning_mass(2.0 * one.heading_bandwidth) * one.heading_bandwidth**2)
        for one in (steered, free)
    ]
    assert off[0] < math.radians(10.0) < math.radians(30.0) < off[1]


# --- Bad input ----------------------------------------------------------------------------------------------------------------------------


def test_agents_that_cannot_avoid_here_say_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for words, message in (
        (["task=transit_map", "world=open"], "way has nothing to measure in world=open; use world=field or"),
        (["task=waypoint", "task.observation=[way]"], "way is not a block of task=waypoint"),
        (["task=transit_map", "algo=apf"], "algo=apf: needs a sonar that looks ahead"),
        (["task=station_keeping", "algo=apf"], "algo=apf: steers to a point"),
        (["task=transit", "algo=apf", "algo.influence=0"], "algo.influence"),
    ):
        with pytest.raises(ConfigError, match=message):
            controller(*words)
    assert main(["train", "task=transit_map", "world=open", "algo=pid", f"output={tmp_path}"]) == 2
    assert capsys.readouterr().err.count("\n") == 1
