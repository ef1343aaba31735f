"""Disturbances: their statistics, their physics, and independence of the batch."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from auvbench.config.schema import SCALES
from auvbench.envs.batch import Batch
from auvbench.registry import DISTURBANCES
from auvbench.simulators.fossen import FossenSimulator
from auvbench.tasks.disturbances import Disturbances, of
from auvbench.tasks.disturbances.base import kind_of
from auvbench.tasks.disturbances.fault import DEAD, HEALTHY
from auvbench.tasks.waypoint import WaypointTask
from auvbench.testing import check_disturbance
from auvbench.vehicles import sheet
from tests import configs

LEVELS = ("calm", "moderate", "severe")
FACTORS = ("current", "gauss_markov", "depth_current", "fault", "delay", "sensor", "randomised")


def configuration(*overrides: str):
    return configs.training("noise=none", *overrides)


def alone(*overrides: str, n: int, seed: int = 3) -> Disturbances:
    """Disturbances without a simulator, their first episodes drawn."""
    config = configuration(*overrides)
    vehicle = sheet.load(config.vehicle)
    task = WaypointTask(config, vehicle, n, seed)
    disturbances = of(config, vehicle, task)
    task.reset(np.arange(n))
    disturbances.draw(np.arange(n))
    return disturbances


def actions(steps: int, n: int, n_u: int = 6) -> np.ndarray:
    """Actions (steps, n, n_u); those of environment i do not depend on n."""
    return np.stack([np.random.default_rng(i).uniform(-1, 1, (steps, n_u)) for i in range(n)], axis=1)


def fly(batch: Batch, action: np.ndarray) -> np.ndarray:
    """Poses (steps + 1, n, 7) under actions (steps, n, n_u)."""
    batch.reset()
    poses = [batch.simulator.pose.copy()]
    for a in action:
        batch.step(a)
        poses.append(batch.simulator.pose.copy())
    return np.array(poses)


def outputs(batch: Batch, action: np.ndarray) -> tuple[np.ndarray, np.ndarray, list]:
    observations, rewards, records = [], [], []
    for a in action:
        result = batch.step(a)
        observations.append(result.observation.copy())
        rewards.append(result.reward.copy())
        records += result.records
    return np.array(observations), np.array(rewards), records


OPTIONS = {
    "current": "depth_current",
    "waves": "sea_state_4",
    "fault": "fault",
    "delay": "delay",
    "sensor": "sensor",
    "randomisation": "randomised",
    "tether": "tether",
    "identified": "identified",
}
"""an option of `disturbance` with each of auvbench's own"""


@pytest.mark.slow
@pytest.mark.parametrize("name", DISTURBANCES.own)
def test_every_disturbance_keeps_the_contract(name):
    vehicle = ["vehicle=bolt"] if name == "identified" else []
    check_disturbance(f"disturbance={OPTIONS[name]}", "task.start=[0,0,-5]", *vehicle)


# --- off ------------------------------------------------------------------------------------------------


def test_none_has_no_disturbances():
    assert Batch(configuration("disturbance=none"), 2).disturbances is None


def test_neutral_values_change_no_bit():
    # All the machinery, forced on with factors [1, 1], no delay, no fault: as if it were not there.
    config = configuration("task.max_steps=25", "disturbance.name=neutral")
    plain, forced = Batch(config, 5), Batch(config, 5)
    assert plain.disturbances is None
    parts = {
        name: kind_of(name)(settings, forced.vehicle, forced.task, name)
        for name, settings in config.disturbance.factors()
        if name != "waves"
    }
    for part in parts.values():
        part.moves = hasattr(part, "before")
        part.rereads = hasattr(part, "read")
    assert any(part.moves for part in parts.values())
    forced.disturbances = Disturbances(parts, forced.task)
    action = actions(60, 5)
    np.testing.assert_array_equal(fly(plain, action), fly(forced, action))
    assert np.array_equal(plain.task.episodes, forced.task.episodes)
    assert np.array_equal(plain.task.observation, forced.task.observation)
    assert np.all(forced.simulator.scales == 1.0)


# --- the same scenario ----------------------------------------------------------------------------------


@pytest.mark.parametrize("frequency", [10, 55])
def test_the_same_bits_at_any_batch_size(frequency):
    config = configuration(
        "disturbance=severe", "noise=thesis", "task.max_steps=30", f"step.frequency={frequency}"
    )
    results = {}
    for n in (1, 7, 64):
        batch = Batch(config, n)
        batch.reset()
        results[n] = outputs(batch, actions(80, n))
    assert len(results[64][2]) >= 64 * 2, "episodes must have ended and begun anew"
    for n in (1, 7):
        np.testing.assert_array_equal(results[n][0], results[64][0][:, :n])
        np.testing.assert_array_equal(results[n][1], results[64][1][:, :n])
        assert results[n][2] == [row for row in results[64][2] if row["environment"] < n]


def test_a_protocols_episode_is_the_same_whatever_ran_before():
    config = configuration("disturbance=severe")

    def tested(episodes):
        batch = Batch(config, len(episodes), seed=123, test=True, autoreset=False)
        batch.task.assign(np.array(episodes))
        return fly(batch, np.tile([0.3, -0.2, 0.5, 0.1, 0.4, -0.1], (20, len(episodes), 1)))

    every = tested(list(range(9)))
    np.testing.assert_array_equal(every[:, 6], tested([6])[:, 0])
    assert not np.array_equal(every[-1, 6], every[-1, 7])


@pytest.mark.slow
def test_training_and_tests_draw_other_disturbances():
    config = configuration("disturbance=severe")
    drawn = []
    for test in (False, True):
        batch = Batch(config, 3, seed=1, test=test)
        batch.reset()
        current = batch.disturbances["current"].state
        level = [current.top[:, :2], current.bottom[:, :2], current.fluctuation]
        drawn.append(np.concatenate(level, axis=1))
    assert not np.any(drawn[0] == drawn[1])


@pytest.mark.slow
def test_switching_a_factor_on_leaves_the_draws_of_the_others():
    one = alone("disturbance=current", "disturbance.current.speed_high=0.6", n=50)
    both = alone("disturbance=severe", "disturbance.current.speed=0.3", n=50)
    np.testing.assert_array_equal(one["current"].state.top, both["current"].state.top)


@pytest.mark.parametrize("name", [*LEVELS, "fault", "delay", "gauss_markov", "randomised", "sea_state_4"])
def test_a_restored_batch_goes_on_with_the_same_bits(name, tmp_path):
    config = configuration(
        f"disturbance={name}", "noise=thesis", "task.max_steps=37", "disturbance.fault.time_high=4.0"
    )
    whole = Batch(config, 6)
    whole.reset()
    action = actions(120, 6)
    outputs(whole, action[:50])
    assert whole.task.episodes[0].steps == 13, "in the middle of the second episode"
    np.savez(tmp_path / "state.npz", **whole.state_dict())
    expected = outputs(whole, action[50:])

    with np.load(tmp_path / "state.npz", allow_pickle=False) as state:
        fresh = Batch(config, 6, seed=99)
        fresh.load_state_dict(dict(state))
    got = outputs(fresh, action[50:])
    np.testing.assert_array_equal(got[0], expected[0])
    np.testing.assert_array_equal(got[1], expected[1])
    assert got[2] == expected[2]
    for key, value in whole.state_dict().items():
        np.testing.assert_array_equal(fresh.state_dict()[key], value, err_msg=key)


# --- currents -------------------------------------------------------------------------------------------


def test_given_direction_and_speed():
    d = alone(
        "disturbance=current", "disturbance.current.direction=2.0", "disturbance.current.elevation=0.3", n=2
    )
    level = 0.3 * math.cos(0.3)
    expected = [level * math.cos(2.0), level * math.sin(2.0), 0.3 * math.sin(0.3)]
    np.testing.assert_allclose(d["current"].state.top, [expected, expected], rtol=1e-15)


def test_drawn_direction_and_speed_are_uniform():
    d = alone(
        "disturbance=current", "disturbance.current.speed=0.1", "disturbance.current.speed_high=0.5", n=20_000
    )
    x, y, _ = d["current"].state.top.T
    speed = np.hypot(x, y)
    assert speed.min() >= 0.1
    assert speed.max() <= 0.5
    assert np.mean(speed) == pytest.approx(0.3, abs=0.004)
    direction = np.arctan2(y, x)
    counts, _ = np.histogram(direction, bins=8, range=(-np.pi, np.pi))
    assert np.all(np.abs(counts - 2500) < 250)


@pytest.mark.parametrize("frequency", [10.0, 55.0])
def test_gauss_markov_keeps_its_spread_and_forgets_at_its_rate(frequency):
    sigma, vertical, mu, n = 0.2, 0.05, 0.5, 20_000
    d = alone(
        "disturbance=gauss_markov",
        f"disturbance.current.gauss_markov={{sigma: {sigma}, sigma_vertical: {vertical}, mu: {mu}}}",
        "disturbance.current.direction=0.5",
        f"step.frequency={frequency}",
        n=n,
    )
    task, drawn = d.task, d["current"]

    def current():
        return drawn.state.top + drawn.state.fluctuation

    begun, seconds = current(), 2.0
    for _ in range(int(seconds * frequency)):
        drawn.before_rows()  # nothing happens before the first step
        task.episodes.steps[:] += 1
    drawn.before_rows()
    ended = current()
    mean = 0.2 * np.array([math.cos(0.5), math.sin(0.5), 0.0])
    spread = np.array([sigma, sigma, vertical])
    for sample in (begun, ended):
        np.testing.assert_allclose(sample.mean(axis=0), mean, atol=4 * sigma / math.sqrt(n))
        np.testing.assert_allclose(sample.std(axis=0), spread, rtol=0.025)
    for axis in range(3):
        correlation = np.corrcoef(begun[:, axis], ended[:, axis])[0, 1]
        assert correlation == pytest.approx(math.exp(-mu * seconds), abs=0.03)
    assert abs(np.corrcoef(ended[:, 0], ended[:, 1])[0, 1]) < 0.03


def test_an_unpowered_vehicle_drifts_with_the_current():
    batch = Batch(configuration("disturbance=current", "disturbance.current.direction=1.0"), 2)
    poses = fly(batch, np.zeros((400, 2, 6)))
    velocity = (poses[-1, :, :2] - poses[-2, :, :2]) / batch.task.duration
    expected = 0.3 * np.array([math.cos(1.0), math.sin(1.0)])
    np.testing.assert_allclose(velocity, [expected, expected], atol=1e-3)
    np.testing.assert_allclose(np.diff(poses[-2:, :, 2], axis=0)[0] / 0.1, 0.1544, atol=1e-3)  # still rises


def test_the_profile_is_linear_between_its_depths():
    batch = Batch(
        configuration(
            "disturbance=current",
            "disturbance.current.direction=0",
            "disturbance.current.profile={top: 10, bottom: 30, factor: 0.5, turn: 1.5707963267948966}",
        ),
        4,
    )
    batch.reset()
    z = np.array([-1.0, -20.0, -25.0, -59.0])  # above, halfway, three quarters, below
    fraction = np.array([0.0, 0.5, 0.75, 1.0])
    flow = (1.0 - fraction)[:, None] * [0.3, 0.0, 0.0] + fraction[:, None] * [0.0, 0.15, 0.0]
    simulator = batch.simulator
    pose = np.tile([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], (4, 1))
    pose[:, 2] = z
    velocity = np.concatenate((flow, np.zeros((4, 3))), axis=1)
    simulator.reset(np.arange(4), pose, velocity)
    still = FossenSimulator(batch.vehicle, 4)
    still.reset(np.arange(4), pose, np.zeros((4, 6)))
    simulator.step(np.zeros((4, 6)), 1e-4)
    still.step(np.zeros((4, 6)), 1e-4)
    # Moving along with the water of its depth, a vehicle starts as if at rest in still water.
    np.testing.assert_allclose(simulator.velocity[:, :2] - flow[:, :2], still.velocity[:, :2], atol=1e-8)


# --- faults ---------------------------------------------------------------------------------------------


def test_a_dead_thruster_gives_no_force_and_draws_no_power():
    config = configuration("disturbance=fault", "disturbance.fault.actuator=thruster3")
    dead, plain = Batch(config, 3), Batch(configuration(), 3)
    action = actions(30, 3)
    without = action.copy()
    without[:, :, 2] = 0.0
    np.testing.assert_array_equal(fly(dead, action), fly(plain, without))
    np.testing.assert_array_equal(dead.disturbances.power, plain.simulator.power)
    assert np.all(dead.simulator.command_force[:, 2] == 0.0)
    assert not np.array_equal(fly(plain, action), fly(plain, without))


def test_a_dead_thruster_with_a_lag_stops_at_once():
    config = configuration(
        "vehicle=bluerov2_heavy",
        "disturbance=fault",
        "disturbance.fault.time=1.0",
        "disturbance.fault.actuator=thruster1",
    )
    batch = Batch(config, 1)
    batch.reset()
    for step in range(12):
        batch.step(np.ones((1, 8)))
        assert batch.simulator.effectiveness[0, 0] == (1.0 if step < 10 else 0.0)
    assert np.all(batch.simulator.effectiveness[0, 1:] == 1.0)


def test_a_weak_thruster_gives_its_factor_of_the_force():
    config = configuration(
        "disturbance=fault", "disturbance.fault.mode=weak", "disturbance.fault.factor=0.25",
        "disturbance.fault.actuator=thruster5",
    )  # fmt: skip
    action = actions(30, 2)
    less = action.copy()
    less[:, :, 4] *= 0.25
    np.testing.assert_allclose(
        fly(Batch(config, 2), action), fly(Batch(configuration(), 2), less), atol=1e-12
    )


@pytest.mark.parametrize("delay", [0.0, 0.25])
def test_a_stuck_actuator_holds_the_command_of_the_moment(delay):
    late = f"disturbance.delay.action={delay}"
    config = configuration(
        "disturbance=fault", "disturbance.fault.mode=stuck", "disturbance.fault.actuator=thruster2",
        "disturbance.fault.time=0.45", late,
    )  # fmt: skip
    action = actions(30, 2)
    held = action.copy()
    # In effect from the step that begins at 0.5 s on; what acts then was issued `delay` earlier.
    first = 5 if delay == 0.0 else 2
    held[first:, :, 1] = action[first, :, 1]
    np.testing.assert_array_equal(fly(Batch(config, 2), action), fly(Batch(configuration(late), 2), held))


def test_drawn_faults_have_their_probability_their_times_and_all_thrusters():
    d = alone(
        "disturbance=fault", "disturbance.fault.mode=any", "disturbance.fault.probability=0.4",
        "disturbance.fault.time=2", "disturbance.fault.time_high=8", n=20_000,
    )  # fmt: skip
    fault = d["fault"].state
    failed = fault.mode != HEALTHY
    assert failed.mean() == pytest.approx(0.4, abs=0.015)
    modes = np.bincount(fault.mode[failed], minlength=4)[1:] / failed.sum()
    np.testing.assert_allclose(modes, 1 / 3, atol=0.02)
    which = np.bincount(fault.actuator[failed], minlength=6) / failed.sum()
    np.testing.assert_allclose(which, 1 / 6, atol=0.02)
    begin = fault.begin[failed]
    assert begin.min() == 21
    assert begin.max() == 80
    assert np.mean(begin) == pytest.approx(50.5, abs=1.0)


def test_a_fault_ends_with_its_episode():
    config = configuration("disturbance=fault", "disturbance.fault.probability=0.5", "task.max_steps=5")
    batch = Batch(config, 64)
    batch.reset()
    seen = {}
    for action in actions(20, 64):
        dead = batch.disturbances["fault"].state.mode == DEAD
        seen[int(batch.task.episodes[0].episode)] = dead
        result = batch.step(action)
        going = np.setdiff1d(np.arange(64), result.ended)
        healthy = np.all(batch.simulator.effectiveness == 1.0, axis=1)
        np.testing.assert_array_equal(healthy[going], ~dead[going])
        assert np.all(healthy[result.ended])
    assert list(seen) == [0, 1, 2, 3]
    for before, after in pairwise(seen.values()):
        assert np.any(before & ~after), "healthy again"
        assert np.any(~before & after)


# --- delays ---------------------------------------------------------------------------------------------


def reference(vehicle, batch: Batch, action: np.ndarray, frequency: float, delay: float, times) -> np.ndarray:
    """Poses at `times` (s) of an undelayed simulator whose commands are shifted by `delay`, by events."""
    n = action.shape[1]
    simulator = FossenSimulator(vehicle, n)
    simulator.reset(np.arange(n), batch.simulator.pose, np.zeros((n, 6)))
    events = sorted(
        {round(j / frequency + delay, 12) for j in range(len(action))} | {round(t, 12) for t in times}
    )
    poses, now = {0.0: simulator.pose.copy()}, 0.0
    for event in events:
        if event - now > 1e-9:
            issued = math.floor((0.5 * (now + event) - delay) * frequency)
            simulator.step(action[issued] if issued >= 0 else np.zeros_like(action[0]), event - now)
            now = event
        poses[event] = simulator.pose.copy()
    return np.array([poses[round(t, 12)] for t in times])


@pytest.mark.parametrize(
    ("frequency", "delay"), [(10.0, 0.25), (10.0, 0.3), (25.0, 0.25), (55.0, 0.25), (10.0, 0.01)]
)
def test_commands_act_exactly_after_their_delay(frequency, delay):
    config = configuration("disturbance=delay", f"disturbance.delay.action={delay}", f"step.frequency={frequency}",
                           "disturbance.delay.observation=0")  # fmt: skip
    batch = Batch(config, 3)
    action = actions(40, 3)
    poses = fly(batch, action)
    batch = Batch(config, 3)
    batch.reset()
    expected = reference(batch.vehicle, batch, action, frequency, delay, [j / frequency for j in range(41)])
    # The same commands for the same times; substeps between them may differ in length.
    np.testing.assert_allclose(poses, expected, atol=2e-7)


def test_a_quarter_second_at_10_hz_is_five_steps_at_20_hz_to_the_bit():
    late = Batch(configuration("disturbance=delay", "disturbance.delay={action: 0.25, observation: 0}"), 3)
    fast = Batch(configuration("step.frequency=20"), 3)
    action = actions(30, 3)
    shifted = np.zeros((60, 3, 6))
    shifted[5:] = np.repeat(action, 2, axis=0)[:55]
    np.testing.assert_allclose(fly(late, action), fly(fast, shifted)[::2], atol=1e-13)


@pytest.mark.parametrize(("frequency", "delay"), [(10.0, 0.25), (10.0, 0.2), (55.0, 0.1), (25.0, 0.01)])
def test_measurements_are_of_their_delay_ago(frequency, delay):
    config = configuration("disturbance=delay", f"disturbance.delay={{action: 0, observation: {delay}}}",
                           f"step.frequency={frequency}")  # fmt: skip
    batch = Batch(config, 3)
    action = actions(40, 3)
    observations = [batch.reset().copy()]
    waypoint = batch.task.reference.copy()
    for a in action:
        observations.append(batch.step(a).observation.copy())
    read = waypoint - np.array(observations)[:, :, 1:4]
    batch = Batch(config, 3)
    batch.reset()
    times = [max(j / frequency - delay, 0.0) for j in range(41)]
    expected = reference(batch.vehicle, batch, action, frequency, 0.0, times)
    np.testing.assert_allclose(read, expected[:, :, :3], atol=3e-6)  # observations are float32


def test_delays_do_not_reach_across_episodes():
    # What is still on its way when an episode ends is lost: the next begins at rest, with its own start pose.
    config = configuration(
        "disturbance=delay", "disturbance.delay={action: 0.25, observation: 0.25}", "task.max_steps=9"
    )
    batch = Batch(config, 2)
    batch.reset()
    for action in actions(9, 2):
        result = batch.step(action)
    assert len(result.ended) == 2
    expected = batch.task.reference - [0.0, 0.0, -20.0]
    np.testing.assert_allclose(result.observation[:, 1:4], expected, atol=1e-5)
    for _ in range(2):
        batch.step(np.ones((2, 6)))
        assert np.all(batch.simulator.command_force == 0.0)
    batch.step(np.ones((2, 6)))
    assert np.all(batch.simulator.command_force == 40.0)


def test_energy_weighs_the_commands_that_act_by_their_time():
    config = configuration("disturbance=delay", "disturbance.delay={action: 0.025, observation: 0}")
    batch = Batch(config, 1)
    batch.reset()
    batch.step(np.ones((1, 6)))
    idle, full = batch.vehicle.power(np.zeros(6)), batch.vehicle.power(np.ones(6))
    assert batch.disturbances.power[0] == pytest.approx(0.25 * idle + 0.75 * full, rel=1e-9)


# --- sensors --------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("frequency", [10.0, 55.0])
def test_errors_of_the_readings(frequency):
    n, seconds = 20_000, 2.0
    d = alone(
        "disturbance=sensor",
        "disturbance.sensor.gaussian={x: 0.1, y: 0.2, z: 0.3, yaw: 0.04}",
        "disturbance.sensor.bias={x: 0.5, y: 0.4, z: 0.3, yaw: 0.2}",
        "disturbance.sensor.drift={x: 0.05, y: 0.1, z: 0, yaw: 0.02}",
        f"step.frequency={frequency}",
        n=n,
    )
    task = d.task
    sensor = d["sensor"]
    sensor.read_rows(np.arange(n))
    bias = sensor.state.bias.copy()
    noise = [task.offset - bias]
    for _ in range(int(seconds * frequency)):
        task.episodes.steps[:] += 1
        d.read()
    np.testing.assert_array_equal(sensor.state.bias, bias)
    drift = sensor.state.drift
    noise.append(task.offset - bias - drift)
    np.testing.assert_allclose(bias.std(axis=0), [0.5, 0.4, 0.3, 0.2], rtol=0.025)
    np.testing.assert_allclose(bias.mean(axis=0), 0.0, atol=0.015)
    for sample in noise:
        np.testing.assert_allclose(sample.std(axis=0), [0.1, 0.2, 0.3, 0.04], rtol=0.025)
    np.testing.assert_allclose(
        drift.std(axis=0), math.sqrt(seconds) * np.array([0.05, 0.1, 0, 0.02]), rtol=0.025
    )
    everything = np.concatenate((bias, drift[:, [0, 1, 3]], noise[0], noise[1]), axis=1)
    correlation = np.corrcoef(everything.T) - np.eye(everything.shape[1])
    assert np.max(np.abs(correlation)) < 0.04, "channels and factors must be independent"


def test_a_bias_is_what_the_observation_is_off_by():
    overrides = ("disturbance=sensor", "disturbance.sensor.gaussian={x: 0, y: 0, z: 0, yaw: 0}",
                 "disturbance.sensor.drift={x: 0, y: 0, z: 0, yaw: 0}")  # fmt: skip
    off, exact = Batch(configuration(*overrides), 4), Batch(configuration(), 4)
    assert np.array_equal(off.reset().shape, exact.reset().shape)
    action = actions(5, 4)
    for a in action:
        got, true = off.step(a).observation, exact.step(a).observation
        np.testing.assert_allclose(true[:, 1:4] - got[:, 1:4], off.task.offset[:, :3], atol=1e-5)
    assert np.all(off.task.offset != 0.0)
    np.testing.assert_array_equal(off.simulator.pose, exact.simulator.pose)


# --- drawn vehicles -------------------------------------------------------------------------------------


@pytest.mark.parametrize("distribution", ["uniform", "log_uniform"])
def test_factors_fill_their_ranges(distribution):
    ranges = {"mass": (0.8, 1.3), "buoyancy": (0.9, 1.0), "inertia": (0.5, 2.0), "added_mass": (1.2, 1.2),
              "damping": (0.5, 2.0), "thrust": (0.7, 1.1)}  # fmt: skip
    n = 20_000
    d = alone(
        f"disturbance.randomisation.distribution={distribution}",
        "disturbance.randomisation.keep_trim=false",
        *(f"disturbance.randomisation.{name}={{low: {a}, high: {b}}}" for name, (a, b) in ranges.items()),
        n=n,
    )
    scales = d.draw(np.arange(n))
    for column, name in enumerate(SCALES):
        low, high = ranges[name]
        drawn = scales[:, column]
        assert drawn.min() >= low - 1e-15
        assert drawn.max() <= high + 1e-15
        middle = 0.5 * (low + high) if distribution == "uniform" else math.sqrt(low * high)
        assert np.median(drawn) == pytest.approx(middle, rel=0.02)
        if low < high:
            assert np.ptp(drawn) > 0.99 * (high - low)
    independent = np.corrcoef(scales[:, [0, 1, 2, 4, 5]].T) - np.eye(5)
    assert np.max(np.abs(independent)) < 0.03


@pytest.mark.parametrize("keep", [True, False])
def test_a_heavier_vehicle_keeps_its_trim_or_sinks(keep):
    config = configuration(
        "disturbance.randomisation.mass={low: 1.3, high: 1.3}",
        f"disturbance.randomisation.keep_trim={str(keep).lower()}",
    )
    batch = Batch(config, 1)
    fly(batch, np.zeros((5, 1, 6)))
    vehicle = batch.vehicle
    mass, buoyancy = batch.simulator.scales[0, :2]
    assert mass == 1.3
    net = buoyancy * vehicle.buoyancy - mass * vehicle.weight
    sheets = vehicle.buoyancy - vehicle.weight
    assert net == pytest.approx(sheets if keep else sheets - 0.3 * vehicle.weight, rel=1e-9)
    assert bool(batch.simulator.velocity[0, 2] > 0.0) is keep


def test_each_episode_is_another_vehicle():
    batch = Batch(configuration("disturbance=randomised", "task.max_steps=3"), 4)
    batch.reset()
    seen = [batch.simulator.scales.copy()]
    for action in actions(9, 4):
        if batch.step(action).records:
            seen.append(batch.simulator.scales.copy())
    drawn = np.concatenate(seen)[:, 0]
    assert len(drawn) == 16
    assert len(set(drawn.tolist())) == 16


def test_half_the_thrust_is_half_the_force():
    half = Batch(configuration("disturbance.randomisation.thrust={low: 0.5, high: 0.5}"), 2)
    action = actions(20, 2)
    np.testing.assert_allclose(fly(half, action), fly(Batch(configuration(), 2), 0.5 * action), atol=1e-12)
