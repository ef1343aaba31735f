"""The tasks other than waypoints, against their definitions in docs/task.md, computed by other means."""

from __future__ import annotations

import inspect
import linecache
import math
from collections import Counter

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from scipy.spatial.transform import Rotation

from auvbench.agents.base import make
from auvbench.envs.batch import Batch
from auvbench.errors import ConfigError
from auvbench.evaluation.rollout import roll_out
from auvbench.integrations.gazebo import simulator as gazebo
from auvbench.registry import TASKS
from auvbench.simulators.fossen import FossenSimulator
from auvbench.tasks import rows
from auvbench.tasks.base import Task
from auvbench.testing import TASK_CHECKS, ConformanceError, check_task
from auvbench.training.execute import check_runnable
from auvbench.vehicles import sheet
from tests import configs

HEAVY = "vehicle=bluerov2_heavy"
OTHERS = [name for name in TASKS if TASKS[name].has_yaw]


def batch_of(task: str, *overrides: str, n: int = 1) -> Batch:
    batch = Batch(configs.training(f"task={task}", HEAVY, "noise=none", *overrides), n, seed=5)
    batch.reset()
    return batch


def put(batch: Batch, position, yaw: float = 0.0, velocity=(0.0, 0.0, 0.0)) -> None:
    batch.simulator.pose[0] = [*position, math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)]
    batch.simulator.velocity[0] = [*velocity, 0.0, 0.0, 0.0]


def advance(batch: Batch) -> tuple[float, int]:
    """Judge the vehicle where it is, without moving it."""
    simulator = batch.simulator
    idle = np.zeros((1, len(batch.vehicle.actuators)))
    batch.task.advance(simulator.pose, simulator.velocity, idle, idle, np.zeros(1))
    return float(batch.task.reward[0]), int(batch.task.outcome[0])


@pytest.mark.parametrize("check", TASK_CHECKS, ids=lambda check: check.__name__)
@pytest.mark.parametrize("task", TASKS)
def test_every_task_keeps_the_contract(task: str, check) -> None:
    more = ["task.history=3"] if task == "docking" else []
    check_task(f"task={task}", HEAVY, "disturbance=moderate", *more, only=check)


def test_a_broken_contract_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    draws = iter(range(1, 100))
    whole = Task.reset

    def reset(self, indices):
        pose = whole(self, indices)
        pose[:, 0] += next(draws)
        return pose

    monkeypatch.setattr(Task, "reset", reset)
    with pytest.raises(ConformanceError, match="bluerov2_heavy: its rows do not depend on the batch: "):
        check_task("task=docking", HEAVY)
    with pytest.raises(ConformanceError, match="the same seed and episode must give the same start"):
        check_task("task=docking", HEAVY, only=TASK_CHECKS[2])


@pytest.mark.slow
@pytest.mark.parametrize("algo", ["pid", "lqr", "smc", "adrc"])
@pytest.mark.parametrize("task", OTHERS)
def test_controllers_succeed_undisturbed(task: str, algo: str) -> None:
    config = configs.training(f"task={task}", f"algo={algo}", HEAVY)
    agent = make(config, sheet.load(config.vehicle))
    records = roll_out(config, agent, episodes=np.arange(60), seed=123, batch=60).records
    assert Counter(record["outcome"] for record in records)["success"] >= 57


@pytest.mark.slow
@pytest.mark.parametrize(("algo", "error"), [("pid", 0.35), ("lqr", 0.15), ("smc", 0.25)])
def test_controllers_turn_along_with_the_reference(algo: str, error: float) -> None:
    config = configs.training("task=trajectory_tracking", f"algo={algo}", HEAVY)
    agent = make(config, sheet.load(config.vehicle))
    records = roll_out(config, agent, episodes=np.arange(60), seed=123, batch=60).records
    assert np.mean([record["yaw_error_rms_rad"] for record in records]) < error


@pytest.mark.slow
@pytest.mark.parametrize(
    ("task", "more", "measure", "error"),
    [
        ("station_keeping", ["task.time_limit=35"], "position_error_rms_m", 0.1),
        ("trajectory_tracking", ["task.time_limit=35"], "position_error_rms_m", 0.2),
        ("path_following", ["task.waypoints=3"], "cross_track_rms_m", 0.45),
        ("docking", [], "", 0.0),
    ],
)
def test_mpc_succeeds_undisturbed(task: str, more: list[str], measure: str, error: float) -> None:
    pytest.importorskip("casadi")
    config = configs.training(f"task={task}", "algo=mpc", HEAVY, *more)
    agent = make(config, sheet.load(config.vehicle))
    for record in roll_out(config, agent, episodes=np.arange(1), seed=123, batch=1).records:
        assert record["outcome"] == "success"
        if measure:
            assert record[measure] < error
            # A path begins with any yaw, and its errors count from the start.
            assert record["yaw_error_rms_rad"] < (0.7 if task == "path_following" else 0.5)


@pytest.mark.parametrize("task", OTHERS)
def test_blocks_of_the_observation(task: str) -> None:
    blocks = TASKS[task].blocks
    batch = batch_of(task, f"task.observation=[{','.join(blocks)}]")
    rng = np.random.default_rng(1)
    for _ in range(30):
        batch.step(rng.uniform(-1, 1, (batch.n, 8)))
    task_ = batch.task
    e = (task_.episodes if task_.believed is None else task_.believed)[0]
    pose, velocity = batch.simulator.pose[0], batch.simulator.velocity[0]
    turn = Rotation.from_quat([*pose[4:], pose[3]])
    yaw = turn.as_euler("ZYX")[0]
    level = Rotation.from_euler("z", yaw)
    seen = {name: task_.observation[0, task_.spec[name]] for name in blocks}
    expected = {
        "position_error": level.inv().apply(e.reference - pose[:3]),
        "yaw_error": [(e.reference_yaw - yaw + math.pi) % (2 * math.pi) - math.pi],
        "velocity_error": level.inv().apply(e.reference_velocity - turn.apply(velocity[:3])),
        "velocity": velocity[:3],
        "angular_velocity": velocity[3:],
        "gravity": turn.inv().apply([0.0, 0.0, -1.0]),
        "depth_margin": [min(-1.0 - pose[2], pose[2] + 60.0)],
        "previous_action": task_.previous[0],
    }
    if task in ("docking", "rendezvous"):
        expected["goal_error"] = level.inv().apply(e.goal - pose[:3])
    for name, values in expected.items():
        np.testing.assert_allclose(seen[name], values, rtol=2e-5, atol=2e-6, err_msg=name)


def test_history_stacks_the_newest_first_and_begins_full() -> None:
    batch = batch_of("station_keeping", "task.history=3")
    size = batch.task.spec.size // 3
    first = batch.task.observation[0].copy()
    np.testing.assert_array_equal(first, np.tile(first[:size], 3))
    seen = [first[:size]]
    for step in range(4):
        batch.step(np.full((1, 8), 0.3 * (-1) ** step))
        seen.append(batch.task.observation[0, :size].copy())
    np.testing.assert_array_equal(batch.task.observation[0], np.concatenate([seen[4], seen[3], seen[2]]))
    assert batch.task.spec["yaw_error"].stop <= size


def test_preview_is_where_the_reference_will_be() -> None:
    batch = batch_of("trajectory_tracking", "task.curve=random", n=6)
    for _ in range(7):
        batch.step(np.zeros((6, 8)))
    reference, seen = batch.task.reference.copy(), batch.task.observation.copy()
    pose, columns = batch.simulator.pose.copy(), batch.task.spec["preview"]
    for _ in range(5):  # 0.5 s
        batch.step(np.zeros((6, 8)))
    ahead = batch.task.reference - pose[:, :3]
    for i in range(6):
        yaw = Rotation.from_quat([*pose[i, 4:], pose[i, 3]]).as_euler("ZYX")[0]
        want = Rotation.from_euler("z", yaw).inv().apply(ahead[i])
        np.testing.assert_allclose(seen[i, columns][:3], want, rtol=1e-5, atol=1e-5)
    assert not np.array_equal(reference, batch.task.reference)


def test_station_keeping_succeeds_by_its_last_half_minute() -> None:
    batch = batch_of("station_keeping")
    inside, outside = [0.49, 0.0, -20.0], [0.51, 0.0, -20.0]
    for missed, outcome in ((15, rows.SUCCESS), (16, rows.TIMEOUT)):
        batch.reset()
        for step in range(600):
            put(batch, outside if step < 300 or step >= 600 - missed else inside, yaw=0.17)
            found = advance(batch)[1]
            assert found == (outcome if step == 599 else -1)
        record = batch.task.records(np.array([0]))[0]
        error = np.sqrt((0.49**2 * (300 - missed) + 0.51**2 * (200 + missed)) / 500)  # without the first 10 s
        assert record["position_error_rms_m"] == pytest.approx(error)
        assert record["yaw_error_rms_rad"] == pytest.approx(0.17)
        assert record["settling_time_s"] == pytest.approx(60.0)


def test_a_lost_station_counts_as_the_bounds() -> None:
    batch = batch_of("station_keeping")
    put(batch, [0.0, 9.99, -20.0])
    assert advance(batch)[1] == -1
    put(batch, [0.0, 10.01, -20.0])
    assert advance(batch)[1] == rows.OUT_OF_BOUNDS
    assert batch.task.records(np.array([0]))[0]["position_error_rms_m"] == 10.0


def test_yaw_counts_for_success_of_station_keeping() -> None:
    batch = batch_of("station_keeping")
    for _ in range(600):
        put(batch, [0.0, 0.0, -20.0], yaw=0.18)  # 10 degrees are 0.1745
        outcome = advance(batch)[1]
    assert outcome == rows.TIMEOUT


def test_time_ends_tasks_of_fixed_length_and_success_the_others() -> None:
    for task, ends in (("station_keeping", False), ("trajectory_tracking", False), ("docking", True)):
        brief = ("task.settling=0.1", "task.hold_time=0.1") if task == "station_keeping" else ()
        batch = batch_of(task, "task.time_limit=null", "task.max_steps=2", *brief)
        if task == "docking":
            put(batch, batch.task.goal(0), yaw=float(batch.task.episodes[0].reference_yaw))
        batch.task.episodes[0].steps = 0 if ends else 1
        result = batch.step(np.zeros((1, 8)))
        assert (bool(result.terminated[0]), bool(result.truncated[0])) == (ends, not ends), task


@pytest.mark.parametrize("curve", ["circle", "helix", "lemniscate", "random"])
def test_curves_have_their_velocity_and_largest_speed(curve: str) -> None:
    n = 40
    batch = batch_of(
        "trajectory_tracking", f"task.curve={curve}", "task.time_limit=null", "task.max_steps=900", n=n
    )
    idle, seen = np.zeros((n, 8)), []
    for _ in range(900):
        batch.task.episodes.outcome[:] = -1
        batch.task.advance(batch.simulator.pose, batch.simulator.velocity, idle, idle, np.zeros(n))
        seen.append(batch.task.episodes.copy())
    path = np.array(seen)
    position, yaw, velocity = (path[name] for name in ("reference", "reference_yaw", "reference_velocity"))
    between = (position[2:] - position[:-2]) / 0.2
    np.testing.assert_allclose(between, velocity[1:-1], atol=5e-3)
    np.testing.assert_allclose(yaw, np.arctan2(velocity[..., 1], velocity[..., 0]))
    speed = np.linalg.norm(velocity, axis=2)
    assert speed.max() <= 0.8 * 1.005
    assert np.all(
        speed.max(axis=0) >= (0.15 if curve == "random" else 0.3 - 1e-3)
    )  # the largest may come later
    centred = position - np.array([0.0, 0.0, -20.0])
    if curve == "circle":
        radius = np.linalg.norm(centred[..., :2], axis=2)
        np.testing.assert_allclose(radius, np.broadcast_to(radius[:1], radius.shape), rtol=1e-9)
        assert radius.min() >= 3.0
        assert radius.max() <= 6.0
    if curve == "lemniscate":  # x = a sin t, y = a sin(2 t) / 2: y^2 = x^2 (1 - (x/a)^2)
        x, y = centred[..., 0], centred[..., 1]
        a = np.abs(x).max(axis=0)
        np.testing.assert_allclose(y**2, x**2 * (1 - (x / a) ** 2), atol=0.02)


def test_starts_lie_where_the_tasks_say() -> None:
    n = 3000
    for task, radius in (("station_keeping", 2.5), ("trajectory_tracking", 0.5), ("path_following", 2.0)):
        batch = batch_of(task, n=n)
        e = batch.task.episodes
        centre = e.points[:, 0] if task == "path_following" else e.reference
        away = np.linalg.norm(batch.simulator.pose[:, :3] - centre, axis=1)
        assert away.max() <= radius
        # Uniform in a ball: the cube of the distance is uniform.
        share = (away / radius) ** 3
        assert abs(share.mean() - 0.5) < 4 * math.sqrt(1 / 12 / n)
    batch = batch_of("trajectory_tracking", n=n)
    assert np.abs(k_yaw_error(batch)).max() <= math.radians(30) + 1e-9
    batch = batch_of("docking", n=n)
    away = np.linalg.norm(batch.simulator.pose[:, :3] - [0.0, 0.0, -20.0], axis=1)
    assert away.min() >= 5.0
    assert away.max() <= 15.0


def k_yaw_error(batch: Batch) -> np.ndarray:
    return (batch.task.episodes.reference_yaw[:] - batch.task.episodes.start_yaw[:] + np.pi) % (
        2 * np.pi
    ) - np.pi


def path_of(batch: Batch, i: int, count: int = 6001) -> np.ndarray:
    """The path by scipy's Hermite spline through the points of environment i."""
    from scipy.interpolate import CubicHermiteSpline

    points = batch.task.episodes[i].points[:7]
    slopes = np.vstack([points[1] - points[0], (points[2:] - points[:-2]) / 2, points[-1] - points[-2]])
    return CubicHermiteSpline(np.arange(7), points, slopes)(np.linspace(0, 6, count))


@pytest.mark.slow
def test_the_path_reference_is_the_nearest_point() -> None:
    n = 8
    config = configs.training("task=path_following", "algo=pid", HEAVY)
    agent = make(config, sheet.load(config.vehicle))
    batch = Batch(config, n, seed=5, autoreset=False)
    observation = batch.reset()
    agent.reset(np.arange(n))
    paths = [path_of(batch, i) for i in range(n)]
    for step in range(600):
        observation = batch.step(agent.act(observation)).observation
        if step % 50:
            continue
        for i in range(n):
            away = np.linalg.norm(paths[i] - batch.simulator.pose[i, :3], axis=1)
            assert batch.task.episodes[i].distance == pytest.approx(away.min(), abs=0.02)
            # The errors of line-of-sight guidance: (s, e, h) = R^T (p - p_path) with s = 0.
            tangent = batch.task.episodes[i].reference_velocity
            error = batch.simulator.pose[i, :3] - batch.task.reference[i]
            azimuth, elevation = math.atan2(tangent[1], tangent[0]), math.asin(tangent[2] / 0.8)
            s, e, h = Rotation.from_euler("ZY", [azimuth, -elevation]).inv().apply(error)
            if 0.0 < batch.task.episodes[i].progress < 6.0:
                assert abs(s) < 0.02
                assert batch.task.episodes[i].distance == pytest.approx(math.hypot(e, h), abs=1e-3)
            assert np.linalg.norm(tangent) == pytest.approx(0.8)


def test_paths_are_long_and_keep_off_the_depth_limits() -> None:
    batch = batch_of("path_following", n=200)
    for i in range(200):
        path = path_of(batch, i, 601)
        length = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
        assert 94.0 < length < 110.0
        assert path[:, 2].max() < -2.0
        assert path[:, 2].min() > -59.0


def test_docking_takes_place_slowness_and_yaw() -> None:
    batch = batch_of("docking")
    yaw = float(batch.task.episodes[0].reference_yaw)
    out = -np.array([math.cos(yaw), math.sin(yaw), 0.0])
    aside = np.array([-math.sin(yaw), math.cos(yaw), 0.0])
    dock = batch.task.goal(0)
    cases = [
        (dock + 0.29 * out, yaw, 0.14, rows.SUCCESS),
        (dock + 0.31 * out, yaw, 0.14, -1),
        (dock + 0.29 * out, yaw, 0.16, -1),
        (dock + 0.29 * out, yaw + 0.17, 0.0, rows.SUCCESS),
        (dock + 0.29 * out, yaw + 0.18, 0.0, -1),
        (dock + 0.8 * out + 0.8 * math.tan(0.52) * aside, yaw, 0.0, -1),
        (dock + 0.8 * out + 0.8 * math.tan(0.53) * aside, yaw, 0.0, rows.COLLISION),
        (dock - 0.9 * out, yaw, 0.0, rows.COLLISION),
        (dock - 1.1 * out, yaw, 0.0, -1),
        (dock + 25.1 * out, yaw, 0.0, rows.OUT_OF_BOUNDS),
    ]
    for position, turned, speed, outcome in cases:
        batch.task.episodes[0].outcome = -1
        put(batch, position, turned, (0.0, speed, 0.0))
        assert advance(batch)[1] == outcome, (position, turned, speed)
    put(batch, dock + 0.2 * out, yaw)
    advance(batch)
    record = batch.task.records(np.array([0]))[0]
    assert record["final_position_error_m"] == pytest.approx(0.2)
    assert record["final_yaw_error_rad"] == pytest.approx(0.0, abs=1e-9)


def test_the_way_to_the_reference_never_leads_through_the_dock() -> None:
    batch = batch_of("docking")
    dock, rng = batch.task.goal(0), np.random.default_rng(2)
    yaw = float(batch.task.episodes[0].reference_yaw)
    out = -np.array([math.cos(yaw), math.sin(yaw), 0.0])
    before = None
    for angle in np.linspace(0.0, math.pi - 0.01, 721):
        side = rng.normal(size=3) if before is None else side  # noqa: F821
        side -= side @ out * out
        side /= np.linalg.norm(side)
        position = dock + 6.0 * (math.cos(angle) * out + math.sin(angle) * side)
        put(batch, position)
        advance(batch)
        reference = batch.task.reference[0].copy()
        if before is not None:
            assert np.linalg.norm(reference - before) < 0.15, "the reference jumps"
        before = reference
        way = position + np.linspace(0.0, 1.0, 200)[:, None] * (reference - position)
        away = way - dock
        near = (np.linalg.norm(away, axis=1) < 1.0) & (np.linalg.norm(away, axis=1) > 1e-6)
        ahead = np.arccos(np.clip(away[near] @ out / np.linalg.norm(away[near], axis=1).clip(1e-9), -1, 1))
        assert not np.any(ahead > math.radians(30)), math.degrees(angle)


def test_the_reward_of_a_goal_by_its_formula() -> None:
    batch = batch_of("docking", "reward.k=3")
    yaw = float(batch.task.episodes[0].reference_yaw)
    out = -np.array([math.cos(yaw), math.sin(yaw), 0.0])
    # On the axis the way is the distance. The last case is success.
    for distance, end in ((4.0, 0.0), (0.8, 0.0), (0.2, 500.0)):
        batch.task.episodes[0].outcome = -1
        turned = 0.4 if not end else 0.0
        put(batch, batch.task.goal(0) + distance * out, yaw + turned)
        error = math.exp(-distance / 5.0) + 2.0 * math.exp(-distance) + 0.5 * math.exp(-turned / 0.5)
        assert advance(batch)[0] == pytest.approx(3 * (error + end))
    put(batch, batch.task.goal(0) - 0.9 * out, yaw)
    batch.task.episodes[0].outcome = -1
    reward, outcome = advance(batch)
    assert outcome == rows.COLLISION
    assert reward < 0.0


def test_rewards_by_their_formulas() -> None:
    position, yaw = [0.6, -0.8, -20.0], 0.4
    for reward, expected in (
        ("tracking", math.exp(-1.0) + 0.5 * math.exp(-0.4 / 0.5)),
        ("exponential", math.exp(-2.0)),
    ):
        batch = batch_of("station_keeping", f"reward={reward}", "reward.k=3")
        put(batch, position, yaw)
        assert advance(batch)[0] == pytest.approx(3 * expected)
        put(batch, [0.0, 11.0, -20.0], yaw)
        failed = 3 * (math.exp(-11.0) + 0.5 * math.exp(-0.8)) if reward == "tracking" else -1.0
        assert advance(batch)[0] == pytest.approx(failed)
    batch = batch_of("station_keeping", "reward.effort=0.5", "reward.change=0.25")
    put(batch, position, yaw)
    action, before = np.linspace(-1, 1, 8)[None], np.full((1, 8), 0.5)
    batch.task.previous[:] = before
    batch.task.advance(batch.simulator.pose, batch.simulator.velocity, action, action, np.zeros(1))
    cost = 0.5 * np.mean(action**2) + 0.25 * np.mean((action - before) ** 2)
    assert batch.task.reward[0] == pytest.approx(math.exp(-1.0) + 0.5 * math.exp(-0.8) - cost)


def test_the_reward_of_docking_grows_on_the_way_of_the_reference() -> None:
    batch, rng = batch_of("docking"), np.random.default_rng(3)
    yaw, dock = float(batch.task.episodes[0].reference_yaw), batch.task.goal(0)
    for _ in range(20):
        direction = rng.normal(size=3)
        position = dock + 8.0 * direction / np.linalg.norm(direction)
        before, outcome = -math.inf, -1
        while outcome < 0:
            put(batch, position, yaw, [0.2, 0.0, 0.0])
            reward, outcome = advance(batch)
            assert reward > before
            assert batch.task.episodes[0].steps < 550
            to = batch.task.reference[0] - position
            position = position + 0.05 * to / np.linalg.norm(to)
            before = reward
            if np.linalg.norm(position - dock) < 0.1:
                break
        assert np.linalg.norm(position - dock) < 0.1
        batch.reset()
        yaw, dock = float(batch.task.episodes[0].reference_yaw), batch.task.goal(0)


def test_a_vehicle_that_cannot_do_the_task_is_refused_before_anything_starts() -> None:
    config = configs.training("task=docking", "algo=random", "vehicle=lrauv")
    with pytest.raises(ConfigError, match="vehicle=lrauv does not have; use task=waypoint or path_following"):
        check_runnable(config)
    check_runnable(configs.training("task=path_following", "algo=random", "vehicle=lrauv"))


def test_gymnasium_knows_every_task() -> None:
    for name in ("StationKeeping", "TrajectoryTracking", "PathFollowing", "Docking"):
        environment = gymnasium.make(f"auvbench/{name}-v0", vehicle="bluerov2_heavy")
        check_env(environment.unwrapped, skip_render_check=True)
        _, info = environment.reset(seed=1, options={"pose": [1.0, 0.5, -21.0]})
        assert info["pose"][:3].tolist() == [1.0, 0.5, -21.0]
        assert info["reference"].shape == (3,)
        with pytest.raises(ConfigError, match="has its own reference; give only pose"):
            environment.reset(options={"waypoint": [1.0, 2.0, -20.0]})


class StandIn(FossenSimulator):
    """The embedded simulator behind the arguments, the capabilities and the rule of a reset of Gazebo's."""

    capabilities = gazebo.GazeboSimulator.capabilities

    def __init__(self, vehicle, n: int, max_step: float, hydrodynamics: str) -> None:
        super().__init__(vehicle, n, max_step)

    def reset(self, indices, pose, velocity, scales=None) -> None:
        assert not np.any(velocity), "Gazebo starts vehicles at rest"
        super().reset(indices, pose, velocity, scales)


@pytest.mark.slow
@pytest.mark.parametrize(
    "task", [task for task in TASKS if task not in ("transit", "terrain")]
)  # in open water
def test_a_task_asks_no_more_of_a_simulator_than_gazebo_gives(
    task: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gazebo, "GazeboSimulator", StandIn)
    records = []
    for simulator in ("gazebo", "fossen"):
        alone = ["task.vehicles=1"] if task == "formation" else []
        config = configs.training(
            "algo=pid", f"task={task}", HEAVY, "disturbance=moderate", f"simulator={simulator}", *alone
        )
        agent = make(config, sheet.load(config.vehicle))
        episodes = roll_out(config, agent, episodes=np.arange(2), seed=123, batch=2).records
        records.append([{key: row[key] for key in row if key != "simulator"} for row in episodes])
    assert records[0] == records[1]


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["task=docking", "task.observation=[velocty]"], "velocty.*did you mean 'velocity'"),
        (["task.observation=[goal_error]"], "goal_error is not a block of task=waypoint"),
        (["task=docking", "task.observation=[velocity,velocity]"], "velocity occurs twice"),
        (["task=docking", "task.observation=[]"], "at least one block"),
        (["task=docking", "task.position_frame=world"], "position_frame"),
        (["task=docking", "reward=thesis"], "not available for task=docking; use reward=goal or tracking"),
        (["task=path_following", "reward=goal"], "not available for task=path_following; use reward=path"),
        (["reward=path"], "reward.name=path: is not available for task=waypoint; use reward=thesis or goal"),
        (["task=station_keeping", "reward=goal"], "reward.name=goal"),
        (["reward=marinegym_hover"], "not available for task=waypoint"),
        (["task=docking", "reward=gym_auv_path"], "not available for task=docking; use reward=goal"),
        (
            ["disturbance=waves", "disturbance.waves=null"],
            "disturbance.waves=null: disturbance.waves is a group of keys",
        ),
        (["task=docking", "reward=gym_dockauv", "reward.near=20"], "reward.near.*reward.far"),
        (["task=station_keepin"], "did you mean.*station_keeping"),
        (["task=station_keeping", "task.station=[0,0,0]"], "task.station.*depth limits"),
        (["task=docking", "task.start_low=20"], "task.start_low"),
        (["task=trajectory_tracking", "task.curve=spiral"], "task.curve=spiral"),
        (["task=docking", "task.goal_radius=2"], "goal_radius"),
    ],
)
def test_wrong_tasks_are_refused_in_one_line(overrides: list[str], words: str) -> None:
    with pytest.raises(ConfigError, match=words) as caught:
        configs.training(*overrides)
    assert "\n" not in str(caught.value)


def test_the_lines_that_numba_reads_of_a_generated_function_are_python() -> None:
    """From Python 3.13 on, `inspect` begins at the function's line in the file that the function is said to be from."""
    task = Batch(configs.training("algo=pid"), 1).task
    for function in (task._observe, task.loops.draw, task.loops.step):
        code = function.py_func.__code__
        inspect.getblock(linecache.getlines(code.co_filename)[code.co_firstlineno - 1 :])
