"""Starts from which an episode can succeed: drawn by construction, refused where there are none, and placed ones followed."""

from __future__ import annotations

import math

import numpy as np
import pytest

from auvbench.envs.batch import Batch
from auvbench.envs.gym_env import AuvEnv
from auvbench.errors import ConfigError
from auvbench.tasks import rows
from tests import configs
from tests.unit.tasks.test_tasks import HEAVY, advance, batch_of, path_of, put


def env_of(task: str, *overrides: str) -> AuvEnv:
    return AuvEnv([f"task={task}", HEAVY, "noise=none", *overrides])


@pytest.mark.parametrize("depth", [-1.0, -3.0, -59.5])
def test_stations_near_a_depth_limit_have_starts_in_the_water(depth: float) -> None:
    n = 2000
    batch = batch_of("station_keeping", f"task.station=[0,0,{depth}]", n=n)
    start = batch.simulator.pose[:, :3]
    away = np.linalg.norm(start - [0.0, 0.0, depth], axis=1)
    assert away.max() <= 2.5
    assert abs(((away / 2.5) ** 3).mean() - 0.5) < 4 * math.sqrt(1 / 12 / n), "no longer uniform in distance"
    assert start[:, 2].max() <= max(-2.0, depth)
    assert start[:, 2].min() >= min(-59.0, depth)


@pytest.mark.parametrize("depth", [-1.0, -5.0, -20.0, -58.0])
def test_docks_near_a_depth_limit_have_starts_at_the_drawn_distance(depth: float) -> None:
    batch = batch_of("docking", f"task.dock=[0,0,{depth}]", n=2000)
    start = batch.simulator.pose[:, :3]
    away = np.linalg.norm(start - [0.0, 0.0, depth], axis=1)
    assert away.min() >= 5.0 - 1e-9
    assert away.max() <= 15.0 + 1e-9
    assert start[:, 2].max() <= max(-2.0, depth)
    assert start[:, 2].min() >= min(-59.0, depth)
    # Uniform on the part of each sphere: all heights between the limits are as frequent.
    low, high = (np.maximum(-away, -59.0 - depth), np.minimum(away, max(-2.0 - depth, 0.0)))
    share = (start[:, 2] - depth - low) / (high - low)
    assert abs(share.mean() - 0.5) < 4 * math.sqrt(1 / 12 / 2000)


@pytest.mark.parametrize(
    "overrides",
    [
        ("task.start=[0,0,-5]",),
        ("task.start=[0,0,-57]",),
        ("task.depth_low=-9", "task.start=[0,0,-5]"),
        ("task.spacing=50", "task.climb=0.785", "task.start=[0,0,-20]"),
        ("task.climb=1.5", "task.start=[0,0,-30]"),
    ],
)
def test_paths_stay_in_the_water(overrides: tuple[str, ...]) -> None:
    n = 100
    batch = batch_of("path_following", *overrides, n=n)
    limits = batch.config.task
    for i in range(n):
        z = path_of(batch, i, 601)[:, 2]
        assert z.max() < limits.depth_high
        assert z.min() > limits.depth_low
    points = batch.task.episodes.points[:, :7]
    lengths = np.linalg.norm(np.diff(points, axis=1), axis=2)
    np.testing.assert_allclose(lengths, limits.spacing)
    assert (batch.simulator.pose[:, 2] < limits.depth_high).all()


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (("docking", "task.bounds=5"), "task.start_high=15: must be at most task.bounds=5"),
        (("docking", "task.start_low=0.5"), "task.start_low=0.5: must be at least task.clearance=1"),
        (("station_keeping", "task.start_radius=20"), "task.start_radius=20: must be at most task.bounds=10"),
        (("trajectory_tracking", "task.start_radius=6"), "task.start_radius=6: must be at most task.bounds=5"),
        (("path_following", "task.start_radius=20"), "task.start_radius=20: must be at most task.bounds=10"),
        (("path_following", "task.start=[0,0,-2]"), r"must have a z of at least -57.82 and at most -3.182"),
        (("path_following", "task.depth_low=-4", "task.start=[0,0,-3]"), "task.depth_low=-4: must be at most -5.36"),
        (("waypoint", "task.waypoint_low=[-5,-5,-90]", "task.waypoint_high=[5,5,-70]"), "task.waypoint_high=.*a z of at least -60"),
        (("waypoint", "task.waypoint_low=[-5,-5,1]", "task.waypoint_high=[5,5,4]"), "task.waypoint_low=.*a z of at most -1"),
    ],
)  # fmt: skip
def test_tasks_without_a_start_or_a_goal_are_refused(overrides: tuple[str, ...], message: str) -> None:
    task, *more = overrides
    with pytest.raises(ConfigError, match=message) as caught:
        configs.training(f"task={task}", HEAVY, *more)
    assert "\n" not in str(caught.value)


def test_waypoints_are_drawn_in_the_part_of_the_box_in_the_water() -> None:
    box = ("task.waypoint_low=[-5,-5,-90]", "task.waypoint_high=[5,5,3]")
    batch = Batch(configs.training(*box), 1000, seed=2)
    batch.reset()
    z = batch.task.reference[:, 2]
    assert -60.0 <= z.min() < -58.0
    assert -3.0 < z.max() <= -1.0


def test_a_distance_moves_no_waypoint_out_of_the_water() -> None:
    batch = Batch(configs.training(), 500, seed=2)
    batch.reset(distance=np.full(500, 35.0))
    line = batch.task.reference - [0.0, 0.0, -20.0]
    np.testing.assert_allclose(np.linalg.norm(line, axis=1), 35.0)
    assert batch.task.reference[:, 2].max() <= -1.0
    before = Batch(configs.training(), 500, seed=2)
    before.reset()
    drawn = before.task.reference
    np.testing.assert_allclose(np.arctan2(line[:, 1], line[:, 0]), np.arctan2(drawn[:, 1], drawn[:, 0]))


def test_a_waypoint_out_of_the_water_is_refused() -> None:
    env = AuvEnv()
    with pytest.raises(ConfigError, match=r"options\['waypoint'\]: z = 5 m must be within -60 and -1 m"):
        env.reset(seed=0, options={"waypoint": [0, 0, 5]})


def test_a_placed_vehicle_docks_from_where_it_is() -> None:
    env = env_of("docking")
    env.reset(seed=3)
    pose = [7.0, 2.0, -18.0, 0.3]
    observation, info = env.reset(seed=3, options={"pose": pose})
    assert observation in env.observation_space
    distance = np.linalg.norm(info["reference"] - pose[:3])
    assert info["distance"] == pytest.approx(distance)
    task = env.batch.task
    assert task.episodes[0].initial_distance == pytest.approx(distance)
    # The reference is that of the first step from there.
    task.advance(env.batch.simulator.pose, env.batch.simulator.velocity, *[np.zeros((1, 8))] * 2, np.zeros(1))
    np.testing.assert_allclose(task.reference[0], info["reference"])


@pytest.mark.parametrize("point", range(7))
def test_a_vehicle_placed_on_a_path_follows_it_from_there(point: int) -> None:
    env = env_of("path_following")
    env.reset(seed=4)
    task = env.batch.task
    place = task.episodes.points[0, point].copy()
    place[:2] += 0.5
    _, info = env.reset(seed=4, options={"pose": [*place, 0.0]})
    away = np.linalg.norm(path_of(env.batch, 0, 60001) - place, axis=1)
    assert info["distance"] == pytest.approx(away.min(), abs=1e-3)
    assert task.episodes[0].progress == pytest.approx(6.0 * away.argmin() / 60000, abs=0.01)
    assert env.step(np.zeros(8))[4]["distance"] < 1.5


def test_a_path_begins_next_to_the_vehicle() -> None:
    n = 300
    batch = batch_of("path_following", n=n)
    for i in range(0, n, 10):
        away = np.linalg.norm(path_of(batch, i, 60001)[:20000] - batch.simulator.pose[i, :3], axis=1)
        assert batch.task.episodes[i].distance == pytest.approx(away.min(), abs=2e-3)
    assert (batch.task.episodes.progress[:] > 0.0).mean() > 0.3
    assert batch.task.episodes.progress[:].max() < 0.25


def test_a_path_asks_for_no_speed_behind_its_end() -> None:
    batch = batch_of("path_following", "task.waypoints=2", "task.spacing=0.3")
    e = batch.task.episodes[0]
    end = batch.task.goal(0)
    along = (end - e.points[0]) / 0.3
    yaw = math.atan2(along[1], along[0])
    for _ in range(4):
        put(batch, end + 1.33 * along)
        advance(batch)
    np.testing.assert_allclose(batch.task.reference[0], end)
    assert not e.reference_velocity.any()
    assert e.reference_yaw == pytest.approx(yaw)


@pytest.mark.slow
def test_a_short_path_is_followed_to_its_end() -> None:
    from auvbench.agents.base import make
    from auvbench.evaluation.rollout import roll_out
    from auvbench.vehicles import sheet

    config = configs.training(
        "task=path_following", "algo=pid", HEAVY, "task.waypoints=2", "task.spacing=0.3"
    )
    records = roll_out(
        config, make(config, sheet.load(config.vehicle)), episodes=np.arange(20), seed=123, batch=20
    ).records
    assert [record["outcome"] for record in records] == ["success"] * 20


@pytest.mark.parametrize(
    ("task", "pose", "message"),
    [
        ("waypoint", [5000, 0, -20, 0], r"is \(.*\) m from the waypoint; must be at most \("),
        ("waypoint_state", [0, 5000, -20, 0], "from the waypoint"),
        ("station_keeping", [12, 0, -20, 0], "is 12 m from the reference; must be at most task.bounds=10 m"),
        ("trajectory_tracking", [40, 0, -20, 0], "m from the reference; must be at most task.bounds=5 m"),
        ("path_following", [400, 0, -20, 0], "m from the reference; must be at most task.bounds=10 m"),
        ("tracking", [40, 0, -20, 0], "m from the target; must be at most task.bounds=8 m"),
        ("docking", [26, 0, -20, 0], "is 26 m from the dock; must be at most task.bounds=25 m"),
        ("docking", [0, 0, -19.2, 0], "outside of the cone in front of it; must be at least task.clearance=1 m there"),
    ],
)  # fmt: skip
def test_a_pose_out_of_bounds_is_refused_and_changes_nothing(task: str, pose: list, message: str) -> None:
    env = env_of(task)
    env.reset(seed=1)
    env.step(np.zeros(8))
    before = env.batch.state_dict()
    with pytest.raises(ConfigError, match=message) as caught:
        env.reset(options={"pose": pose})
    assert str(caught.value).startswith("options['pose']: ")
    after = env.batch.state_dict()
    assert all(np.array_equal(before[name], after[name]) for name in before)
    env.step(np.zeros(8))


@pytest.mark.parametrize(
    "task", ["waypoint", "waypoint_state", "station_keeping", "path_following", "docking"]
)
def test_accepted_poses_are_in_the_observation_space(task: str) -> None:
    env = env_of(task)
    rng, accepted = np.random.default_rng(0), 0
    for _ in range(60):
        pose = [*rng.uniform(-20, 20, 2), rng.uniform(-40, -2), rng.uniform(-3, 3)]
        try:
            observation, _ = env.reset(seed=1, options={"pose": pose})
        except ConfigError:
            continue
        accepted += 1
        assert observation in env.observation_space
    assert accepted


@pytest.mark.parametrize(
    ("roll", "pitch"), [(1.04, 0.0), (-1.05, 0.0), (0.0, 1.05), (0.2, -1.05), (0.0, 1.04)]
)
def test_a_tilt_ends_docking_where_the_task_says_so(roll: float, pitch: float) -> None:
    from scipy.spatial.transform import Rotation

    for tilt, ends in ((math.radians(60.0), max(abs(roll), abs(pitch)) > math.radians(60.0)), (None, False)):
        words = () if tilt is None else (f"task.tilt={tilt}",)
        batch = batch_of("docking", "reward=gym_dockauv", *words)
        x, y, z, w = Rotation.from_euler("ZYX", [0.4, -pitch, roll]).as_quat()
        batch.simulator.pose[0, 3:] = w, x, y, z
        reward, outcome = advance(batch)
        assert outcome == (rows.OUT_OF_BOUNDS if ends else -1)
        assert (reward < -190.0) == ends
