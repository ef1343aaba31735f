"""Protocols: the same scenarios for everybody, named by a fingerprint."""

from __future__ import annotations

import copy
import dataclasses
from functools import lru_cache

import numpy as np
import pytest

from auvbench.errors import ConfigError
from auvbench.evaluation.protocol import fingerprint, resolve_conditions
from auvbench.registry import TASKS
from auvbench.vehicles.sheet import load
from tests import configs


@lru_cache
def protocol(*overrides: str):
    return configs.protocol("protocol.episodes=5", *overrides)


@lru_cache
def config(*overrides: str) -> dict:
    return configs.plain(*overrides)


def of(test, run: dict) -> str:
    return fingerprint(test, resolve_conditions(test, run))


@pytest.fixture(scope="module")
def base() -> str:
    return of(protocol(), config())


@pytest.mark.slow
@pytest.mark.parametrize(
    "override",
    [
        "algo=pid",
        "reward.k=100",
        "seed=7",
        "step.frequency=55",
        "train.total_steps=3",
        "name=other",
        "noise=none",
        "task.goal_radius=2",
        "task.position_frame=body",
        "disturbance=severe",
    ],
)
def test_agents_meet_the_same_scenarios_whatever_they_are(override, base):
    assert of(protocol(), config(override)) == base


@pytest.mark.parametrize(
    "override",
    ["vehicle=bluerov2_wu2018", "vehicle.rigid_body.mass.value=16", "simulator.max_step=0.005"],
)
def test_other_vehicles_are_other_scenarios(override, base):
    assert of(protocol(), config(override)) != base


@pytest.mark.slow
@pytest.mark.parametrize(
    "override",
    [
        "protocol.seed=124",
        "protocol.episodes=6",
        "protocol.frequency=25",
        "protocol=native",
        'protocol.overrides=["noise=none"]',
        'protocol.overrides=["task.goal_radius=2"]',
    ],
)
def test_other_tests_are_other_scenarios(override, base):
    assert of(protocol(override), config()) != base


@pytest.mark.parametrize("override", ["protocol.batch=3", "protocol.trajectories=1"])
def test_how_a_test_is_carried_out_does_not_matter(override, base):
    assert of(protocol(override), config()) == base


@pytest.mark.slow
def test_native_uses_each_agents_own_frequency_and_compares_across_them():
    test = protocol("protocol=native")
    (condition,) = resolve_conditions(test, config("step.frequency=55"))
    assert condition.config.step.frequency == 55
    assert of(test, config("step.frequency=55")) == of(test, config("step.frequency=10"))


@pytest.mark.slow
@pytest.mark.parametrize("override", ["task.goal_radius=0.5", "noise=none", "disturbance=severe"])
def test_own_tests_a_run_in_what_it_was_trained_with(override):
    test = protocol("protocol=own")
    run = config(override, "step.frequency=25")
    (condition,) = resolve_conditions(test, run)
    assert condition.config.step.frequency == 25
    group = override.partition("=")[0].partition(".")[0]
    own = {"block_packages": {}, "range": None} if group == "task" else {}
    assert dataclasses.asdict(getattr(condition.config, group)) == own | run[group]
    assert of(test, run) != of(test, config())
    assert of(test, config("reward.k=100")) == of(test, config())


@pytest.mark.slow
def test_robustness_has_levels_and_one_factor_at_a_time():
    found = {c.name: c.config for c in resolve_conditions(protocol("protocol=robustness"), config())}
    nominal = found["nominal"]
    assert found["current=1"].disturbance.current.speed == 1.0
    assert found["noise=8"].noise.scale == 8.0
    assert found["delay=0.5"].disturbance.delay.action == 0.5
    assert found["dead-thruster"].disturbance.fault.mode == "dead"
    assert found["mass=0.7"].disturbance.randomisation.mass.high == 0.7
    assert found["drag=1.3"].disturbance.randomisation.damping.low == 1.3
    assert found["level=severe"].disturbance.name == "severe"
    trained = {
        c.name: c.config
        for c in resolve_conditions(protocol("protocol=robustness"), config("disturbance=moderate"))
    }
    assert trained["noise=2"].disturbance == nominal.disturbance, "one factor at a time"
    for name, changed in found.items():
        assert changed.task == nominal.task, name
        assert changed.step == nominal.step, name
        if not name.startswith("noise="):
            assert changed.noise == nominal.noise, name


@pytest.mark.slow
def test_long_is_test_with_more_steps_whatever_a_run_was_trained_with(base):
    (longer,) = resolve_conditions(protocol("protocol=long"), config("vehicle=lrauv"))
    (usual,) = resolve_conditions(protocol(), config("vehicle=lrauv", "task.max_steps=5000"))
    assert (usual.config.task.max_steps, longer.config.task.max_steps) == (1000, 5000)
    assert dataclasses.replace(longer.config.task, max_steps=1000) == usual.config.task
    assert longer.config.noise == usual.config.noise
    assert of(protocol("protocol=long"), config()) != base
    remarks = " ".join(load("lrauv").remarks)
    assert "protocol=long" in remarks


@pytest.mark.slow
def test_transfer_leaves_out_vehicles_with_other_actuators():
    test = protocol("protocol=transfer")
    names = [c.name for c in resolve_conditions(test, config())]
    assert "vehicle=bluerov2-wu2018" in names
    assert not any("heavy" in name or "rexrov" in name for name in names)
    heavy = [c.name for c in resolve_conditions(test, config("vehicle=bluerov2_heavy"))]
    assert "vehicle=bluerov2-heavy-wu2018" in heavy
    assert "vehicle=bluerov2" not in heavy


def test_a_vehicle_whose_thrusters_are_numbered_otherwise_is_left_out():
    test = protocol("protocol=transfer")
    swapped = copy.deepcopy(config("vehicle=bluerov2_heavy"))
    positions = swapped["vehicle"]["actuators"]["thrusters"]["positions"]["value"]
    positions["thruster6"], positions["thruster7"] = positions["thruster7"], positions["thruster6"]
    names = [c.name for c in resolve_conditions(test, swapped)]
    assert "vehicle=bluerov2-heavy-wu2018" not in names


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("reward.kk=3", "reward.kk: unknown key"),
        ("task.stations=[0,0,-5]", "task.stations: unknown key"),
        ("noise", "'noise' is not key=value"),
        ("noise.scale=loud", "noise.scale"),
        ("disturbance=storm", "disturbance=storm: no such option"),
    ],
)
def test_a_condition_with_a_mistake_is_named(override, message):
    test = protocol()
    broken = dataclasses.replace(test.conditions[0], overrides=[override])
    with pytest.raises(ConfigError, match=message):
        resolve_conditions(dataclasses.replace(test, conditions=[broken]), config())


def test_a_condition_may_set_a_key_of_one_task():
    test = protocol()
    shallow = dataclasses.replace(test.conditions[0], overrides=["task.station=[0,0,-5]"])
    test = dataclasses.replace(test, conditions=[shallow])
    (moved,) = resolve_conditions(test, config("task=station_keeping", "vehicle=bluerov2_heavy"))
    assert moved.config.task.station == [0, 0, -5]
    (same,) = resolve_conditions(test, config("task=docking", "vehicle=bluerov2_heavy"))
    (usual,) = resolve_conditions(protocol(), config("task=docking", "vehicle=bluerov2_heavy"))
    assert same.config == usual.config


@pytest.mark.slow
@pytest.mark.parametrize("task", TASKS)
def test_the_suite_tests_every_task_under_one_factor_at_a_time(task):
    run = config(f"task={task}", "vehicle=bluerov2_heavy", "disturbance=moderate", "noise=none")
    found = {c.name: c.config for c in resolve_conditions(protocol("protocol=suite"), run)}
    nominal = found["nominal"]
    assert nominal.task.name == task
    assert nominal.disturbance.name == "none"
    assert found["current=1"].disturbance.current.speed == 1.0
    sea = found["sea-state=4"]
    assert sea.disturbance.waves.height == 1.88
    for key, depth in {"station": -5, "dock": -5, "centre": -15}.items():
        assert getattr(sea.task, key, [0, 0, depth]) == [0, 0, depth]
    assert found["dead-thruster"].disturbance.fault.mode == "dead"
    assert found["delay=0.3"].disturbance.delay.action == 0.3
    assert found["noise=4"].noise.scale == 4.0
    assert found["payload=0.2"].disturbance.randomisation.mass.low == 1.2
    assert not found["payload=0.2"].disturbance.randomisation.keep_trim
    assert len({repr(one) for one in found.values()}) == len(found), "no two conditions are alike"


@pytest.mark.slow
def test_conditions_need_names_of_their_own():
    with pytest.raises(ConfigError, match="must be unique"):
        protocol("protocol.conditions=[{name: a},{name: a}]")
    with pytest.raises(ConfigError, match="letters, digits"):
        protocol("protocol.conditions=[{name: a/b}]")
    with pytest.raises(ConfigError, match="at least one condition"):
        protocol("protocol.conditions=[]")


def test_a_longer_test_begins_with_the_shorter_one():
    from auvbench.envs.batch import Batch

    (condition,) = resolve_conditions(protocol(), config())
    drawn = []
    for n in (3, 8):
        batch = Batch(condition.config, n, seed=123, test=True)
        batch.task.assign(np.arange(n))
        batch.reset()
        drawn.append(batch.task.episodes.reference[:3].copy())
    np.testing.assert_array_equal(*drawn)


def test_a_protocol_of_a_task_that_does_not_supply_what_a_run_observes_names_both():
    run = config("task=docking", "vehicle=bluerov2_heavy")
    with pytest.raises(ConfigError, match=r"tests task=waypoint, but the run has task=docking: .*goal_error"):
        resolve_conditions(protocol("protocol=thesis"), run)


def test_a_test_keeps_the_number_of_vehicles_and_takes_its_own_messages():
    words = ("task=formation", "vehicle=bluerov2_heavy", "task.messages=ideal")
    conditions = [resolve_conditions(protocol(), config(*words, f"task.vehicles={n}")) for n in (3, 4)]
    assert [found[0].config.task.vehicles for found in conditions] == [3, 4]
    assert {found[0].config.task.messages for found in conditions} == {"acoustic"}
    test = protocol("protocol.episodes=1")
    assert len({fingerprint(test, found) for found in conditions}) == 2
