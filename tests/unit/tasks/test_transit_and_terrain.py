"""Transit and terrain following, against their definitions in docs/transit.md, and the controllers that steer by range sensors."""

from __future__ import annotations

import hashlib
import math
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from auvbench.agents.base import make
from auvbench.agents.classical.ranging import FreeWayGuidance, rays_of
from auvbench.cli import main
from auvbench.config.compose import compose
from auvbench.config.ranges import key_of
from auvbench.envs.batch import Batch
from auvbench.envs.settings import configuration
from auvbench.errors import ConfigError
from auvbench.evaluation.protocol import resolve_conditions
from auvbench.evaluation.rollout import batch_of, roll_out
from auvbench.record import record_columns
from auvbench.vehicles import sheet
from tests import configs
from tests.reference import solids as oracle

Floats = NDArray[np.float64]
VEHICLE = "vehicle=bluerov2_2026"
FROZEN = {
    ("transit", "density=0.01"): "21dfb8317159",
    ("transit", "density=0.02"): "3668651945f8",
    ("transit", "density=0.03"): "7c39b9787b1c",
    ("transit", "current=0.25"): "3668651945f8",
    ("transit", "sonar-loss"): "3668651945f8",
    ("terrain", "nominal"): "037c8d889ecc",
    ("terrain", "height=1.5"): "b68060988683",
    ("terrain", "current=0.25"): "037c8d889ecc",
    ("terrain", "sounder-loss"): "037c8d889ecc",
}
"""digests of the names of the worlds of each condition"""


def batch(task: str, *words: str, n: int = 8, **own: Any) -> Batch:
    return Batch(
        configuration(overrides=[f"task={task}", VEHICLE, "algo=pid", "noise=none", *words]), n, **own
    )


def altitude(one: Batch, i: int, place: Floats) -> float:
    """Return the height of a place (3,) over the bottom of episode i in m, by another way than the task."""
    world: Any = one.task.world
    point = oracle.own_axes(world.solids[i, 0], place[None])
    grid, spacing = world.world.grid, world.settings.spacing
    return float(point[0, 2] - oracle.height(grid, spacing, np.zeros(3), point)[0])


# --- Transit ---------------------------------------------------------------------------------------------------------------------------


def test_the_goal_of_transit_is_as_far_as_asked() -> None:
    one = batch("transit", "world=tank", "world.length=90", "world.width=90", n=300)
    one.reset()
    way = one.task.reference - one.task.episodes.start
    distance = np.linalg.norm(way, axis=1)
    assert 25.0 <= distance.min() < 25.2
    assert 34.8 < distance.max() <= 35.0
    assert np.abs(way[:, 2]).max() == pytest.approx(3.0, abs=0.1)
    bearing = np.arctan2(way[:, 1], way[:, 0])
    assert np.abs(np.exp(1j * bearing).mean()) < 0.15
    assert np.abs(np.exp(1j * one.task.episodes.start_yaw).mean()) < 0.15


def test_transit_ends_within_the_radius_of_the_goal_and_has_the_score_of_barn() -> None:
    one = batch("transit", n=2)
    one.reset()
    e, still = one.task.episodes, np.zeros_like(one._action)
    best = float(e[0].initial_distance) * float(e[0].way_ratio)
    for seconds, score in ((1.5 * best, 0.5), (4.0 * best, 0.25), (20.0 * best, 0.125)):
        e.steps[0] = round(seconds / 0.1)
        one.simulator.pose[0, :3] = one.task.reference[0] - [0.9, 0.0, 0.0]
        one.task.advance(one.simulator.pose, one.simulator.velocity, still, still, np.zeros(2))
        assert one.task.outcome[0] == 0 if seconds < 120.0 else True
        e.outcome[0] = 0
        assert one.task.own_metrics(0)["barn_score"] == pytest.approx(score, rel=0.01)
    e.outcome[0] = 1
    assert one.task.own_metrics(0)["barn_score"] == 0.0
    assert {"barn_score", "goal_x_m", "way_ratio"} <= {*record_columns("transit", "field")}


# --- Terrain ----------------------------------------------------------------------------------------------------------------------------


def test_the_altitude_error_is_that_over_the_bottom() -> None:
    one = batch("terrain", "task.settling=1", "task.time_limit=4", n=4)
    one.reset()
    solids = one.task.world.solids.copy()  # type: ignore[union-attr]
    errors: list[list[float]] = [[] for _ in range(4)]
    for step in range(1, 41):
        result = one.step(np.full_like(one._action, 0.1))
        poses = result.final_state.pose if len(result.ended) else one.simulator.pose
        if len(result.ended):
            one.task.world.solids[:] = solids  # type: ignore[union-attr]  # before the automatic reset
        for i in range(4):
            if step > 10:
                errors[i].append(altitude(one, i, poses[i, :3]) - 2.0)
    assert len(result.records) == 4
    for i, record in enumerate(result.records):
        assert record["altitude_error_rms_m"] == pytest.approx(
            math.sqrt(np.mean(np.square(errors[i]))), abs=1e-6
        )
        assert record["outcome"] == ("success" if record["altitude_error_rms_m"] <= 0.5 else "timeout")


def test_only_the_echo_sounder_tells_of_the_altitude() -> None:
    seen = []
    for height in (0.5, 1.0):
        one = batch("terrain", f"world.height={height}", seed=3)
        one.reset()
        for _ in range(5):
            observation = one.step(np.full_like(one._action, 0.2)).observation.copy()
        sounder = one.task.spec["range.ping1d"]
        seen.append(np.delete(observation, np.r_[sounder], axis=1))
        assert (observation[:, one.task.spec["position_error"]][:, 2] == 0.0).all()
    np.testing.assert_array_equal(*seen)


def test_the_reference_of_terrain_moves_along_its_line() -> None:
    one = batch("terrain")
    one.reset()
    for _ in range(20):
        one.step(np.zeros_like(one._action))
    e = one.task.episodes
    way = np.array(e.reference - e.start)
    np.testing.assert_allclose(np.hypot(way[:, 0], way[:, 1]), 0.5 * 2.0, rtol=1e-9)
    np.testing.assert_allclose(np.arctan2(way[:, 1], way[:, 0]), e.reference_yaw, atol=1e-9)
    np.testing.assert_array_equal(e.reference[:, 2], one.simulator.pose[:, 2])
    np.testing.assert_allclose(one.task.goal(0) - e.start[0], 30.0 * way[0] / 1.0 * [1, 1, 0], atol=1e-6)


def test_a_vehicle_too_high_or_on_the_bottom_fails_with_the_bounds_as_its_error() -> None:
    for words, outcome in ((["task.bounds=1.0"], "out_of_bounds"), (["task.settling=0.5"], "collision")):
        one = batch("terrain", *words, n=2)
        one.reset()
        down = np.tile(-np.sign(one.vehicle.allocation[2]), (2, 1))
        for _ in range(400):
            if records := one.step(down).records:
                break
        assert records[0]["outcome"] == outcome
        bounds = 1.0 if outcome == "out_of_bounds" else 10.0
        assert records[0]["altitude_error_rms_m"] == bounds


def test_terrain_and_transit_reject_what_cannot_be_done(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for words, message in (
        (
            ["task=terrain", "world=open"],
            "task=terrain: needs a bottom, and world=open has none; use world=rough",
        ),
        (["task=terrain", "world=pillars"], "task=terrain: needs a bottom, and world=pillars has none"),
        (["task=terrain", "task.settling=70"], "task.settling=70: must be less than the 60 s"),
        (["task=transit", "world=open"], "range.multibeam has nothing to measure in world=open"),
        (["task=transit", "task.rise=30"], "task.rise=30: must be at most 19"),
        (
            ["task=transit", "task.distance_low=40"],
            "task.distance_low=40: must be at most task.distance_high=35",
        ),
        (
            ["task=transit", "task.distance_low=0.5"],
            "task.distance_low=0.5: must be more than task.goal_radius=1",
        ),
    ):
        with pytest.raises(ConfigError, match=message):
            configuration(overrides=[*words, "algo=pid"])
    assert main(["train", "task=terrain", "world=open", "algo=pid", f"output={tmp_path}"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


# --- Protocols ----------------------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_worlds_of_the_protocols_are_frozen() -> None:
    digests = {}
    for task in ("transit", "terrain"):
        protocol = configs.protocol(f"protocol={task}")
        plain = configs.plain(f"task={task}", VEHICLE, "algo=pid")
        for condition in resolve_conditions(protocol, plain):
            one = batch_of("test", condition.config, np.arange(protocol.episodes), protocol.seed)
            one.reset()
            world: Any = one.task.world
            names = [world.name(i, int(one.task.episodes[i].solids)) for i in range(protocol.episodes)]
            digests[task, condition.name] = hashlib.sha256(" ".join(names).encode()).hexdigest()[:12]
    assert digests == FROZEN


# --- Controllers --------------------------------------------------------------------------------------------------------------------------


def flown(task: str, algo: str, *words: str, episodes: int = 60) -> list[Any]:
    config = configuration(overrides=[f"task={task}", f"algo={algo}", VEHICLE, *words])
    agent = make(config, sheet.load(config.vehicle))
    return roll_out(config, agent, episodes=np.arange(episodes), seed=123, batch=episodes).records


@pytest.mark.slow
def test_pid_holds_the_altitude_by_its_echo_sounder() -> None:
    records = flown("terrain", "pid")
    assert Counter(record["outcome"] for record in records)["success"] >= 58
    assert np.mean([record["altitude_error_rms_m"] for record in records]) < 0.12


@pytest.mark.slow
def test_pid_steers_through_a_field_by_its_sonar() -> None:
    assert Counter(record["outcome"] for record in flown("transit", "pid"))["success"] >= 54


@pytest.mark.parametrize("key", ["multibeam", "ideal", "ping360"])
def test_the_directions_of_a_sonar_are_those_that_it_measures(key: str) -> None:
    """A wall due port, ahead or to starboard of the vehicle is nearest in that direction."""
    one = Batch(
        configuration(overrides=[
            "task=transit", VEHICLE, "algo=pid", "world=tank", "world.length=8", "world.width=200", "task.start=[0,0,-20]",
            f"task.observation=[position_error,yaw_error,velocity,range.{key}]", "task.range.ideal.horizontal=2.4",
            "task.range.ping360.step=10", "task.range.ping360.high=10", "task.rise=0", "task.distance_low=2", "task.distance_high=3",
        ]), 6, seed=2)  # fmt: skip
    observation = one.reset()
    for _ in range(60):
        one.simulator.pose[:, :3], one.simulator.velocity[:] = [0.0, 0.0, -20.0], 0.0
        observation = one.step(np.zeros_like(one._action)).observation
    azimuths, columns = rays_of(key, getattr(one.config.task.range, key_of(f"range.{key}")))
    close = observation[:, one.task.spec[f"range.{key}"]][:, columns]
    from auvbench.dynamics.frames import yaw

    for i, heading in enumerate(yaw(one.simulator.pose[:, 3:])):
        away = [
            abs(math.remainder(heading + a - wall, 2.0 * math.pi))
            for a in azimuths
            for wall in (0.0, math.pi)
        ]
        nearest = np.array(away).reshape(-1, 2).min(axis=1)
        if nearest.min() < 0.1:
            assert nearest[np.argmax(close[i])] < 0.2


def test_a_way_is_free_where_no_echo_is_within_the_width_of_the_vehicle() -> None:
    config = configuration(overrides=["task=transit", VEHICLE, "algo=pid"])
    guidance: Any = make(config, sheet.load(config.vehicle)).ranging  # type: ignore[attr-defined]
    assert isinstance(guidance, FreeWayGuidance)
    guidance.reset(1)
    size = guidance.columns[-1] + 2
    open_water = np.zeros((1, size))
    goal, wanted, still = np.array([[20.0, 0.0, 0.0]]), np.array([[1.0, 0.0, 0.0]]), np.zeros((1, 3))
    velocity, turn = guidance.steer(open_water, goal, wanted, still, np.zeros(1))
    assert abs(turn[0]) < 1e-9
    assert velocity[0] == pytest.approx([0.6, 0.0, 0.0])
    # A disc of 1 m radius 4 m ahead, a little to port: the way leads past its starboard side.
    seen = open_water.copy()
    azimuths, _ = rays_of("multibeam", config.task.range.multibeam)
    for azimuth, column in zip(azimuths, guidance.columns, strict=True):
        aside = abs(math.sin(azimuth - 0.02)) * 4.0
        if aside < 1.0:
            seen[0, column] = 1.0 - (4.0 * math.cos(azimuth - 0.02) - math.sqrt(1.0 - aside**2)) / 30.0
    velocity, turn = guidance.steer(seen, goal, wanted, still, np.zeros(1))
    clear = math.asin((1.0 + sheet.load(config.vehicle).hull[0]) / 4.0)
    assert -1.2 < turn[0] < -clear
    # It remembers the disc when the sonar no longer shows it.
    for _ in range(guidance.every):
        _, turn = guidance.steer(seen, goal, wanted, still, np.zeros(1))
    _, turned = guidance.steer(open_water, goal, wanted, still, np.zeros(1))
    assert turned[0] == turn[0]
    assert compose("train", ["task=transit"]).world.name == "field"
