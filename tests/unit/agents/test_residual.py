"""A learner's action on top of a controller's: what is added, what the learner sees, what is remembered of an episode."""

from __future__ import annotations

import copy
import dataclasses

import numpy as np
import pytest
from omegaconf import OmegaConf

from auvbench.agents.base import make
from auvbench.agents.classical import pid
from auvbench.agents.learned.residual import Base, ResidualAgent, ResidualVecEnv
from auvbench.analysis.labels import title
from auvbench.config import schema
from auvbench.config.compose import read, typed
from auvbench.envs.batch import Batch
from auvbench.envs.sb3 import AuvVecEnv
from auvbench.errors import ConfigError
from auvbench.evaluation.rollout import roll_out
from auvbench.runs.identity import run_id
from auvbench.training.execute import check_runnable
from auvbench.vehicles import sheet
from tests import configs

VEHICLES = (
    *("bluerov2", "bluerov2_realistic_inertia", "bluerov2_wu2018", "bluerov2_heavy"),
    *("bluerov2_heavy_wu2018", "rexrov", "lrauv"),
)


def configured(*overrides: str) -> schema.TrainConfig:
    return configs.training("algo=ppo_residual", *overrides)


def wrapped(config: schema.TrainConfig, n: int) -> ResidualVecEnv:
    batch = Batch(config, n)
    return ResidualVecEnv(AuvVecEnv(batch, detailed=False), Base(config, batch.vehicle))


def state_of(environment: ResidualVecEnv) -> dict[str, dict[str, np.ndarray]]:
    parts = {"batch": environment.venv.batch, "base": environment.base}  # type: ignore[attr-defined]
    return {
        part: {name: np.array(value) for name, value in carrier.state_dict().items()}
        for part, carrier in parts.items()
    }


def own_pid(config: schema.TrainConfig) -> pid.PIDController | pid.FinController:
    return pid.controller(
        dataclasses.replace(config, algo=config.algo.residual.pid), sheet.load(config.vehicle)
    )


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_without_a_residual_the_vehicle_does_what_pid_makes_it_do(vehicle: str) -> None:
    """Over several episodes: PID begins each of them anew, in the very step in which the one before ended."""
    config = configured(f"vehicle={vehicle}", "task.max_steps=40", "disturbance=severe")
    environment = wrapped(config, 3)
    n_u = environment.action_space.shape[0]
    # The same environments one by one, with a PID of their own that is told when an episode ends.
    alone = [Batch(config, 1) for _ in range(3)]
    for i, batch in enumerate(alone):
        batch.task.assign(np.zeros(1), environment=i)
    controllers = [own_pid(config) for _ in range(3)]
    observations = [batch.reset().copy() for batch in alone]
    for controller in controllers:
        controller.reset(np.arange(1))
    seen = environment.reset()
    ends = 0
    for _ in range(130):
        actions = [c.act(o) for c, o in zip(controllers, observations, strict=True)]
        np.testing.assert_array_equal(seen[:, : 4 + n_u], np.concatenate(observations))
        np.testing.assert_array_equal(
            seen[:, 4 + n_u :], np.clip(np.concatenate(actions), -1, 1).astype(np.float32)
        )
        results = [b.step(a) for b, a in zip(alone, actions, strict=True)]
        observations = [result.observation.copy() for result in results]
        seen, _, done, infos = environment.step(np.zeros((3, n_u), dtype=np.float32))
        for i, result in enumerate(results):
            assert done[i] == bool(len(result.ended))
            if done[i]:
                ends += 1
                last = infos[i]["terminal_observation"]
                np.testing.assert_array_equal(last[: 4 + n_u], result.final_observation[0])
                # Of the PID that steered the episode to its end.
                ended = np.clip(controllers[i].act(result.final_observation), -1, 1)[0]
                np.testing.assert_array_equal(last[4 + n_u :], ended.astype(np.float32))
                controllers[i].reset(np.arange(1))
    assert ends >= 9


def test_the_share_bounds_what_is_added() -> None:
    config = configured("algo.residual.share=0.25")
    base = Base(config, sheet.load(config.vehicle))
    base.reset(500)
    rng = np.random.default_rng(0)
    for _ in range(4):
        base.extend(rng.normal(0, 20, (500, 10)).astype(np.float32))
        residual = rng.uniform(-3, 3, (500, 6)).astype(np.float32)
        action = base.compose(residual)
        assert np.abs(action).max() <= 1.0
        assert np.abs(action - base.action).max() <= 0.25 + 1e-12
        inside = np.abs(base.action) < 0.7
        exact = base.action + 0.25 * np.clip(residual.astype(float), -1, 1)
        np.testing.assert_allclose(action[inside], exact[inside], atol=1e-12)
    assert (np.abs(base.action) > 0.9).any(), "PID asks for nearly all there is somewhere"


def test_a_state_saved_in_mid_episode_goes_on_with_the_same_bits() -> None:
    config = configured("task.max_steps=30", "disturbance=severe")
    first, second = wrapped(config, 5), wrapped(config, 5)
    rng = np.random.default_rng(1)
    actions = rng.uniform(-1, 1, (90, 5, 6)).astype(np.float32)
    first.reset()
    for action in actions[:40]:
        first.step(action)
    state = state_of(first)
    second.reset()
    second.venv.batch.load_state_dict(state["batch"])  # type: ignore[attr-defined]
    second.base.load_state_dict(state["base"])
    for action in actions[40:]:
        one, other = first.step(action), second.step(action)
        np.testing.assert_array_equal(one[0], other[0])
        np.testing.assert_array_equal(one[1], other[1])
    after = state_of(second)
    for part, arrays in state_of(first).items():
        for name, value in arrays.items():
            np.testing.assert_array_equal(value, after[part][name])


def test_where_episodes_begin_again_pid_does_too() -> None:
    config = configured()
    environment = wrapped(config, 2)
    environment.reset()
    for _ in range(20):
        environment.step(np.ones((2, 6), dtype=np.float32))
    first = np.random.default_rng(2).normal(0, 10, (2, 10)).astype(np.float32)
    seen = environment.begin(first)
    fresh = own_pid(config)
    fresh.reset(np.arange(2))
    np.testing.assert_array_equal(seen[:, :10], first)
    np.testing.assert_array_equal(seen[:, 10:], np.clip(fresh.act(first), -1, 1).astype(np.float32))


class Push:
    """A policy that answers to all that it observes."""

    def reset(self, episodes: np.ndarray) -> None:
        pass

    def act(self, observation: np.ndarray) -> np.ndarray:
        assert observation.shape[1] == 16
        return np.sin(observation[:, 10:] * 3.0 + observation[:, 1:2])


@pytest.mark.slow
def test_rows_of_a_test_do_not_depend_on_the_batch() -> None:
    config = configured("task.max_steps=120")
    tables = []
    for batch in (24, 7, 1):
        agent = ResidualAgent(Push(), Base(config, sheet.load(config.vehicle)))
        tables.append(roll_out(config, agent, episodes=np.arange(24), seed=5, batch=batch).records)
    assert tables[0] == tables[1] == tables[2]


def test_gains_of_pid_are_those_of_its_preset_and_may_be_changed() -> None:
    preset = configs.training("algo=pid").algo
    assert configured().algo.residual.pid == configured("algo.base=pid").algo.residual.base == preset
    assert configured("algo.residual.pid.bandwidth=2.5").algo.residual.pid.bandwidth == 2.5


@pytest.mark.parametrize("learner", ["ppo", "sac"])
@pytest.mark.parametrize("base", ["lqr", "smc", "mpc", "mppi", "alos"])
def test_other_controllers_may_be_the_base(learner: str, base: str) -> None:
    config = configs.training(f"algo={learner}_residual", f"algo.base={base}")
    assert config.algo.residual.base == configs.training(f"algo={base}").algo
    assert list(config.algo.residual.bases) == [base]
    assert config.algo.name == f"{learner}_residual_{base}"
    assert title(config.algo.name) == f"{learner.upper()} added to {base.upper()}"


def test_a_grid_takes_several_bases() -> None:
    words = ("algo=ppo_residual", "algo.base=pid,lqr", "-m")
    request = read("train", words, grid=True)
    assert request is not None
    assert [config.algo.name for config in request.configs] == ["ppo_residual", "ppo_residual_lqr"]


@pytest.mark.parametrize("learner", ["ppo", "sac"])
def test_ids_of_runs_with_pid_stay(learner: str) -> None:
    """A configuration of before there were other bases."""
    updates = ("algo.updates=sb3",) if learner == "sac" else ()
    plain = configs.plain(f"algo={learner}_residual", *updates)
    before = copy.deepcopy(plain)
    before["algo"].pop("updates", None)
    for name in ("lqr", "smc", "mpc", "mppi", "alos"):
        del before["algo"]["residual"][name]
    known = {"ppo": "ppo_residual-k1-f10-s42-f88b5426", "sac": "sac_residual-k1-f10-s42-2cee29a6"}
    assert run_id(before) == run_id(plain) == known[learner]
    assert typed(OmegaConf.create(before)).algo.residual.base.agent == "pid"
    others = {
        run_id(configs.plain(f"algo={learner}_residual", f"algo.base={name}")) for name in ("lqr", "smc")
    }
    assert len(others | {run_id(plain)}) == 3


PATH = ("task=path_following", "vehicle=bluerov2_heavy", "task.time_limit=4", "disturbance=moderate")


@pytest.mark.parametrize(
    ("base", "overrides"),
    [
        ("lqr", PATH),
        ("smc", PATH),
        ("alos", PATH),
        ("alos", (*PATH, "vehicle=lrauv")),
        ("pid", (*PATH, "vehicle=lrauv")),
        pytest.param("mpc", (*PATH, "task.time_limit=1"), marks=pytest.mark.slow),
        ("mppi", (*PATH, "task.time_limit=1", "algo.residual.mppi.samples=32")),
    ],
)
def test_every_base_goes_on_with_the_same_bits(base: str, overrides: tuple[str, ...]) -> None:
    """Restored in mid-episode into fresh environments, over ends of episodes at different times."""
    if base in ("mpc", "mppi"):
        pytest.importorskip("casadi")
    config = configured(f"algo.base={base}", *overrides)
    limit = round(config.task.time_limit * config.step.frequency)
    first, second = wrapped(config, 2), wrapped(config, 2)
    n_u = first.action_space.shape[0]
    actions = np.random.default_rng(1).uniform(-1, 1, (limit + 14, 2, n_u)).astype(np.float32)
    first.reset()
    for action in actions[: limit // 2]:
        first.step(action)
    state = state_of(first)
    second.reset()
    second.venv.batch.load_state_dict(state["batch"])  # type: ignore[attr-defined]
    second.base.load_state_dict(state["base"])
    ends = 0
    for action in actions[limit // 2 :]:
        one, other = first.step(action), second.step(action)
        np.testing.assert_array_equal(one[0], other[0])
        ends += int(one[2].sum())
    assert ends >= 2
    after = state_of(second)
    for part, arrays in state_of(first).items():
        for name, value in arrays.items():
            np.testing.assert_array_equal(value, after[part][name], err_msg=name)


@pytest.mark.parametrize("base", ["smc", "alos"])
def test_a_new_episode_begins_with_a_fresh_base(base: str) -> None:
    config = configured(f"algo.base={base}", *PATH, "task.time_limit=2")
    environment = wrapped(config, 1)
    n_u = environment.action_space.shape[0]
    environment.reset()
    seen, done = None, np.array([False])
    while not done[0]:
        seen, _, done, _ = environment.step(np.ones((1, n_u), dtype=np.float32))
    fresh = make(dataclasses.replace(config, algo=config.algo.residual.base), environment.venv.batch.vehicle)
    fresh.reset(np.arange(1))
    action = np.clip(fresh.act(seen[:, :-n_u]), -1, 1)
    np.testing.assert_array_equal(seen[:, -n_u:], action.astype(np.float32))


def test_a_base_that_cannot_do_it_is_refused_before_the_run_starts() -> None:
    with pytest.raises(
        ConfigError, match="algo=lqr needs a vehicle with only thrusters; vehicle=lrauv also has rudder"
    ):
        check_runnable(configured("algo.base=lqr", "vehicle=lrauv"))
    with pytest.raises(ConfigError, match="algo=alos follows a path, which task=waypoint does not have"):
        check_runnable(configured("algo.base=alos"))


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("algo.residual.share=0", "algo.residual.share=0: must be more than 0 and at most 2"),
        ("algo.residual.share=3", "algo.residual.share=3: must be more than 0 and at most 2"),
        ("algo.residual.pid.bandwidth=-1", "algo.residual.pid.bandwidth=-1: must be more than 0"),
        ("algo.residual.pid.agent=lqr", "algo.residual.pid.agent=lqr: must be pid"),
        ("algo.residual.pid=null", "algo.residual={}: must have exactly one controller"),
        ("algo.base=lqg", "algo.base=lqg: no such option; did you mean 'lqr'"),
    ],
)
def test_mistakes_name_the_key_and_what_is_valid(override: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        configured(override)
