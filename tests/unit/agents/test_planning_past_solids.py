"""The block `solids`, and what clearances cost in the plans of MPPI and MPC."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from auvbench.agents.base import make
from auvbench.agents.classical.avoiding import NEARNESS, Avoidance, price
from auvbench.cli import main
from auvbench.dynamics import frames
from auvbench.envs.batch import Batch
from auvbench.envs.settings import configuration
from auvbench.errors import ConfigError
from auvbench.evaluation.rollout import batch_of, roll_out
from auvbench.tasks.ranges.specs import MOST, NUMBERS, SIGHT
from auvbench.vehicles import sheet
from auvbench.worlds.kinds import PLANE
from auvbench.worlds.solids import SOLID, box, capsule, cylinder, plane, sphere
from tests.reference import solids as oracle

Floats = NDArray[np.float64]
SEED = 5


def batch(*words: str, n: int = 4, **own: Any) -> Batch:
    chosen = ["task=transit_solids", "vehicle=bluerov2_2026", "algo=pid", "noise=none"]
    return Batch(configuration(overrides=[*chosen, *words]), n, seed=SEED, **own)


def shown(one: Batch, seen: Any, i: int) -> Any:
    """Return the solids (k,) of SOLID that environment i shows, at its true pose."""
    config = configuration(overrides=["task=transit_solids", "vehicle=bluerov2_2026", "algo=pid"])
    avoidance = Avoidance(config, one.vehicle, one.task.spec["solids"])
    pose = one.simulator.pose[i]
    reading = seen[i].astype(np.float64)
    return avoidance.solids(reading, pose[:3], float(frames.yaw(pose[3:]))).view(SOLID)[:, 0]


def distances(solids: Any, points: Floats) -> Floats:
    """Return the signed distances (k, n) in m of points (n, 3) from solids (k,), by other formulas."""
    rows = [
        (points - s["position"]) @ s["along_z"] if s["kind"] == PLANE else oracle.signed_distance(s, points)
        for s in solids
    ]
    return np.array(rows).reshape(len(solids), len(points))


# --- The block -------------------------------------------------------------------------------------------------------------------


def test_the_nearest_solids_are_shown_as_they_are_the_nearest_first() -> None:
    one = batch("world.density=0.06", "world.gap=0.5")
    seen = one.reset()
    for step in range(41):
        if step % 20 == 0:
            for i in range(one.n):
                assert one.task.world is not None
                own, place = shown(one, seen, i), one.simulator.pose[i : i + 1, :3]
                true = one.task.world.solids[i, : one.task.episodes[i].solids]
                away = distances(true, place)[:, 0]
                nearest = np.argsort(away)[:MOST]
                nearest = nearest[away[nearest] < SIGHT]
                assert len(own) == len(nearest) > 2
                near = place + np.random.default_rng(step).uniform(-3.0, 3.0, (50, 3))
                np.testing.assert_allclose(distances(own, near), distances(true[nearest], near), atol=1e-4)
                np.testing.assert_array_equal(own["kind"], true[nearest]["kind"])
                assert (own["reach"] > true[nearest]["reach"] * (1.0 - 1e-6)).all()
        command = np.tile([0.5, -0.3, 0.2, 0.4, 0.3, -0.5], (one.n, 1))
        seen = one.step(command).observation


def test_walls_and_bottoms_are_planes_that_touch_them() -> None:
    near = ("task.start=[9,9,-20]", "task.distance_low=1.5", "task.distance_high=2", "task.rise=0.5")
    walls = ("world.length=24", "world.width=24", "world.depth=26")
    for words, count in ((("world=tank", *walls), 3), (("world=rough", "world.altitude=2"), 1)):
        one = batch(*words, *near)
        seen = one.reset()
        for i in range(one.n):
            assert one.task.world is not None
            own, place = shown(one, seen, i), one.simulator.pose[i : i + 1, :3]
            assert (own["kind"] == PLANE).all()
            assert len(own) == count
            true = one.task.world._distances(i, int(one.task.episodes[i].solids), place)
            assert distances(own, place)[0, 0] == pytest.approx(float(true[0]), abs=1e-4)


# --- The price -------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [1, 3])
def test_the_price_is_that_of_the_formula(count: int) -> None:
    rng = np.random.default_rng(3)
    scene = np.concatenate(
        [
            sphere([1.0, 0.0, 0.0], 0.5),
            capsule([-2.0, 1.0, 0.0], [0.0, 0.3, 1.0], 2.0, 0.4),
            cylinder([0.0, 2.0, 1.0], [0.0, 0.0, 1.0], 3.0, 0.7),
            box([0.0, -2.0, 0.0], [1.0, 2.0, 1.5]),
            plane([0.0, 0.0, -2.0], [0.0, 0.1, 1.0]),
        ]
    )
    pose = rng.uniform(-2.5, 2.5, (400, 7))
    pose[:, 3:] /= np.linalg.norm(pose[:, 3:], axis=1, keepdims=True)
    config = configuration(overrides=["task=transit_solids", "vehicle=bluerov2_2026", "algo=pid"])
    avoidance = Avoidance(config, sheet.load(config.vehicle), slice(0, MOST * NUMBERS))
    radius, clearance, weight, contact = 0.2, 0.6, 7.0, 50.0
    hull = avoidance.hull.view([(name, "f8") for name in ("radius", "first", "spacing", "count", "near")])
    hull["radius"], hull["first"], hull["spacing"] = radius, -0.4 * (count > 1), 0.4
    avoidance.hull.view(np.int64)[3] = count
    prices = np.zeros(1, NEARNESS)
    prices["clearance"], prices["weight"], prices["contact"] = clearance, weight, contact
    cost = np.ones(len(pose))
    floats = scene.view(np.float64).reshape(len(scene), -1)
    price(pose, floats, avoidance.hull, prices.view(np.float64), cost)
    turns = Rotation.from_quat(pose[:, [4, 5, 6, 3]])
    offsets = [0.0] if count == 1 else [-0.4, 0.0, 0.4]
    centres = [pose[:, :3] + turns.apply([x, 0.0, 0.0]) for x in offsets]
    free = np.min([distances(scene, c).min(0) - radius for c in centres], axis=0)
    expected = 1.0 + weight * np.maximum(clearance - free, 0.0) + contact * (free < 0.0)
    np.testing.assert_allclose(cost, expected, rtol=1e-12)
    assert 20 < (free < 0.0).sum() < 380
    assert (free > clearance).sum() > 20
    room, away = avoidance.clearances(floats, pose, 20.0)
    np.testing.assert_allclose(room.min(axis=0), free, atol=1e-12)
    moved = pose.copy()
    moved[:, :3] += 1e-6 * away[0]
    further, _ = avoidance.clearances(floats, moved, 20.0)
    np.testing.assert_allclose((further - room)[0] / 1e-6, 1.0, atol=1e-3)


def test_a_way_leads_round_what_is_shown_at_the_given_lengths() -> None:
    config = configuration(overrides=["task=transit_solids", "vehicle=bluerov2_2026", "algo=pid"])
    avoidance = Avoidance(config, sheet.load(config.vehicle), slice(0, MOST * NUMBERS))
    start, goal, lengths = (
        np.array([1.0, 0.0, -5.0]),
        np.array([11.0, 0.0, -6.0]),
        np.linspace(0.1, 20.0, 200),
    )
    wall = box([6.0, 0.0, -5.0], [1.0, 5.0, 8.0])
    way = avoidance.way(wall.view(np.float64).reshape(1, -1), start, goal, lengths)
    radius = float(avoidance.hull[0])
    assert distances(wall, way).min() > radius
    assert way[-1] == pytest.approx(goal)
    steps = np.linalg.norm(np.diff(way, axis=0), axis=1)
    assert steps.max() == pytest.approx(0.1)
    assert 11.0 < steps.sum() < 13.5
    shut = plane([6.0, 0.0, 0.0], [-1.0, 0.0, 0.0])
    straight = avoidance.way(shut.view(np.float64).reshape(1, -1), start, goal, lengths)
    np.testing.assert_allclose(straight[:, 1], 0.0)


# --- MPPI and MPC ------------------------------------------------------------------------------------------------------------------------


def planner(algo: str, *words: str) -> Any:
    pytest.importorskip("casadi")
    chosen = ["task=transit_solids", "vehicle=bluerov2_2026", f"algo={algo}"]
    chosen += ["algo.samples=64"] if algo == "mppi" else []
    config = configuration(overrides=[*chosen, *words])
    return config, make(config, sheet.load(config.vehicle))


@pytest.mark.parametrize("algo", ["mppi", "mpc"])
def test_it_brakes_for_a_wall_that_it_is_shown(algo: str) -> None:
    """The goal is behind a wall: without the block the plan leads through it."""
    config, agent = planner(algo, "noise=none")
    ahead = batch_of("validation", config, np.arange(1), SEED)
    reading = ahead.reset().copy()
    spec = ahead.task.spec
    reading[0, spec["position_error"]] = 3.0, 0.0, 0.0
    reading[0, spec["yaw_error"]] = 0.0
    commands = []
    for wall in (False, True):
        reading[0, spec["solids"]] = 0.0
        if wall:
            first = np.zeros(NUMBERS)
            first[[0, 1, 4]] = 1.0 + PLANE, 0.6, -1.0
            reading[0, spec["solids"].start : spec["solids"].start + NUMBERS] = first
        agent.reset(np.arange(1))
        agent.act(reading)
        thrusts = agent.plans[0] if algo == "mppi" else agent.plans[0].U.T
        plan = thrusts @ agent.vehicle.allocation[0]
        commands.append(float(plan[:6].mean()))
    free, braked = commands
    assert free > 10.0
    assert braked < 0.5 * free


@pytest.mark.slow
@pytest.mark.parametrize("algo", ["mppi", "mpc"])
def test_it_passes_fields_by_which_straight_ways_collide(algo: str) -> None:
    samples = ["algo.samples=128"] if algo == "mppi" else []
    config, agent = planner(algo, "world.density=0.03", *samples)
    records = roll_out(
        config, agent, episodes=np.arange(4), seed=SEED, batch=4, scenarios="validation"
    ).records
    assert [record["outcome"] for record in records] == ["success"] * 4
    assert min(record["clearance_min_m"] for record in records) > 0.0
    assert sum(record["way_ratio"] > 1.02 for record in records) > 0


def test_without_the_block_it_knows_no_solid() -> None:
    for algo in ("mppi", "mpc"):
        _, agent = planner(algo, "task=transit_map")
        assert agent.avoidance is None


@pytest.mark.parametrize("algo", ["mppi", "mpc"])
@pytest.mark.parametrize(("task", "sensor"), [("transit", "range.multibeam"), ("terrain", "range.ping1d")])
def test_a_planner_refuses_a_task_whose_solids_only_a_sensor_shows(algo: str, task: str, sensor: str) -> None:
    with pytest.raises(ConfigError, match=f"algo={algo}: does not read {sensor} of task={task}"):
        planner(algo, f"task={task}")


def test_open_water_has_nothing_to_show(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["train", "task=transit_solids", "world=open", "algo=pid", f"output={tmp_path}"]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "solids has nothing to measure in world=open" in line
    assert math.isfinite(SIGHT)
