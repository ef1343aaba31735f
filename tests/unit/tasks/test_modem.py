"""Ranges of messages that correct the estimates of a team, against NumPy and against the truth."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from auvbench.agents import base as agents
from auvbench.dynamics.frames import quaternion
from auvbench.envs.batch import Batch
from auvbench.tasks import records
from auvbench.tasks.navigation import ekf, modem
from auvbench.tasks.navigation.state import ATTITUDE, FIELDS, MODEL_STATES, MODEM
from tests import configs
from tests.reference.navigation import skew

Floats = NDArray[np.float64]
RANGING = (
    "algo=pid",
    "task=formation",
    "vehicle=bluerov2_heavy",
    "sensors=team",
    "navigation=ekf_model",
    "noise=none",
)
FOUR = "task.vehicles=4", "sensors.modem.beacons=2", "sensors.usbl.vehicles=2"
MATCHED = (
    *("sensors.heading.bias=0", "sensors.heading.hard_iron=0", "sensors.heading.soft_iron=0"),
    *("sensors.depth.density=0", "sensors.depth.offset=0", "sensors.depth.resolution=0"),
    *("sensors.imu.gyro.tau=1e8", "sensors.imu.accelerometer.tau=1e8"),
    *("sensors.usbl.alignment=0", "sensors.usbl.outliers=0", "sensors.usbl.lost=0"),
)
"""sensors whose errors are those of the filter's model"""


def team(*words: str, n: int, seed: int = 5) -> tuple[Batch, Any]:
    batch = Batch(configs.training(*RANGING, *words), n, seed=seed, autoreset=False)
    batch.reset()
    assert batch.navigation is not None
    return batch, batch.navigation


def test_a_range_corrects_all_states_as_a_dense_kalman_filter_does() -> None:
    rng, k, n = np.random.default_rng(4), MODEL_STATES, MODEL_STATES + 3
    shared = dict.fromkeys(records.PARAMETERS, 0)
    values: dict[str, Any] = {
        "modem_state": k,
        "current_end": MODEL_STATES,
        "scale_state": 0,
        "bias_state": 0,
        "ping_state": 0,
        "inflation": 1.0,
        "gate": math.inf,
        "modem_noise": 0.06,
        "modem_memory": 10.0,
    }
    p = records.one_row(values, shared, "test")[0]
    d = records.state(1, FIELDS, "test")[0]
    root = 0.1 * rng.normal(size=(n, n))
    P, S = root @ root.T, np.diag([0.04, 0.09, 0.01]) + 0.01
    d.attitude, d.range_position, d.beacon, d.stated = quaternion([0.1, -0.2, 2.0]), [3.0, 1.0, -20.0], [0.5, 3.0, -20.5], S  # fmt: skip
    d.measured_range, d.sent, d.speaker, d.beacon_sent = 3.5, 6.0, 1, [-1.0, 4.5, *[-1.0] * 6]
    way = np.subtract(d.range_position, d.beacon)
    r = np.linalg.norm(way)
    u = way / r
    H = np.zeros(n)
    H[k:] = u
    across = np.trace(P[k:, k:] + S) - u @ (P[k:, k:] + S) @ u
    kept = math.exp(-1.5 / 10.0)
    noise = 0.06**2 + 0.75 * (across / r) ** 2 + (1.0 + kept) / (1.0 - kept) * (u @ S @ u)
    K = P @ H / (H @ P @ H + noise)
    x = K * (3.5 - r)
    G = np.eye(n)
    G[ATTITUDE : ATTITUDE + 3, ATTITUDE : ATTITUDE + 3] += 0.5 * skew(x[ATTITUDE : ATTITUDE + 3])
    expected = G @ (P - np.outer(K, H @ P)) @ G.T
    velocity, place = np.array(d.velocity) + x[3:6], np.array(d.range_position) + x[k:]
    own = P.copy()
    modem.correct(d, p, own, ekf.work_in(np.zeros((ekf.WORK, n))))
    np.testing.assert_allclose(own, expected, atol=1e-12)
    np.testing.assert_allclose(d.position, x[:3], atol=1e-12)
    np.testing.assert_allclose(d.velocity, velocity, atol=1e-12)
    np.testing.assert_allclose(d.range_position, place, atol=1e-12)
    np.testing.assert_allclose(d.current, x[15:17], atol=1e-12)
    assert d.beacon_sent[1] == d.stamp[MODEM] == 6.0


@pytest.mark.slow
def test_ranges_are_of_true_distances_and_messages_say_estimates() -> None:
    """Of beacons alone, late, and lost with the message of the observation."""
    one, navigation = team("task.message_loss=0.3", "sensors.usbl.lost=0", n=16)
    d, task = navigation.state, one.task
    sample, errors, pending = navigation.sample, [], np.full(one.n, -1.0)

    def watched(simulator: Any, seconds: float, *rows: int) -> None:
        sent = np.array(d["sent"])
        sample(simulator, seconds, *rows)
        for i in np.flatnonzero(d["sent"] > sent):
            leader = i - i % 3
            assert i != leader
            assert d["time"][i] - seconds < (d["turn"][i] - 1) * one.config.task.turn_time + 1e-6
            errors.append(
                d["measured_range"][i] - np.linalg.norm(simulator.pose[i, :3] - simulator.pose[leader, :3])
            )
            np.testing.assert_array_equal(d["beacon"][i], d["position"][leader])
            np.testing.assert_array_equal(d["stated"][i], navigation.covariance[leader, :3, :3])
            assert np.linalg.norm(d["beacon"][i] - simulator.pose[leader, :3]) > 1e-3
            pending[i] = d["sent"][i]

    navigation.sample = watched
    others = np.arange(one.n) % 3 > 0
    for _ in range(150):
        one.step(np.zeros_like(one._action))
        heard, used = task.believed["heard_at"][others, 0], np.maximum(d["stamp"][others, MODEM], 0.0)
        late = used - heard  # A range is of the first sample of the turn.
        assert (late > -1e-6).all()
        assert (late < 1.0 / navigation.rate + 1e-6).all()
    assert (d["innovations"][~others, MODEM] == 0).all()
    count = d["innovations"][others, MODEM]
    assert count.max() <= 10
    assert 0.6 < count.mean() / 10 < 0.8
    assert len(np.unique(count)) > 2
    assert abs(np.std(errors) / 0.06 - 1.0) < 0.2
    assert abs(np.mean(errors)) < 0.02


def flown(*words: str, seconds: int = 40) -> tuple[Floats, Floats]:
    """Return root mean squares of the errors in m and NEES per coordinate (4,) of the vehicles of 24 teams, steered by their estimates."""
    one, navigation = team(*FOUR, *MATCHED, *words, n=24)
    agent, seen = agents.make(one.config, one.vehicle), one.task.observation
    agent.reset(np.arange(one.n))
    for _ in range(10 * seconds):
        seen = one.step(agent.act(seen)).observation
    d = navigation.state
    steps = d["counted"].reshape(-1, 4)
    squared, nees = d["error_squared_sum"].reshape(-1, 4) / steps, d["nees"].reshape(-1, 4) / steps / 3.0
    assert (d["diverged"] == 0).all()
    return np.sqrt(squared.mean(axis=0)), nees.mean(axis=0)


@pytest.mark.slow
def test_ranges_reduce_the_drift_of_the_others_and_leave_the_filter_consistent() -> None:
    """Two vehicles have a USBL; two have the IMU and the sheet alone. A filter that is three times too sure fails the same band."""
    drift, _ = flown("task.message_loss=1")
    error, nees = flown()
    assert (drift[:2] < 0.6).all()
    assert (drift[2:] > 2.0).all()
    assert (error[2:] < 0.6 * drift[2:]).all()
    assert (nees > 0.3).all()
    assert (nees < 1.2).all()
    _, sure = flown("navigation.inflation=0.3333333333", seconds=20)
    assert (sure[2:] > 1.2).all()
