"""PettingZoo's checks of a team environment, and its bits."""

from __future__ import annotations

import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded

import auvbench
from auvbench.envs import sb3
from auvbench.envs.batch import Batch
from auvbench.envs.gym_env import AuvEnv
from auvbench.envs.parallel_env import AuvParallelEnv
from auvbench.errors import ActionError, ConfigError
from tests import configs

ID, HEAVY = "auvbench/Formation-v0", "bluerov2_heavy"


@pytest.fixture
def env() -> AuvParallelEnv:
    return auvbench.parallel_env(ID, ["task.time_limit=2"], vehicle=HEAVY)


def test_pettingzoos_checks_pass(env: AuvParallelEnv) -> None:
    test = pytest.importorskip("pettingzoo.test")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # numba's, when this test is the first to compile a function (pyproject.toml ignores it elsewhere)
        warnings.filterwarnings("ignore", ".*has been considered a subtype of")
        test.parallel_api_test(env, num_cycles=50)
        test.parallel_seed_test(lambda: auvbench.parallel_env(ID, ["task.time_limit=2"], vehicle=HEAVY))


def test_it_has_the_bits_of_a_batch(env: AuvParallelEnv) -> None:
    batch = Batch(configs.training("task=formation", f"vehicle={HEAVY}", "task.time_limit=2"), 2, seed=7)
    first, infos = env.reset(seed=7)
    np.testing.assert_array_equal(np.stack([*first.values()]), batch.reset()[:3])
    assert [*infos["vehicle_1"]] == ["pose", "reference", "distance", "is_success"]
    rng, ended = np.random.default_rng(0), []
    while not ended:
        actions = rng.uniform(-0.2, 0.2, (6, 8)).astype(np.float32)
        result = batch.step(actions)
        ended = result.records
        seen, rewards, terminated, truncated, infos = env.step(dict(zip(env.agents, actions, strict=False)))
        last = result.final_observation if ended else result.observation
        np.testing.assert_array_equal(np.stack([*seen.values()]), last[:3])
        assert [*rewards.values()] == result.reward[:3].tolist()
    assert env.agents == []
    assert [*truncated.values()] == [True] * 3
    assert not any(terminated.values())
    assert infos["vehicle_2"]["record"]["formation_error_rms_m"] == ended[0]["formation_error_rms_m"]
    assert env.observation_space("vehicle_2").contains(seen["vehicle_2"])
    with pytest.raises(ResetNeeded):
        env.step({})
    again, _ = env.reset()
    assert not np.array_equal(again["vehicle_0"], first["vehicle_0"])


def test_the_state_is_the_truth_of_all_vehicles(env: AuvParallelEnv) -> None:
    with pytest.raises(ResetNeeded):
        env.state()
    _, infos = env.reset(seed=1)
    state = env.state().reshape(3, 19)
    assert env.state_space.contains(state.ravel())
    for j, about in enumerate(infos.values()):
        np.testing.assert_array_equal(state[j, :7], about["pose"].astype(np.float32))
        np.testing.assert_array_equal(state[j, 13:16], about["reference"].astype(np.float32))


def test_wrong_ids_actions_and_interfaces_are_refused(env: AuvParallelEnv) -> None:
    with pytest.raises(
        ConfigError,
        match=r"auvbench/Waypoint-v1: is not the id of a team's environment; .*auvbench/Formation-v0",
    ):
        auvbench.parallel_env("auvbench/Waypoint-v1")
    with pytest.raises(ConfigError, match=r"task.vehicles=9: must be at least 1 and at most 8"):
        auvbench.parallel_env(ID, vehicles=9)
    with pytest.raises(ConfigError, match=r"config: is a complete configuration; leave out task.vehicles=2"):
        auvbench.parallel_env(ID, config=env.config, vehicles=2)
    with pytest.raises(
        ConfigError, match=r"auvbench/Formation-v0: task=waypoint is another task; must be task=formation"
    ):
        auvbench.parallel_env(ID, ["task=waypoint"])
    with pytest.raises(ConfigError, match=r"task.vehicles=3: this interface has one vehicle in an episode"):
        AuvEnv(task="formation")
    assert ID not in gymnasium.registry
    env.reset(seed=1)
    with pytest.raises(
        ActionError, match=r"actions of vehicle_0: must have an action of vehicle_0, vehicle_1, vehicle_2"
    ):
        env.step({"vehicle_0": np.zeros(8, np.float32)})
    with pytest.raises(ActionError, match=r"the action of vehicle_1 has shape \(7,\): must be \(8,\)"):
        env.step({agent: np.zeros(7 if agent == "vehicle_1" else 8, np.float32) for agent in env.agents})


def test_each_vehicle_is_an_environment_for_learners() -> None:
    environments = sb3.make(2, task="formation", vehicle=HEAVY, overrides=["task.time_limit=2"])
    assert environments.num_envs == 6
    assert environments.reset().shape[0] == 6
    done = np.zeros(6, dtype=bool)
    while not done.any():
        _, _, done, infos = environments.step(np.zeros((6, 8), np.float32))
    assert done.all()
    assert all(about["TimeLimit.truncated"] for about in infos)
