"""Limits and horizons in seconds: what they are in steps, and that who does not set them keeps what he had."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from omegaconf import OmegaConf

from auvbench.agents.learned import learners
from auvbench.config.compose import compose, typed
from auvbench.config.schema import discount, step_limit
from auvbench.config.validate import train_config
from auvbench.envs.batch import Batch
from auvbench.envs.sb3 import AuvVecEnv
from auvbench.envs.simulator_factory import at_frequency
from auvbench.errors import ConfigError
from auvbench.runs import identity


def plain(*overrides: str) -> dict:
    return OmegaConf.to_container(compose("train", list(overrides)), resolve=True)


def configuration(*overrides: str):
    return train_config(compose("train", list(overrides)))


@pytest.mark.parametrize("frequency", [10, 25, 55])
def test_a_limit_in_seconds_ends_episodes_at_the_same_time_at_every_frequency(frequency):
    config = configuration("task.time_limit=4", "task.goal_radius=0.001", f"step.frequency={frequency}")
    batch = Batch(config, 4)
    batch.reset()
    for step in range(1, 4 * frequency + 1):
        transition = batch.step(np.zeros((4, len(batch.vehicle.actuators))))
        assert bool(transition.truncated.all()) == (step == 4 * frequency)
    assert {record["duration_s"] for record in transition.records} == {4.0}


@pytest.mark.slow
def test_a_limit_in_seconds_holds_at_the_frequency_of_a_test():
    config = at_frequency(configuration("task.time_limit=20", "step.frequency=55"), 10.0)
    assert step_limit(config.task, config.step.frequency) == 200
    assert step_limit(configuration().task, 55.0) == 1000


@pytest.mark.parametrize("frequency", [10.0, 25.0, 55.0])
def test_a_reward_one_horizon_ahead_weighs_the_same_at_every_frequency(frequency):
    algo = configuration("algo.horizon_s=9.95", "algo.gamma=0.5").algo
    assert discount(algo, frequency) ** (frequency * 9.95) == pytest.approx(np.exp(-1.0), rel=1e-12)
    assert discount(dataclasses.replace(algo, horizon_s=None), frequency) == 0.5


def test_learner_and_reward_statistics_take_the_discount_of_the_horizon():
    config = configuration("algo.horizon_s=2", "step.frequency=25", "algo.n_envs=2", "algo.batch_size=64")
    model = learners.make(config, AuvVecEnv(Batch(config)))
    assert model.gamma == pytest.approx(np.exp(-1 / 50), rel=1e-15)


@pytest.mark.slow
def test_who_sets_neither_keeps_the_id_of_before():
    before = plain()
    for group, key in (("task", "time_limit"), ("algo", "horizon_s"), ("train", "evaluate_every")):
        assert key in before[group]
        del before[group][key]
    assert identity.run_id(before) == identity.run_id(plain())
    loaded = typed(OmegaConf.create(before))  # a run of before loads
    assert (loaded.task.time_limit, loaded.algo.horizon_s, loaded.train.evaluate_every) == (None, None, 0)


@pytest.mark.slow
@pytest.mark.parametrize(
    "override", ["task.time_limit=100", "algo.horizon_s=9.95", "train.evaluate_every=5000"]
)
def test_who_sets_one_has_another_run(override):
    assert identity.run_id(plain(override)) != identity.run_id(plain())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("override", "replaced"),
    [("task.time_limit=9", "task.max_steps=7"), ("algo.horizon_s=9", "algo.gamma=0.5")],
)
def test_what_is_replaced_does_not_count(override, replaced):
    assert identity.run_id(plain(override, replaced)) == identity.run_id(plain(override))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("override", "message"),
    [
        (
            "task.time_limit=0.01",
            r"task.time_limit=0.01: is 0 steps at 10 Hz; must be from 0.1 to 1e\+06 s",
        ),
        ("task.time_limit=-3", r"task.time_limit=-3: must be more than 0"),
        ("task.time_limit=5e6", r"task.time_limit=5e\+06: is 50000000 steps at 10 Hz"),
        ("algo.horizon_s=0", r"algo.horizon_s=0: must be more than 0"),
        ("train.evaluate_every=-1", r"train.evaluate_every=-1: must be at least 0"),
    ],
)
def test_values_out_of_range_are_named(override, message):
    with pytest.raises(ConfigError, match=message):
        configuration(override)
