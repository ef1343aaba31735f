"""Published rewards against the formulas of their sources, in the sources' axes. `conf/reward/NAME.yaml` names file and commit."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from auvbench.envs.batch import Batch
from auvbench.envs.settings import configuration
from auvbench.tasks import rows
from tests.reference import solids as oracle
from tests.unit.tasks.test_tasks import batch_of

FLIP = np.diag([1.0, -1.0, -1.0])
"""between FLU and FRD axes; with x and y swapped, between ENU and NED"""


def in_ned(turn: Rotation, *vectors) -> tuple[float, ...]:
    """Return roll, pitch, yaw of a vehicle and vectors, all in the axes (NED, FRD) of the sources."""
    world = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    yaw, pitch, roll = Rotation.from_matrix(world @ turn.as_matrix() @ FLIP).as_euler("ZYX")
    return roll, pitch, yaw, *(world @ np.asarray(vector) for vector in vectors)


def ssa(angle: float) -> float:
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


def judge(batch: Batch, position, turn: Rotation, velocity) -> np.ndarray:
    """Judge a vehicle at a pose and a velocity; return its action."""
    x, y, z, w = turn.as_quat()
    batch.simulator.pose[0], batch.simulator.velocity[0] = [*position, w, x, y, z], velocity
    action = np.array([[0.3, -0.1, 0.5, 0.2, -0.7, 0.1, 0.4, -0.2]])
    batch.task.advance(batch.simulator.pose, batch.simulator.velocity, action, action, np.zeros(1))
    return action


def test_marinegyms_reward_by_the_formula_of_its_source() -> None:
    batch = batch_of("station_keeping", "reward=marinegym_hover", "task.yaw=0.7")
    turn = Rotation.from_euler("ZYX", [0.4, 0.3, -0.5])
    position, velocity = np.array([0.6, -0.8, -20.5]), np.array([0.1, 0.2, 0.3, 0.4, -0.9, 0.8])
    action = judge(batch, position, turn, velocity)
    rpos = np.array([0.0, 0.0, -20.0]) - position
    rheading = np.array([math.cos(0.7), math.sin(0.7), 0.0]) - turn.apply([1.0, 0.0, 0.0])
    distance = np.linalg.norm(np.concatenate([rpos, rheading]))
    pose = 0.5 / (1.0 + (1.2 * distance) ** 2)
    up = ((turn.apply([0.0, 0.0, 1.0])[2] + 1.0) / 2.0) ** 2
    spin = 1.0 / (1.0 + (turn.apply(velocity[3:])[2] ** 2) ** 2)
    assert batch.task.reward[0] == pytest.approx(
        pose + pose * (up + spin) + 0.1 * math.exp(-abs(action.sum()))
    )


def test_gym_auvs_reward_by_the_formula_of_its_source() -> None:
    batch = batch_of("path_following", "reward=gym_auv_path", "reward.k=2")
    for yaw in (-2.0, 0.5, 3.0):
        turn = Rotation.from_euler("ZYX", [yaw, 0.3, -0.5])
        velocity = np.array([0.6, 0.2, -0.3, 0.4, -0.9, 0.8])
        position = batch.task.reference[0] + np.array([1.2, -0.9, 0.7])
        action = judge(batch, position, turn, velocity)
        reference = batch.task.reference[0]
        tangent = batch.task.episodes[0].reference_velocity
        roll, _, _, motion, offset, path = in_ned(
            turn, turn.apply(velocity[:3]), position - reference, tangent
        )
        chi_p, upsilon_p = math.atan2(path[1], path[0]), math.atan2(-path[2], math.hypot(path[0], path[1]))
        epsilon = Rotation.from_euler("ZYX", [chi_p, upsilon_p, 0.0]).inv().apply(offset)
        chi_d = chi_p + math.atan2(-epsilon[1], 3.0)
        upsilon_d = upsilon_p + math.atan2(epsilon[2], math.hypot(epsilon[1], 3.0))
        chi, upsilon = (
            math.atan2(motion[1], motion[0]),
            math.atan2(-motion[2], math.hypot(motion[0], motion[1])),
        )
        errors = ssa(chi - chi_d) / math.pi, ssa(upsilon - upsilon_d) / math.pi
        path_following = -(errors[0] ** 2) - errors[1] ** 2
        expected = 0.6 * path_following - roll**2 - velocity[3] ** 2 - 0.1 * np.sum(action**2)
        assert batch.task.reward[0] == pytest.approx(2.0 * expected)


@pytest.mark.parametrize(
    ("away", "end", "outcome"),
    [
        ([4.0, -3.0, 2.0], 0.0, -1),
        ([0.1, 0.05, -0.1], 400.0, rows.SUCCESS),
        ([0.05, 0.03, 0.6], -300.0, rows.COLLISION),
        ([18.0, 15.0, -2.0], 0.0, -1),
        ([20.0, 16.0, 0.0], -200.0, rows.OUT_OF_BOUNDS),
        ([4.0, -3.0, 2.0], -100.0, rows.TIMEOUT),
    ],
)
def test_gym_dockauvs_reward_by_the_formula_of_its_source(away, end: float, outcome: int) -> None:
    limit = "task.max_steps=" + ("1" if outcome == rows.TIMEOUT else "600")
    batch = batch_of("docking", "reward=gym_dockauv", "task.time_limit=null", "task.speed=2", limit)
    yaw = float(batch.task.episodes[0].reference_yaw)
    turn = Rotation.from_euler("ZYX", [yaw if outcome == rows.SUCCESS else yaw + 2.0, 0.3, -0.5])
    velocity = np.array([0.6, 0.2, -0.3, 0.4, -0.9, 0.8])
    position = batch.task.goal(0) + np.array(away)
    action = judge(batch, position, turn, velocity)
    assert batch.task.outcome[0] == outcome
    roll, pitch, heading, diff = in_ned(turn, -np.array(away))
    d = np.linalg.norm(away)
    delta_theta = pitch + ssa(math.atan2(diff[2], math.hypot(diff[0], diff[1])))
    delta_psi = ssa(math.atan2(diff[1], diff[0]) - heading)
    rate = FLIP @ velocity[3:]
    step = 1e-6
    later = Rotation.from_euler("ZYX", [heading, pitch, roll]) * Rotation.from_rotvec(rate * step)
    euler_dot = (later.as_euler("ZYX") - np.array([heading, pitch, roll])) / step
    log_precision = 1.0 - np.clip(math.log(d / 20.0) / math.log(0.5 / 20.0), 0.0, 1.0)
    expected = (
        -1.1 * log_precision
        - 0.3 * (delta_theta / (math.pi / 2.0)) ** 2
        - 0.5 * (delta_psi / math.pi) ** 2
        - 0.3 * (roll / (math.pi / 2.0)) ** 2
        - 0.3 * (pitch / (math.pi / 2.0)) ** 2
        - 0.2 * (np.linalg.norm(euler_dot) / math.radians(90.0)) ** 2
        - np.sum((np.abs(action) / 8.0) ** 2 * 6.0)
    )
    assert batch.task.reward[0] == pytest.approx(expected + end, abs=1e-5)


def radar(solids, position, turn: Rotation) -> np.ndarray:
    """Return the distances (63,) of the source's rays from a pose, by a march of other distances than the ray caster's."""
    alpha = np.repeat(np.radians(np.arange(-30.0, 31.0, 10.0)), 9)
    beta = np.tile(np.radians(np.arange(-40.0, 41.0, 10.0)), 7)
    rays = np.column_stack([np.ones(63), np.sin(beta), np.sin(alpha)]) @ FLIP
    rays = turn.apply(rays / np.linalg.norm(rays, axis=1, keepdims=True))

    def nearest(points):
        return np.min([oracle.signed_distance(solid, points) for solid in solids], axis=0)

    return oracle.march(nearest, np.tile(position, (63, 1)), rays, np.full(63, 10.0), 1e-9)


def test_gym_dockauvs_term_of_the_obstacles_by_the_formula_of_its_source() -> None:
    words = ("world=gym_dockauv", "task.time_limit=null", "task.bounds=60")
    plain, seeing = (
        batch_of("docking", f"reward={reward}", *words) for reward in ("gym_dockauv", "gym_dockauv_radar")
    )
    rng, terms = np.random.default_rng(2), []
    for _ in range(12):
        turn = Rotation.from_euler("ZYX", rng.uniform([-3.0, -0.6, -0.6], [3.0, 0.6, 0.6]))
        position = plain.task.goal(0) + rng.uniform(-4.0, 4.0, 3)
        for batch in (plain, seeing):
            batch.reset()
            judge(batch, position, turn, np.zeros(6))
        solids = seeing.task.world.solids[0, :4]
        np.testing.assert_array_equal(solids["position"], plain.task.world.solids[0, :4]["position"])
        theta, psi = np.repeat(np.arange(-30, 31, 10), 9), np.tile(np.arange(-40, 41, 10), 7)
        beta = (1.0 - np.abs(theta) / 30.0) * (1.0 - np.abs(psi) / 40.0) + 0.01
        c = np.clip(1.0 - radar(solids, position, turn) / 10.0, 0.0, 1.0)
        term = -0.2 * (beta.sum() / (np.maximum((1.0 - c) ** 2, 0.001) @ beta) - 1.0)
        assert seeing.task.reward[0] - plain.task.reward[0] == pytest.approx(term, abs=1e-6)
        terms.append(term)
    assert min(terms) < -0.1
    assert max(terms) > min(terms) + 0.1


def test_the_scenario_of_gym_dockauv_has_its_numbers() -> None:
    batch = batch_of("gym_dockauv")
    config = configuration(overrides=["task=gym_dockauv", "vehicle=bluerov2_heavy", "algo=pid"])
    assert (config.world.name, config.reward.name, config.task.name) == (
        "pillars",
        "gym_dockauv_radar",
        "docking",
    )
    assert (config.world.vehicle_radius, config.task.tolerance, config.task.bounds) == (0.5, 0.5, 20.0)
    assert config.task.tilt == pytest.approx(math.radians(60.0))
    assert batch.task.spec.blocks["range.ideal"].labels[-1] == "range_ideal_6_8"
    assert float(batch.task.episodes[0].initial_distance) > 0.0
    away = np.linalg.norm(np.array(batch.task.episodes[0].start) - batch.task.goal(0))
    assert away == pytest.approx(15.0)
