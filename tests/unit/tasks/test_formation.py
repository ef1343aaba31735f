"""Several vehicles in one episode, against their definitions in docs/teams.md, computed by other means."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from auvbench.envs.batch import Batch, Transition
from auvbench.errors import ConfigError
from auvbench.tasks.rows import VEHICLE
from tests import configs

HEAVY = "vehicle=bluerov2_heavy"
N_U = 8


def team(*overrides: str, n: int = 1, seed: int = 5, **options: bool) -> Batch:
    batch = Batch(configs.training("task=formation", HEAVY, *overrides), n, seed=seed, **options)
    batch.reset()
    return batch


def each(batch: Batch, steps: int, seed: int = 1) -> Iterator[Transition]:
    """Push all vehicles the same way in each step, so that rows of different batches are comparable."""
    rng = np.random.default_rng(seed)
    for _ in range(steps):
        yield batch.step(np.tile(rng.uniform(-0.4, 0.4, N_U), (batch.n, 1)))


def play(batch: Batch, steps: int) -> None:
    for _ in each(batch, steps):
        pass


RANGING = "sensors=team", "navigation=ekf_model", "noise=none"
SAME = ("task.curve=lemniscate", "task.size_low=3", "task.size_high=6", "task.speed_low=0.3")


def test_a_team_of_one_has_the_bits_of_trajectory_tracking() -> None:
    alone = Batch(
        configs.training("task=trajectory_tracking", HEAVY, *SAME, "disturbance=moderate"), 3, seed=5
    )
    one = Batch(
        configs.training(
            "task=formation",
            *(HEAVY, *SAME, "disturbance=moderate", "task.vehicles=1", "task.speed_high=0.8"),
            "task.observation=[position_error,yaw_error,velocity_error,velocity,angular_velocity,gravity,preview,previous_action]",
        ),
        3,
        seed=5,
    )
    np.testing.assert_array_equal(one.reset(), alone.reset())
    for mine, theirs in zip(each(one, 30), each(alone, 30), strict=True):
        np.testing.assert_array_equal(mine.observation, theirs.observation)
        np.testing.assert_array_equal(mine.reward, theirs.reward)
    np.testing.assert_array_equal(one.simulator.pose, alone.simulator.pose)
    np.testing.assert_array_equal(one.task.episodes.reference, alone.task.episodes.reference)
    record, other = one.task.measured(0), alone.task.measured(0)
    for name in other.keys() & record.keys():
        assert record[name] == other[name], name


def test_the_leader_of_a_team_meets_the_scenario_of_a_vehicle_alone() -> None:
    alone, three = team("task.vehicles=1", n=2), team("task.vehicles=3", n=2)
    np.testing.assert_array_equal(three.simulator.pose[::3], alone.simulator.pose)
    np.testing.assert_array_equal(three.task.reference[::3], alone.task.reference)
    # One vehicle of a team has another start and other noise than the next one.
    away = three.simulator.pose[:, :3] - three.task.reference
    assert len(np.unique(away.round(9), axis=0)) == 6


def test_slots_turn_with_the_leaders_course() -> None:
    batch = team("task.vehicles=4", "task.curve=circle", "noise=none")
    before = batch.task.reference.copy()
    velocity, ahead = batch.task.episodes.reference_velocity.copy(), batch.task.preview.copy()
    slots = 2.5 * np.array([[0, 0, 0], [-1, 1, 0], [-1, -1, 0], [-2, 0, 0]])
    for _ in range(6):
        e = batch.task.episodes
        np.testing.assert_allclose(e.reference_yaw, e.reference_yaw[0], atol=1e-12)
        turned = Rotation.from_euler("z", e.reference_yaw[0]).apply(slots)
        np.testing.assert_allclose(batch.task.reference - batch.task.reference[0], turned, atol=1e-9)
        previous = batch.task.reference.copy()
        batch.step(np.zeros((4, N_U)))
    moved = (previous - before) / 0.5  # in five steps
    np.testing.assert_allclose(moved, velocity, atol=0.02)
    # The first point of the preview is 0.5 s ahead.
    np.testing.assert_allclose(previous, ahead[:, 0], atol=1e-9)


def test_teams_share_the_water_and_not_the_noise() -> None:
    batch = team("disturbance=current", "disturbance.current.speed=0.5", n=2)
    top = batch.disturbances["current"].field["top"]
    assert len(np.unique(top, axis=0)) == 2
    np.testing.assert_array_equal(top[:3], top[[0, 0, 0]])
    environments = batch.task.episodes.environment
    assert environments.tolist() == [0, VEHICLE, 2 * VEHICLE, 1, 1 + VEHICLE, 1 + 2 * VEHICLE]


def test_a_team_ends_together_and_records_what_happened() -> None:
    """Distances and errors of a played episode, computed again from the poses."""
    batch = team("task.time_limit=2", "noise=none", n=2)
    apart, errors, separation = [], [], []
    for result in each(batch, 20):
        if result.records:
            break
        pose, aim = batch.simulator.pose[:3, :3].copy(), batch.task.reference[:3].copy()
        errors.append(
            [
                np.linalg.norm((pose[i] - pose[j]) - (aim[i] - aim[j]))
                for i, j in itertools.combinations(range(3), 2)
            ]
        )
        separation.append(
            min(np.linalg.norm(pose[i] - pose[j]) for i, j in itertools.combinations(range(3), 2))
        )
        apart.append(np.linalg.norm(pose - aim, axis=1))
    assert result.ended.tolist() == [0, 1, 2, 3, 4, 5]
    assert result.truncated.all()
    record = result.records[0]
    assert result.records[1] is record
    assert result.records[3]["environment"] == 1
    assert record["outcome"] == "success"
    assert record["steps"] == 20
    # The last step's poses are those of the next episode, so the sums are compared with its part left out.
    pose, aim = result.final_state.pose[:3, :3], result.final_state.reference[:3]
    errors.append(
        [
            np.linalg.norm((pose[i] - pose[j]) - (aim[i] - aim[j]))
            for i, j in itertools.combinations(range(3), 2)
        ]
    )
    apart.append(np.linalg.norm(pose - aim, axis=1))
    squared = np.square(errors).mean(axis=0)
    assert record["formation_error_rms_m"] == pytest.approx(math.sqrt(squared.mean()))
    assert record["worst_edge_rms_m"] == pytest.approx(math.sqrt(squared.max()))
    assert record["separation_min_m"] <= min(separation)
    assert record["position_error_rms_m"] == pytest.approx(np.sqrt(np.square(apart).mean(axis=0)).mean())
    assert record["vehicles_collided"] == 0


@pytest.mark.parametrize(
    ("change", "outcome", "collided"),
    [
        ("meet", "collision", 1),
        ("flip", "out_of_bounds", 0),
        ("lose", "out_of_bounds", 0),
        ("surface", "collision", 0),
    ],
)
def test_the_end_of_one_vehicle_is_the_end_of_its_team(change: str, outcome: str, collided: int) -> None:
    batch = team("noise=none", "reward.failure=-10", n=2)
    pose = batch.simulator.pose
    if change == "meet":
        pose[4, :3] = pose[3, :3] + [0.0, 0.0, 0.6]
    elif change == "flip":
        pose[5, 3:] = [0.0, 1.0, 0.0, 0.0]
    elif change == "lose":
        pose[5, :3] += [0.0, 0.0, -6.0]
    else:
        pose[5, 2] = -0.5
    result = batch.step(np.zeros((6, N_U)))
    assert result.ended.tolist() == [3, 4, 5]
    assert result.terminated.tolist() == [False] * 3 + [True] * 3
    assert [record["outcome"] for record in result.records] == [outcome] * 3
    assert result.records[0]["vehicles_collided"] == collided
    assert result.records[0]["formation_error_rms_m"] == 5.0
    if change == "meet":
        assert result.records[0]["separation_min_m"] < 0.7
    assert (result.reward[3:] < 0.0).all()
    assert (result.reward[:3] > 0.0).all()
    assert (batch.task.episodes.episode == [0, 0, 0, 1, 1, 1]).all()


def told(batch: Batch) -> np.ndarray:
    """Messages (n, others, 7) as observed."""
    return batch.task.observation[:, batch.task.spec["messages"]].reshape(batch.n, batch.team - 1, 7)


def seen(batch: Batch, i: int, j: int) -> np.ndarray:
    """Position and velocity of vehicle j, in level axes of vehicle i, from the true states."""
    pose, velocity = batch.simulator.pose, batch.simulator.velocity
    yaw = Rotation.from_quat(np.roll(pose[i, 3:], -1)).as_euler("ZYX")[0]
    level = Rotation.from_euler("z", -yaw)
    world = Rotation.from_quat(np.roll(pose[j, 3:], -1)).apply(velocity[j, :3])
    return np.concatenate([level.apply(pose[j, :3] - pose[i, :3]), level.apply(world)])


def test_ideal_messages_are_the_present_state_of_the_others() -> None:
    batch = team("noise=none", "task.messages=ideal")
    play(batch, 7)
    for i in range(3):
        for row, j in enumerate(j for j in range(3) if j != i):
            np.testing.assert_allclose(told(batch)[i, row, :6], seen(batch, i, j), atol=1e-5)
    assert (told(batch)[:, :, 6] == 0.0).all()


def test_messages_have_the_noise_of_the_readings() -> None:
    batch = team("task.messages=ideal", "task.position_frame=body")
    play(batch, 3)
    e, pose = batch.task.episodes, batch.simulator.pose
    errors = e.said[:, :3] - pose[:, :3]
    assert (np.abs(errors) > 1e-6).all()
    spec = batch.task.spec["position_error"]
    for j in range(3):
        aim = Rotation.from_quat(np.roll(pose[j, 3:], -1)).as_euler("ZYX")[0]
        read = batch.task.observation[j, spec]
        # The yaw reading has noise as well, which the height and the length have not.
        assert read[2] == pytest.approx(e.reference[j, 2] - e.said[j, 2], abs=1e-5), aim
        assert np.hypot(*read[:2]) == pytest.approx(np.hypot(*(e.reference - e.said[:, :3])[j, :2]), abs=1e-5)


def test_acoustic_messages_arrive_in_turn_and_late() -> None:
    """The ages of all messages, from the turns of the vehicles: one speaks each 0.505 s and some milliseconds."""
    batch = team("noise=none")
    config = batch.config.task
    assert config.transmission == pytest.approx(0.105 + 32 * 0.0125)
    turn = config.turn_time
    poses = [batch.simulator.pose[:, :3].copy()]
    for k in range(1, 60):
        batch.step(np.zeros((3, N_U)))
        poses.append(batch.simulator.pose[:, :3].copy())
        now = 0.1 * k
        for i in range(3):
            for row, j in enumerate(j for j in range(3) if j != i):
                way = np.linalg.norm(poses[k][i] - poses[k][j]) / 1500.0
                spoken = [0.0]
                spoken += [
                    t * turn for t in range(j, 99, 3) if t * turn + config.transmission + way <= now + 1e-9
                ]
                age = told(batch)[i, row, 6]
                assert age == pytest.approx(now - spoken[-1], abs=1e-5), (k, i, j)
                # It says where the vehicle was at the step before it spoke.
                at = math.floor(spoken[-1] / 0.1 + 1e-9)
                np.testing.assert_allclose(batch.task.episodes.heard[i, j, :3], poses[at][j], atol=1e-9)


def test_lost_messages_grow_old() -> None:
    never = team("task.message_loss=1")
    play(never, 30)
    np.testing.assert_allclose(told(never)[:, :, 6], 3.0, atol=1e-6)
    ages = []
    for loss in (0.0, 0.5):
        batch = team(f"task.message_loss={loss}", "task.time_limit=20", n=4)
        records = [record for result in each(batch, 200) for record in result.records]
        ages.append(np.mean([record["message_age_s"] for record in records]))
    assert 0.5 < ages[0] < ages[1] < 4.0


def test_a_resumed_team_hears_the_same() -> None:
    whole = team("task.message_loss=0.3", n=2)
    play(whole, 9)
    state = whole.state_dict()
    expected = [result.observation.copy() for result in each(whole, 9, seed=2)]
    fresh = team("task.message_loss=0.3", n=2, seed=8)
    fresh.load_state_dict(state)
    np.testing.assert_array_equal([result.observation.copy() for result in each(fresh, 9, seed=2)], expected)


@pytest.mark.slow
def test_estimates_are_what_vehicles_say() -> None:
    batch = team("sensors=bluerov2", "navigation=ekf", "task.messages=ideal", "noise=none")
    play(batch, 5)
    np.testing.assert_allclose(batch.task.believed.said[:, :3], batch.navigation.pose[:, :3])
    assert not np.allclose(batch.navigation.pose[:, :3], batch.simulator.pose[:, :3])


def test_only_whole_teams_begin() -> None:
    batch = team(n=2)
    for rows in ([0, 1], [1, 2, 3], [2, 1, 0]):
        with pytest.raises(ConfigError, match=r"task.vehicles=3: the vehicles of a team begin together"):
            batch.reset(np.array(rows))


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (["task.vehicles=9"], "task.vehicles=9: must be at least 1 and at most 8"),
        (["task.slots=[[0,0,0],[0,1,0]]"], "task.vehicles=3: must be at most 2, the number of task.slots"),
        (
            ["task.slots=[[0,0],[0,1,0],[1,0,0]]"],
            "must be a list of slots, each of them three finite numbers",
        ),
        (
            ["task.spacing=0.9"],
            "task.spacing=0.9: puts two slots 1.27279 m apart; their distance must be more than 1.7 m",
        ),
        (["task.slots=[[0,0,0],[0,0,8],[1,0,0]]"], "task.slots="),
        (["task.curve=random"], "task.curve=random: unknown"),
        (
            ["task.messages=ideal", "task.message_loss=0.9"],
            "task.message_loss=0.9: messages=ideal loses none",
        ),
        (["step.frequency=0.5"], "step.frequency=0.5: must be at least 0.971 Hz"),
        (
            ["simulator=gazebo"],
            "task.vehicles=3: simulator=gazebo allows one vehicle in an episode; type task.vehicles=1, or another simulator",
        ),
        (["algo=ardusub"], "task.vehicles=3: algo=ardusub allows one vehicle in an episode"),
        (["world=tank"], "task.vehicles=3: world=tank allows one vehicle in an episode"),
        (
            [*RANGING, "sensors.modem.beacons=3"],
            "sensors.modem.beacons=3: must be less than task.vehicles=3: the other vehicles measure their ranges to the beacons",
        ),
        ([*RANGING, "task.messages=ideal"], "sensors.modem: task.messages=ideal has no acoustic messages"),
        ([*RANGING, "task=station_keeping"], "sensors.modem: task=station_keeping has no acoustic messages"),
        ([*RANGING, "navigation=truth"], "sensors=team: navigation=truth reads no sensor"),
        ([*RANGING, "sensors.imu.rate=1"], "sensors.imu.rate=1: must be at least 1.94 Hz"),
    ],
)
def test_what_a_team_cannot_do_is_refused(overrides: list[str], message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        configs.training("task=formation", *overrides)
    assert message in str(caught.value)
