"""Worlds: what is in the water of an episode, and how the vehicle meets it."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from omegaconf import OmegaConf

from auvbench.cli import main
from auvbench.config.compose import compose, typed
from auvbench.config.validate import train_config
from auvbench.envs.batch import Batch
from auvbench.envs.info import numbers
from auvbench.envs.settings import configuration
from auvbench.envs.vector_env import AuvVectorEnv
from auvbench.errors import ConfigError, VehicleError
from auvbench.metrics import SOLID
from auvbench.record import record_columns
from auvbench.registry import TASKS, WORLDS
from auvbench.runs import identity
from auvbench.tasks.worlds.rough import fractal
from auvbench.vehicles import sheet
from auvbench.worlds.casting import clearance
from auvbench.worlds.kinds import KINDS, PLANE
from auvbench.worlds.passage import CELL, scatter, shortest_way
from tests.reference import solids as oracle

Floats = NDArray[np.float64]
RADIUS = 0.3
TOLD = ("world", "hit", "clearance_min_m", "near_time_s")


def batch(world: str, *words: str, n: int = 4, task: str = "docking", **streams: Any) -> Batch:
    chosen = [f"world={world}", f"task={task}", "vehicle=bluerov2_heavy", "algo=pid"]
    radius = [] if world == "open" else [f"world.vehicle_radius={RADIUS}"]
    return Batch(configuration(overrides=[*chosen, *radius, *words]), n, **streams)


def actions(batch: Batch, seed: int = 0) -> Floats:
    """Return constant commands (n, n_u) that push the vehicles in different directions."""
    return np.asarray(np.random.default_rng(seed).uniform(-1.0, 1.0, batch._action.shape))


def solids_of(batch: Batch, i: int) -> Any:
    assert batch.task.world is not None
    return batch.task.world.solids[i, : batch.task.episodes[i].solids]


def bits(batch: Batch) -> dict[str, bytes]:
    return {name: array.tobytes() for name, array in batch.state_dict().items()}


# --- Contact --------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("world", "speed"), [("tank", 0.0), ("slope", 0.0), ("pillars", 0.0), ("field", 0.0), ("field", 0.5)]
)
def test_clearance_is_the_distance_from_the_nearest_solid_and_contact_ends_the_episode(
    world: str, speed: float
) -> None:
    words = [f"world.moving={speed > 0.0:d}", f"world.speed={speed}"] if speed else []
    words += ["world.length=17", "world.width=17"] if world == "tank" else []
    words += ["world.altitude=1", "world.dip=0.5"] if world == "slope" else []
    words += ["world.density=0.05", "world.free=0.5"] if world == "field" else []
    task = batch(world, *words, "task.start_high=8", "task.bounds=60", "world.near=0.8", n=32)
    task.reset()
    scenes = {i: np.array(solids_of(task, i)) for i in range(task.n)}
    paths: dict[int, list[Floats]] = {i: [np.array(task.simulator.pose[i, :3])] for i in scenes}
    records: dict[int, Mapping[str, Any]] = {}
    command = actions(task)
    for _ in range(400):
        result = task.step(command)
        for i in scenes.keys() - records.keys() - set(result.ended.tolist()):
            paths[i].append(np.array(task.simulator.pose[i, :3]))
        for k, i in enumerate(result.ended.tolist()):
            if i not in records:
                records[i] = result.records[k]
                paths[i].append(result.final_state.pose[k, :3])
    assert any(record["hit"] for record in records.values())
    for i, record in records.items():
        time = task.task.duration * np.arange(len(paths[i]))[:, None]
        assert np.linalg.norm(scenes[i]["velocity"], axis=1) == pytest.approx(speed)
        room = [
            oracle.signed_distance(solid, np.array(paths[i]) - time * solid["velocity"]) - RADIUS
            for solid in scenes[i]
        ]
        clearance = np.min(room, axis=0)
        assert record["clearance_min_m"] == pytest.approx(clearance.min(), abs=1e-9)
        assert record["near_time_s"] == pytest.approx(task.task.duration * (clearance[1:] < 0.8).sum())
        assert (clearance[:-1] > 0.0).all()
        assert (record["hit"] != "") == (clearance[-1] <= 0.0)
        if record["hit"]:
            assert record["outcome"] == "collision"
            nearest = scenes[i][int(np.argmin([distance[-1] for distance in room]))]
            assert record["hit"] == KINDS[nearest["kind"]]


def test_the_vehicle_sinks_onto_a_rough_bottom() -> None:
    sinking = batch("rough", "world.altitude=1", "task.bounds=60", n=8)
    sinking.reset()
    assert sinking.task.world is not None
    world: Any = sinking.task.world.world
    down = np.zeros_like(sinking._action)
    down[:, 4:] = -1.0 if sinking.vehicle.allocation[2, 4:].sum() > 0.0 else 1.0
    hits = 0
    for _ in range(400):
        solids = [solids_of(sinking, i)[:1].copy() for i in range(8)]
        result = sinking.step(down)
        for k, i in enumerate(result.ended.tolist()):
            if result.records[k]["hit"]:
                hits += 1
                assert result.records[k]["hit"] == "bottom"
                point = oracle.own_axes(solids[i][0], result.final_state.pose[k : k + 1, :3])
                above = point[0, 2] - oracle.height(world.grid, 1.0, np.zeros(3), point)[0]
                # The nearest triangle is at most the radius away, and the slope lengthens the way along z.
                assert 0.0 < above <= RADIUS / float(solids[i]["cosine"][0])
    assert hits > 3


@pytest.mark.slow
@pytest.mark.parametrize("task", list(TASKS))
def test_every_task_ends_by_contact(task: str) -> None:
    words = {"path_following": ["world.depth=70"], "formation": ["task.vehicles=1"]}.get(task, [])
    falling = batch("slope", "world.altitude=0.5", "world.dip=0", *words, task=task, n=2)
    falling.reset()
    assert falling.task.world is not None
    for i in range(2):  # a bottom just below each vehicle
        falling.task.world.solids[i]["position"][:, 2] = falling.simulator.pose[i, 2] - RADIUS - 0.05
    down = np.tile(-np.sign(falling.vehicle.allocation[2]), (2, 1))
    for _ in range(40):
        if records := falling.step(down).records:
            break
    assert {(record["outcome"], record["hit"]) for record in records} == {("collision", "plane")}
    assert tuple(records[0]) == record_columns(task, "slope")
    assert {"hit": KINDS.index("plane"), "outcome": 1}.items() <= numbers(records[0]).items()


def test_a_reward_sees_the_contact() -> None:
    hitting = batch("pillars", "reward=gym_dockauv", n=16)
    hitting.reset()
    command = actions(hitting)
    for _ in range(600):
        result = hitting.step(command)
        for k, i in enumerate(result.ended.tolist()):
            if result.records[k]["hit"]:
                assert result.reward[i] < -200.0
                return
    pytest.fail("no vehicle hit a pillar")


# --- Open water ------------------------------------------------------------------------------------------------------------------


def test_open_water_has_no_column_field_or_key_of_a_world() -> None:
    empty = batch("open")
    assert empty.task.world is None
    assert empty.task.own_fields == type(empty.task).fields
    assert not {"world", "hit"} & {*record_columns("docking")}
    assert empty.task.loops is batch("open", "world=open").task.loops
    config = compose("train", ["algo=pid"])
    plain: Any = OmegaConf.to_container(config)
    without = {key: value for key, value in plain.items() if key != "world"}
    assert identity.run_id(plain) == identity.run_id(without)
    tank: Any = OmegaConf.to_container(compose("train", ["algo=pid", "world=tank"]))
    assert identity.run_id(tank) != identity.run_id(plain)


def test_a_configuration_without_a_world_is_one_in_open_water() -> None:
    values: Any = OmegaConf.to_container(compose("train", ["algo=pid"]))
    del values["world"]
    assert typed(OmegaConf.create(values)).world.name == "open"


def test_metrics_know_all_worlds() -> None:
    assert {*SOLID} == {*WORLDS} - {"open"}
    assert set(record_columns("docking", "field")) - set(record_columns("docking")) == {
        *TOLD,
        "way_clearance_m",
        "way_ratio",
    }


# --- Draws -----------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("world", ["slope", "rough", "pillars", "field", "pipeline"])
def test_a_world_is_a_function_of_the_key_of_its_episode(world: str) -> None:
    many, few = batch(world, n=5, seed=7), batch(world, n=2, seed=7)
    many.reset()
    few.reset()
    for i in range(2):
        assert solids_of(many, i).tobytes() == solids_of(few, i).tobytes()
    assert solids_of(many, 0).tobytes() != solids_of(many, 1).tobytes()
    for other in (batch(world, n=1, seed=8), batch(world, n=1, seed=7, test=True)):
        other.reset()
        assert solids_of(many, 0).tobytes() != solids_of(other, 0).tobytes()


def test_a_seed_of_the_world_is_one_world_in_training_and_tests() -> None:
    names = set()
    for streams in ({"seed": 1}, {"seed": 2, "test": True}):
        fixed = batch("slope", "world.seed=17", "world.depth=40", n=3, **streams)
        fixed.reset()
        assert fixed.task.world is not None
        names |= {fixed.task.world.name(i, 1) for i in range(3)}
    assert len(names) == 1
    assert names.pop().startswith("slope-")


@pytest.mark.parametrize("world", ["rough", "field"])
def test_copies_resumed_and_other_environments_have_the_same_bits(world: str) -> None:
    first = batch(world, "world.altitude=1" if world == "rough" else "world.density=0.03", n=6, seed=3)
    first.reset()
    command = actions(first)
    for _ in range(60):  # with automatic resets
        first.step(command)
    twin, resumed = copy.deepcopy(first), batch(world, *[
        "world.altitude=1" if world == "rough" else "world.density=0.03"
    ], n=6, seed=99)  # fmt: skip
    resumed.load_state_dict(first.state_dict())
    for _ in range(60):
        for one in (first, twin, resumed):
            one.step(command)
    assert bits(first) == bits(twin) == bits(resumed)


@pytest.mark.slow
def test_functions_run_as_python_give_the_same_bits() -> None:
    compiled, interpreted = batch("field", n=2, seed=5), batch("field", n=2, seed=5)
    interpreted.task.interpret()
    for one in (compiled, interpreted):
        one.reset()
        for _ in range(10):
            one.step(actions(one))
    assert bits(compiled) == bits(interpreted)


def test_vector_environment_tells_of_the_hit() -> None:
    words = ["task=docking", "vehicle=bluerov2_heavy", "world=pillars", "world.vehicle_radius=1.5"]
    vector = AuvVectorEnv(16, words)
    vector.reset(seed=1)
    command = np.random.default_rng(0).uniform(-1.0, 1.0, vector.action_space.shape)
    for _ in range(400):
        *_, info = vector.step(command)
        if "record" in info and (info["record"]["hit"][info["_record"]] == KINDS.index("capsule")).any():
            return
    pytest.fail("no vehicle hit a pillar")


# --- The worlds -------------------------------------------------------------------------------------------------------------------


def test_pillars_are_those_of_gym_dockauv() -> None:
    docking = batch("pillars")
    docking.reset()
    pillars, dock = solids_of(docking, 0), docking.task.goal(0)
    assert len(pillars) == 4
    assert (pillars["radius"] == 1.0).all()
    assert (pillars["half"][:, 2] == 20.0).all()
    assert np.linalg.norm(pillars["position"] - dock, axis=1) == pytest.approx(6.0)
    assert np.linalg.norm(pillars["position"][0] - pillars["position"][2]) == pytest.approx(12.0)


def test_a_slope_falls_and_keeps_its_altitude() -> None:
    sloping = batch("slope", "world.dip=0.3", "world.altitude=5", "world.direction=0", n=8)
    sloping.reset()
    for i in range(8):
        bottom = solids_of(sloping, i)[0]
        assert bottom["along_z"] == pytest.approx([math.sin(0.3), 0.0, math.cos(0.3)])
        points = np.array([sloping.task.episodes[i].start, sloping.task.goal(i)])
        heights = oracle.signed_distance(bottom, points) / math.cos(0.3)
        assert heights.min() == pytest.approx(5.0)


def test_a_fractal_bottom_has_the_height_and_roughness_that_are_asked_for() -> None:
    for hurst in (0.3, 0.8):
        grids = [fractal(seed, 256, hurst, 2.0) for seed in range(8)]
        assert [grid.std() for grid in grids] == pytest.approx([2.0] * 8)
        assert [grid.mean() for grid in grids] == pytest.approx([0.0] * 8, abs=1e-9)
        steps = np.mean([[np.var(grid - np.roll(grid, lag, 0)) for lag in (2, 8)] for grid in grids], axis=0)
        # Variance of a difference over a distance: distance^(2 H).
        assert 0.5 * math.log(steps[1] / steps[0]) / math.log(4.0) == pytest.approx(hurst, abs=0.12)
    assert (fractal(1, 16, 0.5, 1.0) != fractal(2, 16, 0.5, 1.0)).any()


def ends_of(pipe: Any) -> Floats:
    """Return the ends (k, 2, 3) in m of the axes of capsules."""
    half = pipe["half"][:, 2:] * pipe["along_z"]
    return np.stack([pipe["position"] - half, pipe["position"] + half], axis=1)


def test_a_pipe_lies_on_the_bottom_from_the_start_to_the_goal() -> None:
    docking = batch(
        "pipeline", "world.height=0.5", "world.burial=0.25", "world.beyond=4", "task.start_high=12"
    )
    docking.reset()
    assert docking.task.world is not None
    world: Any = docking.task.world.world
    for i in range(docking.n):
        bottom, *_ = solids = solids_of(docking, i)
        ends = ends_of(solids[1:])
        assert ends[1:, 0] == pytest.approx(ends[:-1, 1])
        points = oracle.own_axes(bottom, ends.reshape(-1, 3))
        height = points[:, 2] - oracle.height(world.grid, 1.0, np.zeros(3), points)
        assert height == pytest.approx(0.5 * 0.25)  # half of the radius
        assert 1.5 < np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).min() < 2.5
        start, goal = np.array(docking.task.episodes[i].start)[:2], docking.task.goal(i)[:2]
        way = (goal - start) / np.linalg.norm(goal - start)
        along, aside = (ends[:, :, :2] - start) @ way, (ends[:, :, :2] - start) @ [-way[1], way[0]]
        assert along.min() == pytest.approx(-4.0, abs=0.5)
        assert along.max() == pytest.approx(np.linalg.norm(goal - start) + 4.0, abs=0.5)
        assert 0.0 < np.abs(aside).max() <= 3.0


def test_a_pipe_lies_below_the_path_of_path_following() -> None:
    following = batch(
        "pipeline", "task.climb=0", "task.waypoints=4", "world.beyond=0", task="path_following", n=2
    )
    following.task.interpret()
    following.reset()
    for i in range(2):
        path = following.task.line(i)
        points = following.task.episodes[i].points[:4]
        assert path[::16] == pytest.approx(points, abs=1e-12)
        corners = ends_of(solids_of(following, i)[1:]).reshape(-1, 3)
        apart = np.linalg.norm(corners[:, None, :2] - path[None, :, :2], axis=2)
        assert apart.min(axis=1).max() < 0.6  # the points of the path are 1 m apart
        assert apart.min(axis=0).max() < 1.1


def test_a_path_that_climbs_stays_above_the_pipe_and_the_bottom() -> None:
    following = batch("pipeline", task="path_following", n=8)
    following.task.interpret()
    following.reset()
    for i in range(8):
        path = following.task.line(i)
        solids, heights = solids_of(following, i), following.task.world.heights
        distances, nearest = np.empty(len(path)), np.empty(len(path), np.int64)
        clearance(solids, heights, 0.0, path, 100.0, distances, nearest, np.empty((len(path), 3)))
        assert distances.min() > 1.0


def discs_of(batch: Batch, i: int) -> Floats:
    rows = solids_of(batch, i)
    boxes = np.hypot(rows["half"][:, 0], rows["half"][:, 1])
    return np.column_stack([rows["position"][:, :2], np.where(rows["radius"] > 0.0, rows["radius"], boxes)])


def test_a_field_has_its_density_and_gaps_and_keeps_start_and_goal_free() -> None:
    crossing = batch("field", "world.density=0.03", task="waypoint", n=24)
    crossing.reset()
    kinds = set()
    for i in range(24):
        discs, kinds = discs_of(crossing, i), kinds | set(solids_of(crossing, i)["kind"].tolist())
        start, goal = np.array(crossing.task.episodes[i].start), crossing.task.goal(i)
        distance = math.hypot(*(goal - start)[:2])
        assert len(discs) == pytest.approx(0.03 * (distance + 16.0) * 16.0, abs=0.51)
        assert discs[:, 2].min() >= 0.5 - 1e-9
        assert discs[:, 2].max() <= 1.5 + 1e-9
        for point in (start, goal):
            assert (np.hypot(*(discs[:, :2] - point[:2]).T) - discs[:, 2]).min() >= 2.0 + RADIUS - 1e-9
        apart = np.hypot(*(discs[:, None, :2] - discs[None, :, :2]).T) - discs[:, 2] - discs[:, 2][:, None]
        np.fill_diagonal(apart, np.inf)
        assert apart.min() >= 1.0 - 1e-9
        assert crossing.task.episodes[i].way_ratio >= 1.0
    assert kinds == {0, 2, 3}


def test_a_share_of_the_obstacles_moves_and_the_others_keep_their_bits() -> None:
    still, moving = batch("field", n=8), batch("field", "world.moving=0.3", "world.speed=0.5", n=8)
    for one in (still, moving):
        one.reset()
    shares, bearings = [], []
    for i in range(8):
        one, other = np.array(solids_of(still, i)), np.array(solids_of(moving, i))
        velocity = other["velocity"].copy()
        other["velocity"] = 0.0
        assert one.tobytes() == other.tobytes()
        moves = velocity.any(axis=1)
        assert not velocity[:, 2].any()
        assert np.linalg.norm(velocity[moves], axis=1) == pytest.approx(0.5)
        shares += moves.tolist()
        bearings += np.arctan2(*velocity[moves, 1::-1].T).tolist()
    assert 0.15 < np.mean(shares) < 0.45
    assert min(bearings) < -1.5
    assert max(bearings) > 1.5
    assert moving.task.world is not None
    assert moving.task.world.moves
    name = moving.task.world.name(0, int(moving.task.episodes[0].solids))
    assert name != still.task.world.name(0, int(still.task.episodes[0].solids))  # type: ignore[union-attr]


def test_a_field_may_have_a_bottom_below_the_same_obstacles() -> None:
    without, over = batch("field"), batch("field", "world.bottom_depth=30")
    for one in (without, over):
        one.reset()
    for i in range(without.n):
        *obstacles, bottom = solids_of(over, i)
        assert np.array(obstacles).tobytes() == np.array(solids_of(without, i)).tobytes()
        assert bottom["kind"] == PLANE
        assert bottom["position"].tolist() == [0.0, 0.0, -30.0]
        assert bottom["along_z"].tolist() == [0.0, 0.0, 1.0]


def test_runs_in_a_field_at_rest_keep_their_ids() -> None:
    values: Any = OmegaConf.to_container(compose("train", ["algo=pid", "world=field"]))
    earlier = copy.deepcopy(values)
    del earlier["world"]["moving"], earlier["world"]["speed"], earlier["world"]["bottom_depth"]
    assert identity.run_id(values) == identity.run_id(earlier)
    assert typed(OmegaConf.create(earlier)).world.moving == 0.0
    values["world"]["moving"] = 0.5
    assert identity.run_id(values) != identity.run_id(earlier)


def test_the_shortest_way() -> None:
    nothing = np.empty((0, 3))
    assert shortest_way(nothing, 0.3, 10.0, 5.0)[0] == pytest.approx(10.0)
    wall = np.array([[5.0, y, 0.6] for y in np.arange(-6.0, 6.5, 1.0)])
    assert math.isinf(shortest_way(wall, 0.3, 10.0, 5.0)[0])
    door = wall[(wall[:, 1] < 2.5) | (wall[:, 1] > 4.5)]  # free between y = 2.6 and 4.4
    length, room = shortest_way(door, 0.3, 10.0, 5.0)
    # Only the cells at y = 3.5 are free in the door; steps go along the axes and the diagonals.
    assert length == pytest.approx(2.0 * (1.5 + 3.5 * math.sqrt(2.0)))
    assert room > 0.0
    assert math.isinf(shortest_way(door, 1.0, 10.0, 5.0)[0])  # too wide for the door
    one = np.array([[5.0, 0.0, 1.0]])
    assert 2.0 * math.hypot(5.0, 1.3) - 2 * CELL < shortest_way(one, 0.3, 10.0, 5.0)[0] < 12.5


def test_darts_that_find_no_room_are_left_out() -> None:
    crowded = scatter((1, 0, 0, 0), 0, 500, (10.0, 5.0), (1.0, 1.0), 0.0, 1.0)
    assert 5 < len(crowded) < 80


# --- The vehicle's hull -------------------------------------------------------------------------------------------------------------


def test_a_hull_is_that_of_a_box_of_the_same_mass_and_inertia_unless_the_sheet_has_one() -> None:
    vehicle = sheet.load("bluerov2_2026")
    inertia = np.trace(vehicle.inertia) / vehicle.mass
    assert vehicle.hull == (pytest.approx(math.sqrt(1.5 * inertia)), 0.0)
    a, b, c = 0.4, 0.3, 0.2
    box = SimpleNamespace(
        own_hull=None,
        mass=2.0,
        units=(),
        inertia=np.diag([b * b + c * c, a * a + c * c, a * a + b * b]) / 6.0,
    )
    assert type(vehicle).hull.fget(box)[0] == pytest.approx(0.5 * math.hypot(a, b, c))  # type: ignore[attr-defined]
    assert sheet.load(with_hull(0.2, 1.5)).hull == (0.2, 1.5)


def with_hull(radius: Any, length: Any = None) -> dict[str, Any]:
    plain: Any = train_config(compose("train", ["vehicle=bluerov2_heavy"])).vehicle
    source = next(iter(plain["sources"]))
    hull = {"radius": {"value": radius, "unit": "m", "source": source}}
    if length is not None:
        hull["length"] = {"value": length, "unit": "m", "source": source}
    return {**plain, "hull": hull}


def test_a_long_hull_touches_with_its_ends() -> None:
    config = configuration(overrides=["task=docking", "vehicle=bluerov2_heavy", "world=tank", "algo=pid"])
    config.vehicle = with_hull(0.2, 1.5)
    long = Batch(config, 1)
    long.reset()
    assert long.task.world is not None
    hull = long.task.world.hull[0]
    assert (hull.count, hull.first) == (9, -0.75)
    yaw = float(long.task.episodes[0].start_yaw)
    x, y, z = long.task.episodes[0].start
    reach = [0.75 * abs(math.cos(yaw)), 0.75 * abs(math.sin(yaw))]
    walls = (30.0 - abs(x) - reach[0], 30.0 - abs(y) - reach[1], z + 60.0)
    assert float(long.task.episodes[0].clearance) == pytest.approx(min(walls) - 0.2)


@pytest.mark.parametrize(
    ("radius", "length", "words"),
    [(0.0, None, "must be"), (0.1, 6.0, "at most 50 times the radius"), (0.1, -1.0, "must be")],
)
def test_bad_hulls_are_refused(radius: float, length: float | None, words: str) -> None:
    with pytest.raises(VehicleError, match=words):
        sheet.load(with_hull(radius, length))


# --- Bad input -----------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["world=reef"], "reef"),
        (["world=field", "world.density=0"], "world.density=0"),
        (["world=field", "world.density=0.15"], "must be at most"),
        (["world=field", "world.radius_low=2"], "world.radius_high"),
        (["world=pillars", "world.count=40"], "overlap"),
        (["world=field", "world.moving=1.5"], "world.moving=1.5"),
        (["world=field", "world.speed=-1"], "world.speed=-1"),
        (["world=tank", "world.length=-1"], "world.length=-1"),
        (["world=pipeline", "world.radius=-1"], "world.radius=-1"),
        (["world=pipeline", "world.burial=1.5"], "world.burial=1.5"),
        (["world=tank", "simulator=gazebo"], "simulator=fossen, or world=open"),
        (["world=tank", "simulator=ros2"], "simulator=fossen, or world=open"),
        (["world=tank", "world.dip=1"], "dip"),
    ],
)
def test_wrong_worlds_are_refused(words: list[str], message: str) -> None:
    with pytest.raises(ConfigError, match=message) as error:
        configuration(overrides=words)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["world=tank", "task=waypoint", "task.start=[40,0,-20]"], "a start at .* is outside the tank"),
        (["world=tank", "task=docking", "task.dock=[31,0,-20]", "task.start_low=15"], "outside the tank"),
        (["world=slope", "world.depth=15", "task=docking"], "is inside the bottom"),
        (["world=pipeline", "world.altitude=0", "world.radius=2", "world.sway=0", "task=waypoint"], "the bottom or the pipe"),
        (["world=pipeline", "world.piece=0.1", "task=docking"], "world.piece=0.1: the pipe of .* must be at least 0.1"),
        (["world=pillars", "task=docking", "world.turn=0", "world.count=18", "task.start_low=6", "task.start_high=6"],
         "inside a pillar"),
        (["world=field", "world.density=0.12", "world.gap=0", "world.vehicle_radius=1.5", "task=waypoint"],
         "no vehicle with a radius of 1.5 m can pass"),
        (["world=field", "world.density=0.05", "world.margin=40", "task=waypoint"], "reduce world.margin"),
    ],
)  # fmt: skip
def test_episodes_that_cannot_begin_are_refused(words: list[str], message: str) -> None:
    wrong = Batch(configuration(overrides=["vehicle=bluerov2_heavy", "algo=pid", *words]), 16)
    with pytest.raises(ConfigError, match=message) as error:
        wrong.reset()
    assert "\n" not in str(error.value)


def test_train_refuses_a_start_outside_the_tank(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    words = ["algo=pid", "world=tank", "task.start=[40,0,-20]", f"output={tmp_path}"]
    assert main(["train", *words]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "world=tank: a start at (40.0, 0.0, -20.0) m is outside the tank" in line


def test_a_start_that_is_placed_into_a_solid_is_refused_and_changes_nothing() -> None:
    placed = batch("tank", n=2)
    placed.reset()
    before = bits(placed)
    with pytest.raises(ConfigError, match=r"options\['pose'\]: world=tank: a start at"):
        placed.reset(pose=np.tile([40.0, 0.0, -20.0, 1.0, 0.0, 0.0, 0.0], (2, 1)))
    assert bits(placed) == before
