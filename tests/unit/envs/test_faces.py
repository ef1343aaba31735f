"""What other people's programs meet: Gymnasium's conventions, kept by all faces of the batch."""

from __future__ import annotations

import copy
import pickle

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import auvbench
from auvbench.envs import gym_env, sb3, settings, vector_env
from auvbench.envs.batch import Batch
from auvbench.envs.vector_env import AuvVectorEnv
from auvbench.errors import ActionError, AuvbenchWarning, ConfigError
from auvbench.simulators import fossen

ID = "auvbench/Waypoint-v1"
SHORT = ["task.max_steps=7", "task.waypoint_low=[-4,-4,-24]", "task.waypoint_high=[4,4,-16]"]
KEYS = {"pose", "waypoint", "distance", "is_success"}


def plan(steps: int, n: int) -> np.ndarray:
    return np.random.default_rng(0).uniform(-1, 1, (steps, n, 6)).astype(np.float32)


def assert_same(a, b, where="info"):
    """Equal keys, kinds and values, however deep."""
    if isinstance(a, dict):
        assert a.keys() == b.keys(), where
        for key in a:
            assert_same(a[key], b[key], f"{where}[{key!r}]")
    elif isinstance(b, np.ndarray) and b.dtype == object:  # Gymnasium's final_obs
        for x, y in zip(a, b, strict=True):
            np.testing.assert_array_equal(x, np.zeros_like(x) if y is None else y, err_msg=where)
    else:
        assert np.asarray(a).dtype == np.asarray(b).dtype, where
        np.testing.assert_array_equal(a, b, err_msg=where)


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_the_vector_environment_is_gymnasiums_own_around_single_ones(mode):
    ours = gymnasium.make_vec(ID, num_envs=3, overrides=SHORT, autoreset_mode=mode)
    theirs = SyncVectorEnv(
        [lambda: gymnasium.make(ID, overrides=SHORT).unwrapped for _ in range(3)], autoreset_mode=mode
    )
    seeds = [5, 2**40, 7]
    for a, b in zip(ours.reset(seed=seeds), theirs.reset(seed=seeds), strict=True):
        assert_same(a, b)
    ended = 0
    for action in plan(40, 3):
        got, expected = ours.step(action), theirs.step(action)
        for a, b in zip(got, expected, strict=True):
            assert_same(a, b)
        ended += int((got[2] | got[3]).sum())
    assert ended > 10
    assert ours.metadata["autoreset_mode"] is ours.autoreset_mode is mode
    assert ours.spec.id == ID


def test_without_automatic_reset_a_mask_says_who_begins():
    env = AuvVectorEnv(3, "task.max_steps=7", autoreset_mode="DISABLED")
    with pytest.raises(ResetNeeded, match="environment 0 and 2 others"):
        env.step(np.zeros((3, 6)))
    env.reset(seed=1)
    for action in plan(7, 3):
        *_, truncated, info = env.step(action)
    assert truncated.all()
    assert info["record"]["steps"].tolist() == [7, 7, 7]
    with pytest.raises(ResetNeeded, match="call reset"):
        env.step(np.zeros((3, 6)))
    before = env.batch.state.pose.copy()
    mask = np.array([False, True, False])
    _, info = env.reset(options={"reset_mask": mask})
    assert info["_pose"].tolist() == mask.tolist()
    np.testing.assert_array_equal(env.batch.state.pose[[0, 2]], before[[0, 2]])
    np.testing.assert_array_equal(info["pose"][1, :3], [0, 0, -20])
    for bad in (np.array([True]), np.array([1, 0, 0]), np.zeros(3, dtype=bool)):
        with pytest.raises(ConfigError, match="reset_mask"):
            env.reset(options={"reset_mask": bad})


@pytest.mark.slow
def test_automatic_reset_is_the_same_on_threads_and_with_disturbances(monkeypatch):
    monkeypatch.setattr(fossen, "THREADED", 8)
    for disturbance in ("none", "severe"):
        overrides = [*SHORT, f"disturbance={disturbance}"]
        one = AuvVectorEnv(20, overrides)
        three = AuvVectorEnv(20, [*overrides, "simulator.threads=3"])
        assert len(three.batch.simulator.each(lambda start, stop: stop)) > 1
        assert_same(one.reset(seed=4)[0], three.reset(seed=4)[0])
        three = pickle.loads(pickle.dumps(three))  # its threads stay behind
        for action in plan(30, 20):
            for a, b in zip(one.step(action), copy.deepcopy(three).step(action), strict=True):
                assert_same(a, b)
            three.step(action)
        seeds = list(range(20))
        assert_same(one.reset(seed=seeds)[0], three.reset(seed=seeds)[0])


@pytest.mark.parametrize("task", ["waypoint", "path_following"])
@pytest.mark.parametrize("again", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_goes_on_by_itself_as_the_original_does(task, again):
    made = [AuvVectorEnv(3, [f"task={task}", "task.max_steps=7", "disturbance=severe"]) for _ in range(2)]
    plain, original = made
    for env in made:
        env.reset(seed=3)
    copied = again(original)
    for k, action in enumerate(plan(10, 3)):
        expected = copy.deepcopy(plain.step(action))
        for a, b in zip(expected, copied.step(action), strict=True):
            assert_same(a, b)
        if k % 2:
            copied = again(copied)
    original.step(plan(1, 3)[0])
    assert original.batch.task.episodes.steps.tolist() == [1, 1, 1]


def test_gymnasiums_wrappers_accept_it():
    from gymnasium.wrappers import vector as wrappers

    envs = gymnasium.make_vec(ID, num_envs=2, overrides=SHORT)
    envs = wrappers.RecordEpisodeStatistics(envs)
    envs = wrappers.NormalizeReward(wrappers.NormalizeObservation(wrappers.RescaleAction(envs, -2.0, 2.0)))
    envs = wrappers.NumpyToTorch(envs)
    observation, _ = envs.reset(seed=1)
    assert isinstance(observation, torch.Tensor)
    for action in plan(8, 2):
        *_, info = envs.step(torch.as_tensor(action))
    assert isinstance(info["pose"], torch.Tensor)
    same = wrappers.NumpyToTorch(AuvVectorEnv(2, SHORT, autoreset_mode="SAME_STEP"))
    same.reset(seed=1)
    for action in plan(7, 2)[:, :, :]:
        *_, info = same.step(torch.as_tensor(action))
    assert isinstance(info["final_info"]["record"]["return"], torch.Tensor)


def test_time_limits_are_known():
    env = gymnasium.make(ID)
    assert env.spec.max_episode_steps == gymnasium.spec(ID).max_episode_steps == 1000
    timed = gymnasium.wrappers.TimeAwareObservation(env)
    assert timed.reset(seed=0)[0].shape == (20,)
    short = gymnasium.make(ID, max_episode_steps=3)
    short.reset(seed=0)
    assert [short.step(np.zeros(6, np.float32))[3] for _ in range(3)] == [False, False, True]
    envs = gymnasium.make_vec(ID, num_envs=2, max_episode_steps=3)
    envs.reset(seed=0)
    for _ in range(3):
        *_, truncated, info = envs.step(np.zeros((2, 6)))
    assert truncated.all()
    assert info["record"]["outcome"].tolist() == [2, 2]
    with pytest.raises(ConfigError, match="max_episode_steps=0"):
        gymnasium.make_vec(ID, max_episode_steps=0)


def test_an_episode_that_gymnasiums_limit_cuts_short_is_told():
    env = gymnasium.make(
        ID, overrides=["task.max_steps=1500", "task.goal_radius=0.001", "step.frequency=1000"]
    )
    env.reset(seed=0)
    for _ in range(1000):
        *_, truncated, _ = env.step(np.zeros(6, np.float32))
    assert truncated
    with pytest.warns(AuvbenchWarning, match="max_episode_steps=1500"):
        env.reset()


def test_info_has_the_same_keys_from_all_faces():
    single, vector, stable = (
        gymnasium.make(ID, overrides=SHORT),
        AuvVectorEnv(2, SHORT),
        sb3.make(2, overrides=SHORT),
    )
    _, a = single.reset(seed=1)
    _, b = vector.reset(seed=1)
    stable.seed(1)
    stable.reset()
    assert a.keys() == {key for key in b if not key.startswith("_")} == stable.reset_infos[0].keys() == KEYS
    for action in plan(7, 2):
        *_, a = single.step(action[0])
        *_, b = vector.step(action)
        c = stable.step(action)[3][0]
    assert a.keys() == {key for key in b if not key.startswith("_")} == KEYS | {"record"}
    assert c.keys() == KEYS | {"record", "episode", "terminal_observation", "TimeLimit.truncated"}
    assert a["record"] == c["record"] == {key: b["record"][key][0] for key in a["record"]}
    assert all(isinstance(value, int | float) for value in a["record"].values())
    np.testing.assert_array_equal(a["pose"], b["pose"][0])
    np.testing.assert_allclose(np.linalg.norm(a["waypoint"] - a["pose"][:3]), a["distance"])


def test_success_is_told():
    env = gymnasium.make(ID)
    env.reset(seed=0, options={"distance": 3.1, "pose": [0, 0, -20, 0]})
    line = env.unwrapped.batch.state
    ahead = (line.reference[0] - line.pose[0, :3]) / line.distance[0]
    env.reset(options={"waypoint": [0, 0, -16.99]})  # it rises by itself
    for _ in range(300):
        _, reward, terminated, _, info = env.step(np.zeros(6, np.float32))
        assert info["is_success"] == terminated
        if terminated:
            break
    assert terminated
    assert reward == 500
    assert info["record"]["outcome"] == 0
    assert np.isfinite(ahead).all()


def test_sb3_infos_are_not_shared():
    for detailed in (True, False):
        env = sb3.AuvVecEnv(Batch(settings.configuration(overrides=SHORT), 3), detailed=detailed)
        env.reset()
        _, _, _, infos = env.step(np.zeros((3, 6), np.float32))
        infos[0]["mine"] = 1
        assert "mine" not in infos[1]
        assert "mine" not in env.step(np.zeros((3, 6), np.float32))[3][0]
    assert env.get_attr("spec")[0].id == ID
    assert env.get_attr("spec")[2].max_episode_steps == 7
    env.seed(2**35)
    env.set_options({"distance": 5.0})
    env.reset()
    np.testing.assert_allclose(env.batch.state.distance, 5.0)


def test_options_place_vehicle_and_waypoint():
    env = gymnasium.make(ID).unwrapped
    _, drawn = env.reset(seed=3)
    _, info = env.reset(seed=3, options={"distance": 12.5})
    assert info["distance"] == pytest.approx(12.5)
    line, moved = drawn["waypoint"] - drawn["pose"][:3], info["waypoint"] - info["pose"][:3]
    np.testing.assert_allclose(line / np.linalg.norm(line), moved / np.linalg.norm(moved))
    np.testing.assert_array_equal(drawn["pose"], info["pose"])
    observation, info = env.reset(options={"pose": [1, 2, -10, np.pi / 2], "waypoint": (1, 12, -10)})
    np.testing.assert_allclose(info["pose"], [1, 2, -10, np.sqrt(0.5), 0, 0, np.sqrt(0.5)])
    # In axes that turn with the yaw reading; thesis noise.
    np.testing.assert_allclose(observation[:4], [10, 0, 0, 0], atol=1.1)
    assert observation[3] == pytest.approx(0.0, abs=0.1)
    _, _, _, _, info = env.step(np.ones(6))
    assert info["distance"] < 10.1
    envs = AuvVectorEnv(2)
    _, info = envs.reset(seed=1, options={"waypoint": [[5, 0, -20], [0, 5, -20]]})
    np.testing.assert_array_equal(info["waypoint"], [[5, 0, -20], [0, 5, -20]])
    for options, message in (
        ({"wayponit": [0, 0, 0]}, "did you mean 'waypoint'"),
        ({"waypoint": [0, 0]}, "has shape"),
        ({"waypoint": [0, np.nan, 0]}, "finite"),
        ({"waypoint": [1e5, 0, -20]}, "the bounds of the observation"),
        ({"waypoint": [1, 0, -20], "distance": 3}, "leave it out"),
        ({"distance": -1}, "more than 0"),
        ({"distance": "far"}, "must be numbers"),
        ({"pose": [0, 0, 5, 0]}, "must be within -60 and -1"),
        ({"pose": [0, 0, -5, 0, 0, 0, 0]}, "quaternion is 0"),
    ):
        with pytest.raises(ConfigError, match=message):
            env.reset(options=options)


@pytest.mark.slow
def test_what_is_no_action_is_refused_and_nothing_moves(monkeypatch):
    monkeypatch.setattr(fossen, "THREADED", 2)
    single = gymnasium.make(ID).unwrapped
    single.reset(seed=0)
    bad = np.zeros((4, 6), dtype=np.float32)
    for value in (np.nan, np.inf, -np.inf):
        bad[2, 3] = value
        for extra in ((), ("simulator.threads=2",), ("simulator.threads=2", "disturbance=severe")):
            batch = Batch(settings.configuration(overrides=extra), 4)
            batch.reset()
            before = batch.state_dict()
            with pytest.raises(ActionError, match=r"environment 2 is \(0, 0, 0, -?(nan|inf), 0, 0\)"):
                batch.step(bad)
            for key, held in batch.state_dict().items():
                np.testing.assert_array_equal(held, before[key], err_msg=key)
        with pytest.raises(ValueError, match="must be finite"):
            single.step(bad[2])
    for wrong in (0.5, np.zeros(5), np.zeros((1, 6)), np.zeros((6, 1))):
        with pytest.raises(ActionError, match="must be"):
            single.step(wrong)
    with pytest.raises(ActionError, match="must be numbers"):
        single.step(np.array(["a"] * 6))
    observation, *_ = single.step([0, 0, 0, 0, 0, 0])
    assert np.isfinite(observation).all()


def test_who_steps_before_reset_or_after_the_end_is_told():
    env = gymnasium.make(ID, overrides=SHORT).unwrapped
    with pytest.raises(ResetNeeded):
        env.step(np.zeros(6))
    env.reset(seed=0)
    for _ in range(7):
        env.step(np.zeros(6))
    with pytest.raises(ResetNeeded):
        env.step(np.zeros(6))
    with pytest.raises(ResetNeeded):
        sb3.make(2).step(np.zeros((2, 6)))


def test_seeds_of_any_size():
    env = gymnasium.make(ID).unwrapped
    a, _ = env.reset(seed=2**32 + 1)
    b, _ = env.reset(seed=2**32 + 1)
    c, _ = env.reset(seed=1)
    np.testing.assert_array_equal(a, b)
    assert not np.array_equal(a, c)
    assert env.np_random_seed == 1
    envs = AuvVectorEnv(2)
    lists, _ = envs.reset(seed=[1, 2**32 + 1])
    np.testing.assert_array_equal(lists, [c, a])
    again, _ = envs.reset(seed=[None, 1])
    np.testing.assert_array_equal(again[1], c)
    assert not np.array_equal(again[0], c)
    for seed, message in ((-1, "at least 0"), (1.5, "whole number")):
        with pytest.raises(ConfigError, match=message):
            env.reset(seed=seed)
    with pytest.raises(ConfigError, match="3 seeds for 2 environments"):
        envs.reset(seed=[1, 2, 3])


@pytest.mark.slow
def test_the_thesis_cells_have_ids():
    env = gymnasium.make("auvbench/Waypoint-K40-25Hz-v0", vehicle="rexrov").unwrapped
    assert env.config.reward.k == 40
    assert env.config.step.frequency == 25
    assert env.config.vehicle["name"] == "rexrov"
    cells = [name for name in gymnasium.registry if name.startswith("auvbench/Waypoint-K")]
    assert len(cells) == 9
    assert (
        gymnasium.make_vec(
            "auvbench/Waypoint-K100-55Hz-v0", 2, overrides="noise=none"
        ).unwrapped.config.reward.k
        == 100
    )
    # What is typed has the last word.
    assert (
        gymnasium.make("auvbench/Waypoint-K1-10Hz-v0", overrides="reward.k=3").unwrapped.config.reward.k == 3
    )


@pytest.mark.slow
def test_the_observation_space_holds_what_happens_and_scales():
    for overrides in ("", "disturbance=severe", "vehicle=rexrov task.position_frame=body", "vehicle=lrauv"):
        env = gymnasium.make(ID, overrides=overrides)
        scaled = gymnasium.wrappers.RescaleObservation(env, np.float32(-1), np.float32(1))
        assert (env.observation_space.high < 1000).all()
        n_u = env.action_space.shape[0]
        farthest = 0.0
        for direction in (1, -1):
            observation, _ = scaled.reset(seed=4)
            action = direction * np.ones(n_u, dtype=np.float32)
            if n_u == 6:
                action[4:] = 0  # the BlueROV2's vertical thrusters
            over = False
            while not over:
                assert scaled.observation_space.contains(observation), overrides
                assert env.observation_space.contains(env.unwrapped.batch.task.observation[0])
                farthest = max(farthest, float(np.abs(observation[1:4]).max()))
                observation, _, terminated, truncated, _ = scaled.step(action)
                over = terminated or truncated
        assert farthest > 0.1, "a bound that nothing comes near scales everything to 0"


def test_a_second_environment_composes_no_configuration(monkeypatch):
    gymnasium.make(ID, k=17)
    monkeypatch.delattr(settings, "_compose")
    assert gymnasium.make(ID, k=17).unwrapped.config.reward.k == 17


def test_the_batch_shares_its_memory():
    batch = Batch(settings.configuration(), 4)
    batch.reset()
    result = batch.step(np.zeros((4, 6), dtype=np.float32))
    tensor = torch.from_dlpack(result.observation)
    assert tensor.data_ptr() == result.observation.ctypes.data
    held = tensor.clone()
    batch.step(np.ones((4, 6), dtype=np.float32))
    assert not torch.equal(held, tensor)


def test_importing_registers_once():
    auvbench.register()
    auvbench.register()
    assert gymnasium.spec(auvbench.ID).max_episode_steps == 1000


def test_programs_may_use_the_earlier_names() -> None:
    assert gym_env.WaypointEnv is gym_env.AuvEnv
    assert vector_env.WaypointVectorEnv is vector_env.AuvVectorEnv
    assert sb3.WaypointVecEnv is sb3.AuvVecEnv
