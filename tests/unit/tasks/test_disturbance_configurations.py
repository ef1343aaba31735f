"""Every disturbance file composes, flies on every vehicle and trains; what is wrong is said in one line."""

from __future__ import annotations

from importlib.resources import files

import numpy as np
import pytest
from omegaconf import OmegaConf
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.vec_env import VecNormalize

from auvbench.agents.learned import learners
from auvbench.config.compose import option, typed
from auvbench.config.validate import train_config
from auvbench.envs.batch import Batch
from auvbench.envs.sb3 import AuvVecEnv
from auvbench.errors import ConfigError
from auvbench.registry import DISTURBANCES
from tests import configs


def options(group: str) -> list[str]:
    folder = files("auvbench.conf") / group
    return sorted(path.name.removesuffix(".yaml") for path in folder.iterdir() if path.name.endswith(".yaml"))


NAMES = options("disturbance")


def test_the_files_are_there():
    assert {"none", "calm", "moderate", "severe"} <= set(NAMES)
    assert {"current", "gauss_markov", "depth_current", "fault", "delay", "sensor", "randomised"} <= set(
        NAMES
    )


@pytest.mark.parametrize("name", NAMES)
def test_every_file_has_every_key_and_is_named_as_its_file(name):
    def keys(node, prefix=""):
        if not isinstance(node, dict):
            return {prefix}
        return {key for child in node for key in keys(node[child], f"{prefix}.{child}")}

    composed, none = (
        OmegaConf.to_container(configs.composed(f"disturbance={option}").disturbance)
        for option in (name, "none")
    )
    own = composed.keys() - none.keys()
    assert own <= set(DISTURBANCES.own), "keys of a disturbance that is not in every configuration"
    assert keys({key: composed[key] for key in composed.keys() - own}) == keys(none)
    assert composed["name"] == name
    assert (composed == none) is (name == "none")


@pytest.mark.parametrize("name", NAMES)
def test_every_file_trains_a_few_steps(name):
    vehicle = ["vehicle=bolt"] if name == "identified" else []  # whose sheet has a covariance
    config = train_config(
        configs.composed(
            f"disturbance={name}",
            *vehicle,
            "algo=ppo",
            "algo.n_envs=4",
            "algo.n_steps=16",
            "algo.batch_size=32",
            "algo.n_epochs=1",
            "task.max_steps=20",
        )
    )
    environment = AuvVecEnv(Batch(config))
    model = learners.make(config, VecNormalize(environment))
    model.set_logger(Logger(None, []))  # the one that SB3 would make leaves an empty folder in /tmp
    model.learn(128)
    assert model.num_timesteps == 128
    assert np.all(np.isfinite(environment.batch.simulator.pose))
    assert (environment.batch.disturbances is None) is (name == "none")


@pytest.mark.parametrize("vehicle", options("vehicle"))
def test_the_severest_day_on_every_vehicle(vehicle):
    config = train_config(configs.composed(f"vehicle={vehicle}", "disturbance=severe", "task.max_steps=150"))
    batch = Batch(config, 16)
    batch.reset()
    rng = np.random.default_rng(0)
    for _ in range(200):
        result = batch.step(rng.uniform(-1, 1, (16, len(batch.vehicle.actuators))))
    assert np.all(np.isfinite(result.observation))
    assert np.max(np.abs(batch.simulator.velocity)) < 20.0


def test_several_factors_at_once_by_overriding_none():
    config = train_config(
        configs.composed(
            "disturbance.current.speed=0.5", "disturbance.delay.action=0.1", "disturbance.fault.mode=stuck"
        )
    )
    assert list(Batch(config, 1).disturbances.parts) == ["current", "fault", "delay"]
    assert not config.disturbance.current.fluctuates
    assert not config.disturbance.current.sheared


def test_the_configuration_of_a_run_reads_back():
    config = configs.composed("disturbance=severe", "algo=pid")
    plain = OmegaConf.create(OmegaConf.to_yaml(config, resolve=True))
    assert typed(plain).disturbance == train_config(config).disturbance


@pytest.mark.slow
def test_an_option_put_into_a_runs_configuration():
    config = configs.composed("algo=pid", "disturbance=moderate")
    config.disturbance = option("disturbance", "severe")
    assert typed(config).disturbance == configs.training("disturbance=severe").disturbance


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("disturbance=currant", "disturbance=currant: no such option; did you mean 'current'"),
        ("disturbance.current.sped=1", "disturbance.current.sped: .*did you mean disturbance.current.speed"),
        ("disturbance.current.speed=fast", "disturbance.current.speed: 'fast' is not a number"),
        ("disturbance.current.speed=-1", "disturbance.current.speed=-1: must be at least 0 and at most 10"),
        ("disturbance.current.speed=nan", "disturbance.current.speed=nan: must be a finite number"),
        ("disturbance.current.direction=90", "disturbance.current.direction=90: must be at least -6.28"),
        ("disturbance.current.gauss_markov.mu=0", "disturbance.current.gauss_markov.mu=0: must be more than 0"),
        ("disturbance.current.profile.factor=10", "profile.factor=10: must be at least -3 and at most 3"),
        ("disturbance.current.profile.top=80", "profile.top=80: must be below .*profile.bottom=60"),
        ("disturbance=sea_state_5", "disturbance=sea_state_5: no such option; did you mean 'sea_state_4'"),
        ("disturbance.waves.height=-1", "disturbance.waves.height=-1: must be at least 0 and at most 30"),
        ("disturbance.waves.period=0", "disturbance.waves.period=0: must be at least 0.5 and at most 30"),
        ("disturbance.waves.spectrum=jonswop", "disturbance.waves.spectrum=jonswop: unknown; did you mean 'jonswap'"),
        ("disturbance.waves.direction=90", "disturbance.waves.direction=90: must be at least -6.28"),
        ("disturbance.waves.spreading=0", "disturbance.waves.spreading=0: must be at least 1 and at most 1000"),
        ("disturbance.waves.height=9", "disturbance.waves.period=7.5: must be at least 10.8 s for .*waves.height=9: steeper"),
        ("disturbance.fault.mode=broken", "disturbance.fault.mode=broken: unknown; valid: any, dead, none, stuck, weak"),
        ("disturbance.fault.probability=1.5", "disturbance.fault.probability=1.5: must be at least 0 and at most 1"),
        ("disturbance.fault.time_high=-1", "disturbance.fault.time_high=-1: must be at least 0"),
        ("disturbance.delay.action=11", "disturbance.delay.action=11: must be at least 0 and at most 10"),
        ("disturbance.sensor.bias.x=-0.1", "disturbance.sensor.bias.x=-0.1: must be at least 0"),
        ("disturbance.randomisation.mass.low=0", "disturbance.randomisation.mass.low=0: must be at least 0.01"),
        ("disturbance.randomisation.mass.low=2", "randomisation.mass.low=2: must be at most .*randomisation.mass.high=1"),
        ("disturbance.randomisation.keep_trim=maybe", "disturbance.randomisation.keep_trim: .*'maybe'"),
    ],
)  # fmt: skip
def test_a_mistake_is_one_line(override, message):
    with pytest.raises(ConfigError, match=message) as caught:
        configs.training(override)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (["disturbance.current.speed=0.5", "disturbance.current.speed_high=0.1"], "speed=0.5: must be at most .*speed_high=0.1"),
        (
            ["disturbance.current.speed=5", "disturbance.current.profile.factor=-3"],
            "profile.factor=-3: gives a current of 15 m/s at the bottom; must give at most 10 m/s",
        ),
        (["disturbance.fault.time=5", "disturbance.fault.time_high=1"], "time=5: must be at most .*time_high=1"),
        (
            ["disturbance=fault", "disturbance.fault.actuator=thruster9"],
            "disturbance.fault.actuator=thruster9: bluerov2 has no such actuator; did you mean 'thruster",
        ),
        (
            ["disturbance=fault", "vehicle=lrauv", "disturbance.fault.actuator=rudder"],
            "disturbance.fault.mode=dead: rudder is a fin; this mode needs a thruster, so use disturbance.fault.mode=stuck",
        ),
        (
            ["vehicle.buoyancy.volume.value=0.0130", "disturbance.randomisation.mass.low=0.1"],
            "disturbance.randomisation.mass.low=0.1: keep_trim would leave bluerov2 without buoyancy; must be more than 0.146",
        ),
    ],
)  # fmt: skip
def test_a_mistake_of_several_values_is_one_line(overrides, message):
    with pytest.raises(ConfigError, match=message) as caught:
        Batch(configs.training(*overrides), 1)
    assert "\n" not in str(caught.value)
