"""The batch and its three faces."""

from __future__ import annotations

import contextlib
import os

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env as gymnasium_check
from stable_baselines3.common.env_checker import check_env as sb3_check

import auvbench
from auvbench.envs.batch import Batch
from auvbench.envs.sb3 import AuvVecEnv
from auvbench.simulators import fossen
from tests import configs

assert auvbench.__version__


def configuration(*overrides: str):
    return configs.training(*overrides)


def actions(steps: int, n: int, n_u: int = 6) -> np.ndarray:
    """Actions of environment i do not depend on n."""
    return np.stack([np.random.default_rng(i).uniform(-1, 1, (steps, n_u)) for i in range(n)], axis=1)


def run(batch: Batch, steps: int) -> tuple[np.ndarray, np.ndarray, list]:
    observations, rewards, records = [batch.reset().copy()], [], []
    for action in actions(steps, batch.n):
        result = batch.step(action)
        observations.append(result.observation.copy())
        rewards.append(result.reward.copy())
        records += [(r["environment"], r) for r in result.records]
    return np.array(observations), np.array(rewards), records


def test_the_same_floats_at_any_batch_size():
    config = configuration("task.max_steps=40", "step.frequency=25")
    large = run(Batch(config, 37, seed=5), 130)
    assert len(large[2]) >= 37 * 3, "episodes must have ended and begun anew"
    for n in (1, 2, 16, 17):
        small = run(Batch(config, n, seed=5), 130)
        np.testing.assert_array_equal(small[0], large[0][:, :n])
        np.testing.assert_array_equal(small[1], large[1][:, :n])
        assert small[2] == [row for row in large[2] if row[0] < n]


def test_an_end_is_told_of_once_and_anew_after_a_reset():
    batch = Batch(configuration("task.max_steps=5"), 3, seed=5, test=True, autoreset=False)
    batch.reset()
    told = [batch.step(action).ended.tolist() for action in actions(8, 3)]
    assert told == [[], [], [], [], [0, 1, 2], [], [], []]
    batch.reset(np.array([1]))
    told = [batch.step(action).ended.tolist() for action in actions(7, 3)]
    assert told == [[], [], [], [], [1], [], []]


def test_another_seed_and_a_test_draw_other_scenarios():
    config = configuration()

    def waypoints(**arguments):
        batch = Batch(config, 4, **arguments)
        batch.reset()
        return batch.task.reference.copy()

    base = waypoints(seed=1)
    np.testing.assert_array_equal(base, waypoints(seed=1))
    assert not np.isclose(base, waypoints(seed=2)).any()
    assert not np.isclose(base, waypoints(seed=1, test=True)).any()
    assert np.unique(base).size == base.size


@pytest.mark.slow
@pytest.mark.parametrize("frequency", [10, 25, 55, 7.3])
def test_a_step_lasts_one_over_f_whatever_f(frequency):
    # In still water without thrust the vehicle rises: after the same time by the same height.
    still = ("noise=none", "simulator.max_step=0.002", "task.max_steps=100000", "task.goal_radius=0.001")
    config = configuration(f"step.frequency={frequency}", *still)
    batch = Batch(config, 1)
    batch.reset()
    steps = round(20 * frequency)
    for _ in range(steps):
        batch.step(np.zeros((1, 6)))
    assert batch.task.duration == 1 / frequency
    # Terminal rise 0.1543 m/s, reached within a second or so: the height is almost exactly linear in time.
    reference = Batch(configuration("step.frequency=100", *still), 1)
    reference.reset()
    for _ in range(round(100 * steps / frequency)):
        reference.step(np.zeros((1, 6)))
    assert batch.simulator.pose[0, 2] == pytest.approx(reference.simulator.pose[0, 2], abs=0.1543 * 0.011)


def test_state_restores_to_the_same_bits():
    config = configuration("task.max_steps=30")
    batch = Batch(config, 5, seed=3)
    batch.reset()
    plan = actions(80, 5)
    for action in plan[:37]:
        batch.step(action)
    saved = batch.state_dict()
    expected = [batch.step(action).observation.copy() for action in plan[37:]]
    other = Batch(config, 5, seed=99)
    other.reset()
    other.load_state_dict(saved)
    got = [other.step(action).observation.copy() for action in plan[37:]]
    np.testing.assert_array_equal(expected, got)


@pytest.mark.slow
@pytest.mark.filterwarnings("error")
def test_gymnasium_accepts_the_environment_without_warnings():
    env = gymnasium.make("auvbench/Waypoint-v1", overrides=["task.max_steps=20"])
    gymnasium_check(env.unwrapped)


@pytest.mark.filterwarnings("error")
def test_stable_baselines_accepts_the_environment_without_warnings():
    sb3_check(gymnasium.make("auvbench/Waypoint-v1").unwrapped, warn=True)


def test_vector_environment_is_the_single_one_many_times():
    vector = gymnasium.make_vec("auvbench/Waypoint-v1", num_envs=3, vectorization_mode="vector_entry_point")
    single = gymnasium.make("auvbench/Waypoint-v1")
    observations, _ = vector.reset(seed=11)
    observation, _ = single.reset(seed=11)
    np.testing.assert_array_equal(observations[0], observation)
    for action in actions(50, 3).astype(np.float32):
        observations, rewards, *_ = vector.step(action)
        observation, reward, *_ = single.step(action[0])
        np.testing.assert_array_equal(observations[0], observation)
        assert rewards[0] == reward
    assert vector.observation_space.contains(observations)


def test_episodes_end_and_begin_anew_in_the_same_step():
    env = AuvVecEnv(Batch(configuration("task.max_steps=5"), 4))
    env.reset()
    for step in range(1, 11):
        env.step_async(np.zeros((4, 6), dtype=np.float32))
        observation, _, done, infos = env.step_wait()
        assert done.all() == (step % 5 == 0)
        assert len(env.transition.records) == (4 if step % 5 == 0 else 0)
        if done.all():
            assert all(info["TimeLimit.truncated"] for info in infos)
            assert not np.array_equal(infos[0]["terminal_observation"], observation[0])
            assert infos[0]["episode"]["l"] == 5


def test_a_seed_out_of_range_is_the_users_mistake():
    env = gymnasium.make("auvbench/Waypoint-v1")
    with pytest.raises(auvbench.errors.ConfigError, match="seed=4294967296"):
        env.unwrapped.batch.reseed(1 << 32)


@pytest.mark.slow
@pytest.mark.parametrize("disturbance", ["none", "severe"])
def test_threads_change_neither_floats_nor_saved_states(disturbance, monkeypatch):
    monkeypatch.setattr(fossen, "THREADED", 8)
    overrides = ("task.max_steps=12", f"disturbance={disturbance}")
    one = Batch(configuration(*overrides), 37, seed=5)
    three = Batch(configuration(*overrides, "simulator.threads=3"), 37, seed=5)
    assert three.simulator.each(lambda start, stop: (start, stop)) == [(0, 16), (16, 32), (32, 37)]
    a, b = run(one, 40), run(three, 40)
    np.testing.assert_array_equal(a[0], b[0])
    np.testing.assert_array_equal(a[1], b[1])
    assert a[2] == b[2]
    saved, other = one.state_dict(), three.state_dict()
    assert saved.keys() == other.keys()
    for key in saved:
        np.testing.assert_array_equal(saved[key], other[key], err_msg=key)
    four = Batch(configuration(*overrides, "simulator.threads=4"), 37, seed=99)
    four.reset()
    four.load_state_dict(saved)
    for action in actions(30, 37):
        expected, got = one.step(action), four.step(action)
        np.testing.assert_array_equal(expected.observation, got.observation)
        np.testing.assert_array_equal(expected.ended, got.ended)


def test_threads_serve_batches_for_which_they_pay():
    for n, ranges in ((fossen.THREADED - 1, 1), (fossen.THREADED, 2)):
        batch = Batch(configuration("simulator.threads=2"), n)
        assert len(batch.simulator.each(lambda start, stop: stop - start)) == ranges


def test_of_several_broken_environments_the_first_is_named(monkeypatch):
    monkeypatch.setattr(fossen, "THREADED", 2)
    batch = Batch(configuration("simulator.threads=2"), 64)
    batch.reset()
    batch.simulator.pose[[5, 60], 0] = np.nan
    with pytest.raises(auvbench.errors.TrainingError, match="environment 5 is not finite"):
        batch.step(np.zeros((64, 6)))


@pytest.mark.filterwarnings("ignore:This process .* is multi-threaded:DeprecationWarning")
def test_a_forked_process_has_threads_of_its_own(monkeypatch):
    monkeypatch.setattr(fossen, "THREADED", 2)
    batch = Batch(configuration("simulator.threads=2"), 40)
    batch.reset()
    batch.step(np.zeros((40, 6)))
    child = os.fork()
    if child == 0:
        with contextlib.suppress(BaseException):
            batch.step(np.zeros((40, 6)))
            os._exit(3)
        os._exit(0)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 3
