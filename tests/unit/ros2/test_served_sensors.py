"""Sensors that a server publishes: readings, their covariances and messages, and steps of a vehicle with an estimator."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from auvbench.config.compose import compose
from auvbench.config.validate import train_config
from auvbench.envs.simulator_factory import make_simulator
from auvbench.errors import ConfigError
from auvbench.integrations.commands import serve
from auvbench.integrations.ros2 import middleware
from auvbench.integrations.ros2.sensors import UNKNOWN, Sensed, write_reading
from auvbench.vehicles import sheet
from auvbench.vehicles.physical import PhysicalCommands
from tests import dds
from tests.waiting import LIMIT

WORDS = (
    *("sensors=dvl_usbl", "navigation=ekf", "world=slope", "task.start=[1,2,-20]"),
    *("sensors.usbl.lost=0", "sensors.usbl.outliers=0", "sensors.dvl.lost=0"),
)


@pytest.fixture(scope="module")
def sensed() -> Sensed:
    config = train_config(compose("train", ["noise=none", *WORDS], folder=None))
    vehicle = sheet.load(config.vehicle)
    physical = PhysicalCommands(vehicle)
    simulator = make_simulator(config.simulator, vehicle, 1, config.disturbance, physical.model)
    return serve._sensed(config, physical.model, simulator)


def test_a_served_vehicle_steers_by_readings_that_are_near_the_truth(sensed: Sensed) -> None:
    left: list[float] = []
    sensed.sampled = left.append
    sensed.reset(np.array([0]), np.array([[1.0, 2.0, -20.0, 1.0, 0.0, 0.0, 0.0]]), np.zeros((1, 6)))
    assert set(sensed.readings(0)) == {"imu"}
    command = np.zeros((1, 6))
    command[0, :2] = 0.3
    for _ in range(25):
        sensed.step(command, 0.1)
    assert left[:6] == pytest.approx([0.08, 0.06, 0.04, 0.02, 0.0, 0.08])
    true, estimate = sensed.pose[0], sensed.navigation.pose[0]
    assert np.linalg.norm(true[:3] - [1.0, 2.0, -20.0]) > 0.2
    assert np.linalg.norm(estimate[:3] - true[:3]) < 1.0
    assert (estimate != true).all()
    seen = sensed.readings(0)
    assert set(seen) == set(sensed.names)
    for name, measured in {"dvl": sensed.velocity[0, :3], "depth": true[2:3], "usbl": true[:3]}.items():
        reading, away = seen[name], np.zeros(len(measured))
        away[:] = reading.value - measured
        assert (np.abs(away) < 4.0 * np.sqrt(np.diag(reading.covariance)) + 0.05).all(), name
        assert np.linalg.eigvalsh(reading.covariance).min() > 0.0
    assert 0.4 < seen["usbl"].age < 0.6  # of the ping at 2 s
    assert seen["imu"].value[2] == pytest.approx(9.81, abs=1.0)


def pose() -> Any:
    place, turn = SimpleNamespace(x=0.0, y=0.0, z=0.0), SimpleNamespace(w=1.0, x=0.0, y=0.0, z=0.0)
    return SimpleNamespace(
        pose=SimpleNamespace(pose=SimpleNamespace(position=place, orientation=turn), covariance=None)
    )


def test_messages_have_what_is_measured_and_no_more() -> None:
    depth, heading = pose(), pose()
    write_reading("depth", depth, np.array([-7.0]), np.array([[0.04]]))
    assert depth.pose.pose.position == SimpleNamespace(x=0.0, y=0.0, z=-7.0)
    assert np.diag(depth.pose.covariance.reshape(6, 6)) == pytest.approx(
        [UNKNOWN] * 2 + [0.04] + [UNKNOWN] * 3
    )
    write_reading("heading", heading, np.array([np.pi / 2.0]), np.array([[0.01]]))
    assert heading.pose.pose.orientation.z == pytest.approx(np.sqrt(0.5))
    assert heading.pose.covariance.reshape(6, 6)[5, 5] == 0.01


def test_a_world_without_an_estimator_is_refused() -> None:
    with pytest.raises(
        ConfigError, match="world=slope: serve simulates no contacts, and no sensor sees the world"
    ):
        serve._server(serve._given(["world=slope"]))


@dds.needs_ros
@pytest.mark.slow
def test_topics_have_the_readings_and_odometry_the_estimate() -> None:
    pytest.importorskip("sensor_msgs.msg")
    with dds.domain():
        server = serve._server(serve._given([*WORDS, "--paused"]))
        listener, ros = middleware.Session(), server.session.ros
        node, seen = listener.node("listener", "test"), {}
        kinds = {
            **dict.fromkeys(("depth", "heading", "usbl"), ros.geometry.PoseWithCovarianceStamped),
            "dvl": ros.geometry.TwistWithCovarianceStamped,
            "imu": __import__("sensor_msgs.msg").msg.Imu,
            "odom": ros.nav.Odometry,
            "pose_gt": ros.geometry.Pose,
        }
        try:
            for name, kind in kinds.items():
                seen[name] = []
                node.create_subscription(kind, f"/bluerov2_2026/{name}", seen[name].append, listener.qos)
            listener.renew()
            own = server.vehicles[0]
            publishers = [*own._publishers, *own._sensors._publishers.values()]
            assert listener.discovered(
                lambda: server.session.spin_once(0.0) or all(p.get_subscription_count() for p in publishers),
                LIMIT,
            )
            for _ in range(25):
                server.advance()
                listener.until(lambda: False, 0.05)
            assert listener.until(lambda: all(seen.values()), LIMIT)
            estimate = server.sensed.navigation.pose[0]
            assert seen["odom"][-1].pose.pose.position.x == estimate[0]
            assert seen["odom"][-1].pose.covariance[0] > 0.0
            assert seen["pose_gt"][-1].position.x == server.simulator.pose[0, 0] != estimate[0]
            stamps = [m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in seen["imu"]]
            # The first messages may have come before this listener was known to all.
            assert np.diff(stamps[-50:]) == pytest.approx(0.02)
            assert [m.header.stamp.sec for m in seen["usbl"]][-1:] == [2]
            assert len(seen["depth"]) > 10
        finally:
            listener.close()
            server.close()
