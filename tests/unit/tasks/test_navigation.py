"""Navigation sensors and estimators: errors as their keys say, a consistent filter, and observations without truth."""

from __future__ import annotations

import copy
import math
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray

from auvbench import record
from auvbench.cli import main
from auvbench.config.compose import compose
from auvbench.config.validate import resolved
from auvbench.dynamics.frames import quaternion, rotation
from auvbench.envs.batch import Batch
from auvbench.envs.settings import configuration
from auvbench.errors import ConfigError
from auvbench.runs.identity import run_id
from auvbench.tasks import records
from auvbench.tasks.navigation import dvl, ekf, imu, model, modem, usbl
from auvbench.tasks.navigation.readings import readings
from auvbench.tasks.navigation.state import (
    DEPTH,
    DVL,
    FIELDS,
    GNSS,
    HEADING,
    MODEL,
    MODEL_STATES,
    NEVER,
    STATES,
    USBL,
    VELOCITY,
    WATER,
)
from auvbench.tasks.navigation.turns import turn, vector_of
from auvbench.worlds import solids
from benchmarks.navigation import band, shown
from tests.reference.navigation import Filter, skew

Floats = NDArray[np.float64]
EKF = ("algo=pid", "noise=none", "world=slope", "sensors=dvl_a50", "navigation=ekf")
MATCHED = (
    *("sensors.heading.bias=0", "sensors.heading.hard_iron=0", "sensors.heading.soft_iron=0"),
    *("sensors.depth.density=0", "sensors.depth.offset=0", "sensors.depth.resolution=0"),
    *("sensors.dvl.scale=0", "sensors.dvl.mounting=0", "sensors.dvl.lost=0", "sensors.dvl.delay=0"),
    *("sensors.imu.gyro.tau=1e8", "sensors.imu.accelerometer.tau=1e8", "navigation.gate=1"),
)
"""sensors whose errors are those of the filter's model"""
PERFECT = (
    *(
        f"sensors.imu.{part}.{key}=0"
        for part in ("gyro", "accelerometer")
        for key in ("density", "walk", "turn_on")
    ),
    *("sensors.heading.bias=0", "sensors.heading.hard_iron=0", "sensors.heading.soft_iron=0"),
    *(
        "sensors.heading.noise=1e-6",
        "sensors.heading.rate=0.1",
        "sensors.depth.rate=0.1",
        "sensors.dvl.lost=1",
    ),
    *(f"navigation.start.{key}=1e-6" for key in ("position", "velocity", "tilt")),
)
"""an IMU without errors, which no other sensor corrects for 10 s"""
POSITIONS = (
    *(
        "sensors.usbl.alignment=0",
        "sensors.usbl.outliers=0",
        "sensors.usbl.lost=0",
        "sensors.usbl.delay=0.79",
    ),
)
"""a USBL whose errors are those of the filter's model, and that is as late as it can be"""
LEARNING = "sensors.dvl.scale=0.05", "navigation.dvl_scale=true", "sensors.heading.bias=0.05", "navigation.heading_bias=true"  # fmt: skip
"""errors that are states of the filter"""
ON_WATER = "navigation=ekf_model", "sensors.dvl.water_track=true"
EAGER = "navigation.model.rate=10", "navigation.model.settling=0"
"""readings of the sheet at every step"""


def batch(*words: str, n: int = 2, **own: Any) -> Batch:
    return Batch(configuration(overrides=[*EKF, *words]), n, **own)


def play(one: Batch, steps: int) -> Floats:
    """Return the observations (steps + 1, n, size) of a play whose commands change each second."""
    rng, seen = np.random.default_rng(0), [one.reset().copy()]
    for step in range(steps):
        if step % 10 == 0:
            action = rng.uniform(-0.25, 0.25, one._action.shape)
        seen.append(one.step(action).observation.copy())
    return np.array(seen)


def estimator(one: Batch) -> Any:
    assert one.navigation is not None
    return one.navigation


def errors(one: Batch) -> Floats:
    """Return the errors (n, 15) of the filter's states."""
    d, pose = estimator(one).state, one.simulator.pose
    R = rotation(pose[:, 3:])
    apart = R @ np.swapaxes(rotation(d["attitude"]), 1, 2)
    turned = 0.5 * np.stack([apart[:, 2, 1] - apart[:, 1, 2], apart[:, 0, 2] - apart[:, 2, 0], apart[:, 1, 0] - apart[:, 0, 1]], 1)  # fmt: skip
    velocity = np.einsum("nij,nj->ni", R, one.simulator.velocity[:, :3])
    biases = [
        d[f"turn_on_{what}"] + d[f"walk_{what}"] - d[own]
        for what, own in (("acceleration", "acceleration_bias"), ("rates", "rate_bias"))
    ]
    return np.concatenate([pose[:, :3] - d["position"], velocity - d["velocity"], turned, *biases], 1)


def one_state(**values: Any) -> Any:
    """Return what an episode remembers, for functions that run as Python."""
    d = records.state(1, FIELDS, "test")[0]
    d.attitude[0] = 1.0
    for name, value in values.items():
        setattr(d, name, value)
    return d


def keys(**values: Any) -> Any:
    """Return parameters, for functions that run as Python."""
    return records.one_row(values, dict.fromkeys(records.PARAMETERS, 0), "test")[0]


# --- Sensors ------------------------------------------------------------------------------------------------------------------------


def test_a_velocity_is_the_least_squares_solution_of_the_valid_beams() -> None:
    tilt, rng = math.radians(22.5), np.random.default_rng(1)
    p = keys(dvl_sine=math.sin(tilt), dvl_cosine=math.cos(tilt))
    B = np.array([dvl.beam(p, i) for i in range(4)])
    assert np.linalg.norm(B, axis=1) == pytest.approx(1.0)
    assert (B[:, 2] < -0.9).all()
    for lost in (None, 0, 1, 2, 3):
        valid = np.array([i != lost for i in range(4)])
        u = rng.normal(size=4)
        d = one_state(valid=valid, beam_velocity=u)
        d.beams = valid.sum()
        np.testing.assert_allclose(dvl.solve(d, p), np.linalg.pinv(B[valid]) @ u[valid], atol=1e-12)
    # The figure of merit is the standard deviation of a horizontal velocity.
    d = one_state()
    d.merit = 0.02
    deviations = dvl.beam_sd(d, p) * np.sqrt(np.diag(np.linalg.inv(B.T @ B)))
    np.testing.assert_allclose(deviations, [0.02, 0.02, 0.02 * math.sqrt(0.5) * math.tan(tilt)], rtol=1e-12)


def test_pings_come_at_the_rate_of_the_altitude_and_no_echo_returns_from_too_far_or_too_flat() -> None:
    config = configuration(overrides=[*EKF])
    own = config.sensors.dvl
    assert own is not None
    p = keys(dvl_sine=math.sin(own.tilt), dvl_cosine=math.cos(own.tilt), dvl_low=own.low, dvl_high=own.high,
             dvl_flattest=math.cos(own.incidence),
             dvl_altitudes=own.altitudes, dvl_periods=[1.0 / rate for rate in own.rates])  # fmt: skip
    table = {0.3: 15.0, 0.6: 15.0, 2.0: 10.0, 10.0: 5.5, 20.0: 7.5, 49.0: 3.0, 0.0: 3.0}
    assert {altitude: 1.0 / dvl.period(p, altitude) for altitude in table} == pytest.approx(table)
    bottom = solids.plane([0.0, 0.0, -60.0], [0.0, 0.0, 1.0])

    def altitude(z: float, tilt: float = 0.0) -> float:
        R = rotation(quaternion([tilt, 0.0, 0.0]))
        return dvl.height_along(p, bottom, solids.NO_HEIGHTS, 0.0, (0.0, 0.0, z), tuple(R @ dvl.beam(p, 0)))

    assert altitude(-30.0) == pytest.approx(30.0)
    assert altitude(-9.0) == 0.0  # 51 m
    assert altitude(-59.98) == 0.0  # 2 cm
    assert altitude(-50.0, math.radians(30.0)) > 0.0
    assert altitude(-58.0, math.radians(65.0)) == 0.0  # beyond 70 degrees from the normal


def test_readings_have_the_errors_of_their_keys() -> None:
    """White noise by the density, biases by turn-on and Gauss-Markov walk, bursts by their share, in 1024 episodes at rest."""
    one = batch(
        *(
            "sensors=dvl_usbl",
            "sensors.usbl.lost=0.2",
            "sensors.usbl.outliers=0",
            "sensors.usbl.position=[9,-40,0]",
        ),
        "sensors.dvl.lost=0.2",
        "sensors.imu.gyro.tau=2",
        "sensors.imu.gyro.walk=0.01",
        "sensors.imu.gyro.density=0.01",
        n=1024,
    )
    one.reset()
    navigation, settings = estimator(one), one.config.sensors
    d, still = navigation.state, np.zeros_like(one._action)
    assert settings.imu
    assert settings.dvl
    locked = []
    for _ in range(100):
        one.step(still)
        locked.append((d["burst"] == 0).mean())
    assert (d["usbl_burst"] == 0).mean() == pytest.approx(0.8, abs=0.04)
    # At the last ping, which was now.
    now, boat = d["ping_time"] == d["time"], np.array([9.0, -40.0, 0.0])
    seen, true = (place[now] - boat for place in (d["fix"], d["true_position"]))
    r = np.linalg.norm(true, axis=1)
    assert np.std(np.linalg.norm(seen, axis=1) - r) == pytest.approx(0.1, rel=0.08)
    turned = np.arctan2(seen[:, 1], seen[:, 0]) - np.arctan2(true[:, 1], true[:, 0])
    away = np.std((turned - d["alignment"][now]) * np.linalg.norm(true[:, :2], axis=1) / r)
    assert away == pytest.approx(0.035, rel=0.08)
    assert d["alignment"].std() == pytest.approx(0.0524, rel=0.08)
    truth = np.linalg.norm(one.simulator.velocity[:, 3:], axis=1).max()
    assert truth < 0.5
    assert np.mean(locked[20:]) == pytest.approx(0.8, abs=0.02)
    root = math.sqrt(settings.imu.rate)
    white = d["rates"] - d["turn_on_rates"] - one.simulator.velocity[:, 3:]
    # After 10 s the walk is stationary: sigma sqrt(tau / 2).
    assert d["walk_rates"].std() == pytest.approx(0.01, rel=0.05)
    assert np.std(white - d["walk_rates"]) == pytest.approx(settings.imu.gyro.density * root, rel=0.05)
    assert d["turn_on_acceleration"].std() == pytest.approx(settings.imu.accelerometer.turn_on, rel=0.05)
    merits = np.log(d["merit"])
    low, high = math.log(settings.dvl.merit_low), math.log(settings.dvl.merit_high)
    assert merits.mean() == pytest.approx(0.5 * (low + high), abs=0.1)
    assert merits.std() == pytest.approx((high - low) / math.sqrt(12.0), rel=0.05)
    depth = d["height"] - d["true_position"][:, 2]
    expected = math.hypot(settings.depth.offset, settings.depth.density * 20.0)  # type: ignore[union-attr]
    assert depth.std() == pytest.approx(expected, rel=0.1)
    assert np.allclose(np.round(d["height"] / 0.002) * 0.002, d["height"])


def test_without_lock_on_the_bottom_a_ping_measures_relative_to_a_layer_of_the_water() -> None:
    """Also with a current that changes with the depth; where the bottom is in the layer, no beam measures."""
    merit = "sensors.dvl.merit_low=0.02", "sensors.dvl.merit_high=0.02"
    one = batch(*ON_WATER, *MATCHED, *merit, "sensors.dvl.lost=1", n=1024, autoreset=False)
    one.reset()
    simulator, navigation, top = one.simulator, estimator(one), np.array([0.4, -0.3, 0.05])
    simulator.set_current(top, -top, (0.0, 100.0))
    rng = np.random.default_rng(5)
    simulator.velocity[:] = rng.normal(0.0, 0.3, (1024, 6))
    simulator.pose[:, 2] = -50.0
    simulator.pose[:, 3:] = quaternion(rng.normal(0.0, 0.2, (1024, 3)))
    own, d, lever = one.config.sensors.dvl, navigation.state, np.array([0.0, 0.0, -0.1])
    assert own is not None
    bottom = one.task.world.solids[:, 0]  # type: ignore[union-attr]
    bottom["position"] = simulator.pose[:, :3] + [0.0, 0.0, -200.0]
    bottom["position"][:8, 2] = -52.0  # in the layer
    navigation.begin(np.arange(1024), simulator)
    d["due"][:, DVL] = 0.0
    navigation.sample(simulator, 0.02)
    assert (d["on_water"] == 1).all()
    assert (d["beams"] == [0] * 8 + [4] * 1016).all()
    np.testing.assert_allclose(d["dvl_period"], 0.5)
    R = rotation(simulator.pose[:, 3:])
    z = simulator.pose[:, 2] + R[:, 2] @ lever - 3.0  # of the middle of the layer
    current = top * (1.0 + 2.0 * z[:, None] / 100.0)
    through = np.einsum("nji,nj->ni", R, np.einsum("nij,nj->ni", R, simulator.velocity[:, :3]) - current)
    apart = (d["dvl_velocity"] - through - np.cross(simulator.velocity[:, 3:], lever))[8:]
    sd = 1.5 * 0.02 * np.array([1.0, 1.0, math.sqrt(0.5) * math.tan(own.tilt)])
    np.testing.assert_allclose(apart.std(0), sd, rtol=0.08)
    np.testing.assert_allclose(apart.mean(0), 0.0, atol=0.003)
    # It is no velocity over ground: neither its age, nor the time without lock, nor other programs take it for one.
    assert (d["stamp"][8:, WATER] > 0.0).all()
    assert (d["stamp"][:, DVL] < 0.0).all()
    assert (d["arrives"][:, DVL] == NEVER).all()
    one.step(np.zeros_like(one._action))
    assert navigation.columns(16)["unlocked_share"] == 1.0
    assert "dvl" not in readings(navigation, 16)


def test_waves_press_on_the_depth_sensor_and_thrusters_turn_the_compass() -> None:
    """The readings of the last step of 40 episodes, against the sums of the wave's components in plain NumPy."""
    words = "sensors.depth.noise=1e-3", "sensors.heading.noise=1e-3", "sensors.heading.thrusters=0.01"
    one = batch("disturbance=sea_state_3", "task.start=[0,0,-5]", *MATCHED, *words, n=40)
    one.reset()
    for _ in range(30):
        one.step(np.full_like(one._action, 0.3))
    d, sea = estimator(one).state, one.simulator.waves  # type: ignore[attr-defined]
    rays = np.concatenate([*np.moveaxis(sea.rays, -1, 1)])[: one.n]  # (n, m, 3)
    turns, frequency, speed = sea.components.T
    cosine, sine, phase = np.moveaxis(rays, -1, 0)
    x, y, z = d["true_position"].T
    along = cosine * x[:, None] + sine * y[:, None]
    swell = np.cos(2.0 * np.pi * (turns * along - frequency * d["time"][:, None] + phase))
    head = np.sum(
        speed / (2.0 * np.pi * frequency) * np.exp(2.0 * np.pi * turns * z[:, None]) * swell, axis=1
    )
    assert head.std() > 0.05
    assert d["wave_variance"].mean() == pytest.approx(np.mean(head**2), rel=0.6)
    assert not d["diverged"].any()
    np.testing.assert_allclose(d["height"] - z, -head, atol=5e-3)
    w, i, j, k = d["true_attitude"].T
    yaw = np.arctan2(2.0 * (w * k + i * j), 1.0 - 2.0 * (j * j + k * k))
    amperes = one.simulator.power / 16.0
    assert amperes.min() > 2.0
    turned = np.angle(np.exp(1j * (d["heading"] - yaw)))
    np.testing.assert_allclose(turned, 0.01 * amperes * np.cos(yaw + d["thruster_phase"]), atol=5e-3)
    assert np.ptp(d["thruster_phase"]) > 4.0


def test_a_filter_that_knows_the_waves_is_nearer_to_the_depth_than_the_sensor() -> None:
    one = batch("disturbance=sea_state_4", "task.start=[0,0,-6]", n=40)
    one.reset()
    d, still = estimator(one).state, np.zeros_like(one._action)
    read, estimated = [], []
    for step in range(200):
        one.step(still)
        if step > 50:
            z = d["true_position"][:, 2]
            read.append(d["height"] - z)
            estimated.append(d["position"][:, 2] - z)
    assert np.std(read) > 0.2
    assert np.std(estimated) < 0.5 * np.std(read)
    assert d["nis"][:, DEPTH].sum() / d["innovations"][:, DEPTH].sum() < 2.0


# --- Filter -------------------------------------------------------------------------------------------------------------------------


def test_small_turns_are_exact() -> None:
    for size in (1e-9, 1e-4, 0.03, 0.032, 1.0, 3.0):
        vector = size * np.array([0.6, -0.48, 0.64])
        w = math.cos(0.5 * size)
        assert turn(tuple(vector)) == pytest.approx(
            (w, *(math.sin(0.5 * size) / size * vector)), rel=1e-14, abs=1e-15
        )
        np.testing.assert_allclose(vector_of(turn(tuple(vector))), vector, rtol=1e-12)
        np.testing.assert_allclose(vector_of(tuple(-np.array(turn(tuple(vector))))), vector, rtol=1e-12)


ALL_STATES = MODEL_STATES + 8
"""states with a current, the DVL's scale, the compass's constant error, the position at a ping and at a message"""


def shifted(d: Any, x: Floats, p: Any) -> Any:
    """Return a state whose truth is the errors x (25,) away from it."""
    other, work = copy.deepcopy(d), ekf.work_in(np.zeros((ekf.WORK, len(x))))
    work.change[:] = x
    ekf.inject(other, p, np.zeros((len(x), len(x))), work)
    return other


def apart(one: Any, other: Any) -> Floats:
    """Return the errors (15,) of a state against another."""
    R = rotation(other.attitude) @ rotation(one.attitude).T
    turned = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    parts = [getattr(other, name) - getattr(one, name) for name in ("position", "velocity", "acceleration_bias", "rate_bias")]  # fmt: skip
    return np.concatenate([*parts[:2], turned, *parts[2:]])


def test_derivatives_are_those_of_finite_differences() -> None:
    rng, small = np.random.default_rng(2), 1e-5
    p = keys(gravity=9.81, dvl_lever=[0.3, -0.2, -0.1], accelerometer_density=0.0, gyro_density=0.0,
             accelerometer_walk=0.0, gyro_walk=0.0, inflation=1.0, current_end=MODEL_STATES, scale_state=MODEL_STATES,
             bias_state=MODEL_STATES + 1, ping_state=MODEL_STATES + 2, modem_state=MODEL_STATES + 5)  # fmt: skip
    d = one_state(position=rng.normal(size=3), velocity=rng.normal(size=3), attitude=quaternion([0.3, -0.5, 2.0]),
                  acceleration_bias=0.1 * rng.normal(size=3), rate_bias=0.1 * rng.normal(size=3), rates=rng.normal(size=3),
                  current=[0.3, -0.2], scale=0.1, bias=0.2, ping_position=[5.0, -3.0, -4.0], range_position=[2.0, 3.0, -9.0], beacon=[4.0, 1.0, -9.5], specific_force=rng.normal(size=3) + np.array([0.0, 0.0, 9.81]))  # fmt: skip
    work, way = ekf.work_in(np.zeros((ekf.WORK, ALL_STATES))), (0.36, 0.48, -0.8)

    def check(reading: Any) -> None:
        slopes = [(reading(shifted(d, small * x, p)) - reading(shifted(d, -small * x, p))) / (2 * small) for x in np.eye(ALL_STATES)]  # fmt: skip
        np.testing.assert_allclose(work.slope, slopes, atol=1e-8)

    def heading(state: Any) -> float:
        R = rotation(state.attitude)
        return math.atan2(R[1, 0], R[0, 0]) + float(state.bias)

    ekf.velocity_row(d, p, way, work)
    check(lambda state: np.dot(way, dvl.predicted(state, p)))
    d.on_water = 1
    ekf.velocity_row(d, p, way, work)
    check(lambda state: np.dot(way, dvl.predicted(state, p)))
    ekf.heading_row(d, p, work)
    check(heading)
    model.put_derivatives(d, way, work)
    check(lambda state: np.dot(way, model.predicted(state)))
    boat = np.array([1.0, 2.0, 0.0])
    lines, r = usbl.sight(tuple(d.ping_position - boat))
    np.testing.assert_allclose(np.array(lines) @ np.array(lines).T, np.eye(3), atol=1e-12)
    ekf.put_sight(p, lines[0], work)
    check(lambda state: np.linalg.norm(state.ping_position - boat))
    for line in lines[1:]:  # an angle times the range
        ekf.put_sight(p, line, work)
        check(lambda state, line=line: r * math.asin(np.dot(line, state.ping_position - boat) / r))

    modem.put_derivatives(p, modem.sight(d)[0], work)
    check(lambda state: np.linalg.norm(state.range_position - state.beacon))

    # The transition of ten samples, whose sums are first order in the turn of the vehicle.
    def after(state: Any) -> Any:
        moved = copy.deepcopy(state)
        for _ in range(10):
            force, R = imu.advance(moved, p, 0.01)
            ekf.collect(moved, force, R, 0.01)
        return moved

    end = after(d)
    R, C = ekf.integrals(end)
    for x in np.eye(STATES):
        shift = small * np.concatenate([x, np.zeros(ALL_STATES - STATES)])
        slope = apart(after(shifted(d, -shift, p)), after(shifted(d, shift, p))) / (2 * small)
        position, velocity, attitude, force, rates = (tuple(part) for part in x.reshape(5, 3))
        own = ekf.carried(end.elapsed, R, C, position, velocity, attitude, force, rates)
        np.testing.assert_allclose(np.concatenate([*own, x[9:]]), slope, atol=4e-3)


def test_the_sum_of_perfect_imu_samples_is_the_motion() -> None:
    one = batch(*PERFECT)
    play(one, 60)
    assert np.abs(one.simulator.velocity).max() > 0.3
    np.testing.assert_allclose(estimator(one).pose, one.simulator.pose, atol=6e-4)
    np.testing.assert_allclose(estimator(one).velocity[:, :3], one.simulator.velocity[:, :3], atol=6e-4)


def test_the_compiled_filter_agrees_with_one_in_plain_numpy() -> None:
    words = "sensors=dvl_usbl", *ON_WATER, *MATCHED, *POSITIONS, *EAGER, *LEARNING, "sensors.dvl.lost=0.3"
    one = batch(*words, n=1, seed=4)
    one.reset()
    one.simulator.set_current([0.2, -0.1, 0.0])
    navigation = estimator(one)
    d, p = navigation.state[0], navigation.parameters[0]
    own = Filter(
        (d.position, d.velocity, rotation(d.attitude)),
        navigation.covariance[0],
        (p.accelerometer_density, p.gyro_density, p.accelerometer_walk, p.gyro_walk, p.model_walk),
    )
    lever, sample, counted = np.array(p.dvl_lever), navigation.sample, []
    boat = np.array(p.usbl_position)

    def watched(simulator: Any, seconds: float, *rows: int) -> None:
        had, pinged = np.array(d.innovations), float(d.ping_time)
        sample(simulator, seconds, *rows)
        own.move(np.array(d.specific_force), np.array(d.rates), seconds, p.gravity)
        came = np.array(d.innovations) - had
        if came[1]:
            own.height(d.height, p.depth_noise)
        if came[2]:
            own.heading(d.heading, p.heading_noise)
        if came[DVL] or came[WATER]:
            factor = 1.5 if came[WATER] else 1.0
            sd = factor * d.merit * np.array([1.0, 1.0, math.sqrt(0.5) * p.dvl_sine / p.dvl_cosine])
            own.velocity(d.dvl_velocity, d.rates, lever, np.diag(sd**2), bool(came[WATER]))
        if d.ping_time > pinged:
            own.ping()
        if came[USBL]:
            own.fix(d.fix, boat, p.usbl_range_noise, p.usbl_angle_noise)
        counted.append(came)

    navigation.sample = watched
    rng = np.random.default_rng(3)
    for _ in range(100):
        one.step(rng.uniform(-0.4, 0.4, one._action.shape))
        seen = navigation.sheet.velocity[0, :3]
        own.through_water(seen, math.hypot(p.model_noise, p.model_share * float(np.linalg.norm(seen))))
    assert (np.sum(counted, axis=0)[:MODEL] >= 100).all()
    assert d.innovations[WATER] >= 12
    assert d.innovations[USBL] == 27  # three of each fix, of which the tenth is still under way
    assert d.innovations[MODEL] == 300
    np.testing.assert_allclose(d.position, own.p, atol=2e-4)
    np.testing.assert_allclose(d.velocity, own.v, atol=2e-4)
    np.testing.assert_allclose(rotation(d.attitude), own.R, atol=2e-4)
    np.testing.assert_allclose(d.rate_bias, own.b_w, atol=2e-5)
    np.testing.assert_allclose(d.current, own.c, atol=2e-4)
    np.testing.assert_allclose([d.scale, d.bias], [own.k, own.b], atol=2e-4)
    np.testing.assert_allclose(d.ping_position, own.q, atol=2e-4)
    assert np.abs([d.scale, d.bias]).min() > 0.002
    scale = np.sqrt(np.diag(own.P))
    np.testing.assert_allclose(
        navigation.covariance[0] / np.outer(scale, scale), own.P / np.outer(scale, scale), atol=0.05
    )
    assert skew([1.0, 2.0, 3.0]) @ [1.0, 2.0, 3.0] == pytest.approx(0.0)


def run(*words: str) -> None:
    assert main(list(words)) == 0


def test_a_controller_is_trained_and_tested_on_estimates(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = [f"output={tmp_path}", "name=navigation"]
    run("train", *EKF, *out, "task.max_steps=60", "train.progress=false")
    assert capsys.readouterr().out.endswith(" protocol=own\n")
    folder = str(tmp_path / "navigation")
    assert main(["evaluate", folder]) == 2  # the default protocol has errors of the readings
    assert "protocol=own tests a run in its own task" in capsys.readouterr().err
    run("evaluate", folder, "protocol=navigation", "protocol.episodes=2", "protocol.trajectories=0")
    (file,) = tmp_path.rglob("evaluations/*/episodes.csv")
    rows = pd.read_csv(file)
    assert rows.condition.nunique() == 11
    true, dead = rows.condition == "truth", rows.condition == "dead-reckoning"
    assert rows.navigation_drift[true].isna().all()
    assert (rows.navigation_drift[~true] > 0.0).all()
    assert (rows.nees[~true & ~dead] > 0.0).all()
    assert rows.nees[dead].isna().all()
    assert (rows.diverged[~true] == 0.0).all()
    assert (rows.unlocked_share[rows.condition == "half-lock"] > 0.1).all()


def consistency(*words: str, sensors: tuple[int, ...] = (DVL, DEPTH, HEADING)) -> Floats:
    """Return NEES per state and NIS of some sensors (1 + sensors, 128), means over each of 128 episodes of 40 s; in a current if the
    filter estimates it.
    """
    one = batch(*MATCHED, "task.max_steps=100000", *words, n=128, autoreset=False)
    rng, nees = np.random.default_rng(0), []
    one.reset()
    if one.config.navigation.name == "ekf_model":
        current = np.random.default_rng(1).normal(0.0, 0.25, (128, 3))
        one.simulator.set_current(current * [1.0, 1.0, 0.0])
    for step in range(400):
        if step % 10 == 0:
            action = rng.uniform(-0.25, 0.25, one._action.shape)
        one.step(action)
        if step % 40 == 39:
            x = errors(one)
            inverse = np.linalg.inv(estimator(one).covariance[:, :STATES, :STATES])
            nees.append(np.einsum("ni,nij,nj->n", x, inverse, x) / STATES)
    d = estimator(one).state
    nis = (d["nis"] / np.maximum(d["innovations"], 1.0)).T[[*sensors]]
    return np.array([np.mean(nees, axis=0), *nis])


def test_a_filter_that_knows_its_sensors_is_consistent_and_one_that_does_not_is_not() -> None:
    for values in consistency():
        _, half = band(values)
        assert shown(values).endswith(" inside")
        assert half < 0.05
    # Without lock on the bottom and without the sheet: what the DVL measures is relative to the water, whose current is estimated.
    alone = *ON_WATER, "sensors.dvl.lost=1", "navigation.model.settling=1e4", "navigation.model.walk=0"
    nees, none, *others = consistency(*alone, sensors=(DVL, WATER, DEPTH, HEADING))
    assert (none == 0.0).all()
    for values in (nees, *others):
        mean, half = band(values)
        assert half < 0.05
        assert mean == pytest.approx(1.0, abs=0.05)
    for values in consistency("navigation.inflation=0.3333333333"):  # noise three times as large as assumed
        mean, half = band(values)
        assert shown(values).endswith(" outside")
        assert mean - half > 3.0


def test_a_filter_with_late_positions_and_more_states_is_consistent() -> None:
    """Positions of 0.8 s ago correct the present: the filter remembers where it believed the vehicle to be."""
    learning = "sensors=dvl_usbl", *POSITIONS, "sensors.dvl.scale=0.05", "navigation.dvl_scale=true"
    for values in consistency(
        *learning, "navigation.start.position=0.5", sensors=(DVL, DEPTH, HEADING, USBL)
    ):
        mean, half = band(values)
        assert half < 0.05
        assert mean == pytest.approx(1.0, abs=0.05)


def test_a_gate_rejects_positions_by_multipath() -> None:
    """Three of ten are off by 20 m, and in a burst none comes."""
    errors = {}
    for gate in (0.999, 1.0):
        words = "sensors.usbl.outliers=0.3", "sensors.usbl.outlier=20", f"navigation.gate={gate}"
        one = batch("sensors=dvl_usbl", *words, n=64, autoreset=False)
        one.reset()
        d = estimator(one).state
        for _ in range(200):
            one.step(np.zeros_like(one._action))
        away = estimator(one).pose[:, :3] - one.simulator.pose[:, :3]
        errors[gate] = math.sqrt(np.mean(away**2))
        assert d["innovations"][:, USBL].max() == 57
        assert d["innovations"][:, USBL].min() < 50
    assert errors[0.999] < 0.5 * errors[1.0]
    assert errors[0.999] < 1.0


def test_satellites_are_seen_at_the_surface_only() -> None:
    one = batch("sensors=gnss", "sensors.gnss.depth=2", "sensors.gnss.offset=0", n=64, autoreset=False)
    one.reset()
    navigation = estimator(one)
    one.simulator.pose[:32, 2] = -1.0
    one.simulator.pose[32:, 2] = -5.0
    navigation.begin(np.arange(64), one.simulator)
    navigation.state["position"][:, 0] += 3.0
    navigation.covariance[:, 0, 0] = 9.0
    for _ in range(50):
        one.step(np.zeros_like(one._action))
    d, error = navigation.state, navigation.pose[:, :2] - one.simulator.pose[:, :2]
    assert (d["innovations"][:32, GNSS] == 50).all()
    assert (d["innovations"][32:, GNSS] == 0).all()
    assert np.abs(error[:32]).max() < 1.0
    assert np.median(np.abs(error[32:, 0])) > 2.0


def test_the_sheet_carries_the_estimate_while_the_dvl_is_lost() -> None:
    """In a current, too: the filter knows it from before. A DVL that measures relative to the water helps vehicles that are not as
    their sheet.
    """
    errors = {}
    kinds = {"ekf": (), "ekf_model": ("navigation=ekf_model",), "water track": ON_WATER}
    for kind, words in kinds.items():
        one = batch(*words, n=32, autoreset=False)
        one.reset()
        one.simulator.set_current([0.3, -0.2, 0.0])
        one.simulator.effectiveness[:8, 0] = 0.5  # of the vehicle, which the sheet does not know
        navigation, rng = estimator(one), np.random.default_rng(0)
        for step in range(700):
            if step == 400:
                navigation.parameters["dvl_lost"] = 1.0
            if step % 20 == 0:
                action = rng.uniform(-0.4, 0.4, one._action.shape)
            one.step(action)
        errors[kind] = np.linalg.norm(navigation.pose[:, :2] - one.simulator.pose[:, :2], axis=1)
    assert navigation.state["current"].mean(0) == pytest.approx([0.3, -0.2], abs=0.05)
    assert (navigation.sheet.simulator.effectiveness == 1.0).all()
    assert np.median(errors["ekf_model"]) < 0.2 * np.median(errors["ekf"])
    assert errors["ekf_model"].max() < 5.0
    assert np.median(errors["water track"][:8]) < np.median(errors["ekf_model"][:8])


def test_an_estimate_that_diverges_is_recorded_and_stands_still() -> None:
    one = batch()
    play(one, 3)
    d = estimator(one).state
    d["velocity"][0] = np.nan
    before = estimator(one).pose[0].copy()
    seen = [one.step(np.zeros_like(one._action)).observation.copy() for _ in range(3)]
    assert np.isfinite(seen).all()
    np.testing.assert_array_equal(estimator(one).pose[0], before)
    assert [estimator(one).columns(i)["diverged"] for i in range(2)] == [1.0, 0.0]
    assert np.isfinite(list(estimator(one).columns(0).values())).all()


# --- In the loop --------------------------------------------------------------------------------------------------------------------


def test_an_estimate_of_one_axis_that_is_far_off_comes_back() -> None:
    """The gate rejects each axis of a DVL apart: the others, which pass it, do not count for the one that fails."""
    one = batch("sensors.dvl.lost=0")
    one.reset()
    estimator(one).state["velocity"][:, 0] += 3.0
    for _ in range(160):
        one.step(np.zeros_like(one._action))
    error = estimator(one).velocity[:, :3] - one.simulator.velocity[:, :3]
    assert np.abs(error).max() < 0.5


def test_observations_come_from_the_estimate_and_rewards_from_the_truth() -> None:
    one, true = batch(), Batch(configuration(overrides=[*EKF, "sensors=none", "navigation=truth"]), 2)
    seen, real = play(one, 30), play(true, 30)
    # The IMU's samples split a step in parts, which rounds differently.
    np.testing.assert_allclose(one.simulator.pose, true.simulator.pose, atol=1e-9)
    np.testing.assert_allclose(one.task.reward, true.task.reward, atol=1e-9)
    spec, pose, velocity = one.task.spec, estimator(one).pose, estimator(one).velocity
    np.testing.assert_allclose(seen[-1][:, spec["velocity"]], velocity[:, :3], atol=1e-6)
    np.testing.assert_allclose(seen[-1][:, spec["gravity"]], -rotation(pose[:, 3:])[:, 2], atol=1e-6)
    away = one.task.reference - pose[:, :3]
    np.testing.assert_allclose(
        np.linalg.norm(seen[-1][:, spec["position_error"]], axis=1), np.linalg.norm(away, axis=1), rtol=1e-5
    )
    assert np.abs(seen - real)[..., spec["position_error"]].max() > 0.02
    assert spec.bounds[spec["position_error"]].min() > 1000.0


def test_a_moving_reference_follows_the_estimate_and_range_sensors_the_truth() -> None:
    """In terrain following the reference is at the depth of the vehicle, as far as the vehicle knows."""
    words = (
        "task=terrain",
        "world=slope",
        "task.observation=[position_error,yaw_error,velocity,range.ping1d,specific_force,sensor_age,position_sd]",
    )
    one = batch(
        *words, "task.range.ping1d.noise=0", "task.range.ping1d.dropout=0", "task.range.ping1d.jumps=0"
    )
    one.task.interpret()
    seen = play(one, 12)[-1]
    spec, d = one.task.spec, estimator(one).state
    assert np.abs(estimator(one).pose[:, 2] - one.simulator.pose[:, 2]).max() > 1e-3
    np.testing.assert_allclose(seen[:, spec["position_error"]][:, 2], 0.0, atol=1e-6)
    distance = seen[:, spec["range.ping1d"]][:, 0]
    assert (distance > 0.0).all()
    along = one.task.world.solids[:, 0]["along_z"]  # type: ignore[union-attr]
    height = np.einsum("ni,ni->n", one.simulator.pose[:, :3] - one.task.world.solids[:, 0]["position"], along)  # type: ignore[union-attr]
    assert (np.abs(distance - height) < 1.0).all()
    np.testing.assert_allclose(seen[:, spec["specific_force"]], d["specific_force"], rtol=1e-6)
    variance = np.diagonal(estimator(one).covariance, axis1=1, axis2=2)[:, :3]
    np.testing.assert_allclose(seen[:, spec["position_sd"]], np.sqrt(variance), rtol=1e-5)
    assert (seen[:, spec["sensor_age"]][:, 1:] < 0.11).all()


def test_copies_and_restored_states_go_on_with_the_same_bits() -> None:
    words = "navigation=ekf_model", *EAGER
    one = batch(*words)
    play(one, 7)
    state, other, unpickled = one.state_dict(), batch(*words), pickle.loads(pickle.dumps(one))
    play(other, 2)
    other.load_state_dict(state)
    action = np.full_like(one._action, 0.1)
    for _ in range(5):
        seen = one.step(action).observation.copy()
        np.testing.assert_array_equal(other.step(action).observation, seen)
        np.testing.assert_array_equal(unpickled.step(action).observation, seen)


def test_disturbances_and_dead_reckoning_run_and_episodes_have_their_columns() -> None:
    words = (
        "navigation=dead_reckoning",
        "disturbance=current",
        "disturbance.delay.action=0.13",
        "task.max_steps=20",
    )
    one = batch(*words)
    one.reset()
    ended: list[Any] = []
    while not ended:
        ended = one.step(np.full_like(one._action, 0.1)).records
    columns = {"navigation_error_rms_m", "navigation_drift", "unlocked_share", "diverged"}
    assert columns <= ended[0].keys()
    assert "nees" not in ended[0]
    assert 0.0 < ended[0]["navigation_error_rms_m"] < 5.0
    assert not columns & {*record.record_columns("waypoint", "slope")}
    assert "nees" in record.record_columns("waypoint", "slope", "ekf")


def test_only_a_changed_navigation_changes_the_id_of_a_run() -> None:
    def named(*words: str) -> str:
        return run_id(
            resolved(compose("train", ["algo=pid", "noise=none", "world=slope", *words], folder=None))
        )

    assert named() == named("sensors=none", "navigation=truth")
    ids = {named("sensors=dvl_a50", "navigation=ekf"), named("sensors=survey", "navigation=ekf"), named()}
    assert len(ids) == 3
    assert VELOCITY == 3
    assert named("sensors=dvl_usbl", "navigation=ekf").endswith(
        "-e778ac9a"
    )  # as before transponders were counted


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["noise=thesis"], r"noise.position.high=0.1: must be 0 with navigation=ekf, whose sensors have their own errors; use noise=none"),
        (["disturbance=sensor"], "disturbance.sensor: must be 0 with navigation=ekf"),
        (["disturbance.delay.observation=0.1"], r"disturbance.delay.observation=0.1: must be 0 with navigation=ekf"),
        (["sensors=none"], "needs sensors.imu, which sensors=none does not have; use sensors=bluerov2, dvl_a50 or survey"),
        (["sensors=bluerov2", "navigation=dead_reckoning"], "needs sensors.dvl, which sensors=bluerov2 does not have"),
        (["world=open"], "sensors.dvl: needs a bottom, and world=open has none; use world=seabed"),
        (["world=field", "task=docking"], "sensors.dvl: needs a bottom, and world=field has none"),
        (["navigation=truth"], "sensors=dvl_a50: navigation=truth reads no sensor"),
        (["world=open", "sensors=bluerov2", "simulator=gazebo"], "simulator=gazebo does not simulate navigation sensors"),
        (["sensors.imu.rate=200"], r"sensors.imu.rate=200: must be at most 100 Hz, the rate of the physics"),
        (["sensors.depth.rate=51"], "sensors.depth.rate=51: must be at most 50 Hz, the rate of the IMU"),
        (["sensors.depth.delay=0.2"], "sensors.depth.delay=0.2: must be at most 0.1 s"),
        (["sensors.dvl.rates=[5]"], "sensors.dvl.rates=.*for each of the 5 entries"),
        (["sensors.dvl.merit_low=1"], "sensors.dvl.merit_low=1: must be at most sensors.dvl.merit_high=0.175"),
        (["sensors=usbl", "sensors.usbl.delay=0.9"], r"sensors.usbl.delay=0.9: must be at most 0.8 s: the interval between pings, 1/rate = 1 s, less the travel time"),
        (["sensors=usbl", "sensors.usbl.rate=10"], r"sensors.usbl.rate=10: must be at most 5 Hz for reach=300"),
        (["sensors=usbl", "sensors.usbl.position=[0,0]"], r"sensors.usbl.position=\[0.0, 0.0\]: must be three numbers"),
        (["sensors=dvl_usbl", "navigation=dead_reckoning"], "sensors.usbl: navigation=dead_reckoning cannot use positions; use navigation=ekf"),
        (["sensors=gnss"], "sensors.gnss.depth=0.3: the vehicle stays below task.depth_high=-1"),
        (["sensors=usbl", "navigation.dvl_scale=true"], "navigation.dvl_scale=true: sensors=usbl has no DVL with a scale"),
        (["navigation.heading_bias=true"], "navigation.heading_bias=true: sensors=dvl_a50 measures no positions, without which the bias is unobservable; use sensors=dvl_usbl"),
        (["sensors.dvl.water_track=true"], "sensors.dvl.water_track=true: navigation=ekf does not estimate the current.*use navigation=ekf_model, or sensors.dvl.water_track=false"),
        ([*ON_WATER, "sensors.dvl.water_near=5"], "sensors.dvl.water_near=5: must be at most sensors.dvl.water_far=4.5"),
        ([*ON_WATER, "sensors.dvl.water_rate=60"], "sensors.dvl.water_rate=60: must be at most 50 Hz, the rate of the IMU"),
        (["sensors.dvl.high=80"], "sensors.dvl.altitudes=.*must be in rising order, up to sensors.dvl.high=80"),
        (["sensors=none", "navigation=truth", "task.observation=[position_error,yaw_error,sensor_age]"], "sensor_age needs an estimator"),
        (["navigation=dead_reckoning", "task.observation=[position_error,yaw_error,position_sd]"], "position_sd needs a covariance"),
        (["navigation=ekf_model", "navigation.model.rate=20"], "navigation.model.rate=20: must be at most 10 Hz, the rate of the agent's steps"),
        (["navigation=kalman"], "navigation=kalman: no such option"),
        (["navigation.gate=0"], "navigation.gate=0: must be at least 0.5"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused_in_one_line(words: list[str], message: str) -> None:
    with pytest.raises(ConfigError, match=message) as caught:
        configuration(overrides=[*EKF, *words])
    assert "\n" not in str(caught.value)
