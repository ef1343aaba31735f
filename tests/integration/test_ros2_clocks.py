"""Servers without lock-step: by their clock, or by this machine's, as the thesis had it."""

import threading
import time

import numpy as np
import pytest

from auvbench.config.simulators import Fossen
from auvbench.envs.simulator_factory import make_simulator
from auvbench.integrations.ros2 import simulator as ros2
from auvbench.integrations.ros2.middleware import InterfaceError, Session
from auvbench.integrations.ros2.server import Server
from auvbench.integrations.ros2.simulator import Ros2Simulator
from auvbench.integrations.ros2.spec import Ros2
from auvbench.vehicles.physical import PhysicalCommands
from auvbench.vehicles.sheet import load
from tests import dds
from tests.waiting import LIMIT

pytestmark = [dds.needs_ros, pytest.mark.slow]

VEHICLE = load("bluerov2")
START = np.array([[1.0, 2.0, -20.0, 1.0, 0.0, 0.0, 0.0]])


@pytest.fixture(params=["with a clock", "without a clock"])
def foreign(request):
    """Somebody else's server: the topics and the reset, and no lock-step; in a thread with a context of its own."""
    with dds.domain():
        physical = PhysicalCommands(VEHICLE)
        inner = make_simulator(
            Fossen(name="fossen", max_step=0.01, threads=1), VEHICLE, 1, None, physical.model
        )
        server = Server(
            inner,
            physical,
            VEHICLE.actuators,
            physical.neutral,
            ["bluerov2"],
            start=START[0].tolist(),
            step_duration=0.02,
            pace=2.0 if request.param == "with a clock" else 1.0,
        )
        node = server.vehicles[0].node
        lockstep = next(s for s in node.services if s.srv_name.endswith("lockstep"))
        node.destroy_service(lockstep)
        reset, publish = server.reset, server.publish

        def answer_first(indices):
            """Reset without odometry: it comes after the answer."""
            server.publish = lambda indices: None
            try:
                return reset(indices)
            finally:
                server.publish = publish

        server.reset = answer_first
        if request.param == "without a clock":
            node.destroy_publisher(server._clock)
            server._clock = type("Silent", (), {"get_subscription_count": lambda self: 0})()
        server.session.renew()
        go_on = [True]
        thread = threading.Thread(target=server.run, args=(lambda: go_on[0],))
        thread.start()
        yield request.param, server
        ros2.leave()
        go_on[0] = False
        thread.join(LIMIT)
        server.close()


def test_a_server_without_lockstep(foreign):
    kind, server = foreign
    settings = Ros2(name="ros2", namespace=None, clock="auto", timeout=LIMIT)
    simulator = Ros2Simulator(VEHICLE, 1, settings)
    assert ros2.clock() == ("clock" if kind == "with a clock" else "wall")
    assert f"clock {ros2.clock()}" in ros2.used()["ros2"]
    pose = START.copy()
    pose[0, :3] = 3.0, 4.0, -10.0
    simulator.reset(np.arange(1), pose, np.zeros((1, 6)))
    np.testing.assert_allclose(simulator.pose[0, :2], pose[0, :2], atol=0.05)  # it rises while this waits
    begun, stamp = time.monotonic(), server.time
    ahead = VEHICLE.action(np.linalg.pinv(VEHICLE.allocation) @ np.array([60.0, 0, 0, 0, 0, 0]))[None]
    for _ in range(20):
        simulator.step(ahead, 0.1)
    simulated, wall = (server.time - stamp) / 1e9, time.monotonic() - begun
    # Twenty steps of a tenth of a second, less what the first was begun late: by the server's clock, or by ours.
    assert (simulated if kind == "with a clock" else wall) > 1.8
    assert simulator.pose[0, 0] > 3.2
    assert simulator.velocity[0, 0] > 0.1
    simulator.set_current(np.array([0.0, 0.5, 0.0]))
    simulator.effectiveness[:] = 0.0
    for _ in range(10):
        simulator.step(ahead, 0.1)
    assert simulator.pose[0, 1] > 4.02  # drifts north, and no thruster helps it
    np.testing.assert_array_equal(server.quantities, np.zeros((1, 6)))
    simulator.reset(np.arange(1), pose, np.zeros((1, 6)))
    np.testing.assert_allclose(simulator.pose[0, 0], pose[0, 0], atol=0.05)
    ros2.leave()
    with pytest.raises(InterfaceError, match=r"/bluerov2/lockstep: .*simulator.clock=lockstep"):
        Ros2Simulator(VEHICLE, 1, Ros2(name="ros2", namespace=None, clock="lockstep", timeout=5.0))


@pytest.mark.parametrize(
    "ask", [lambda server: server.set_lockstep(True), lambda server: server.set_paused(True)]
)
def test_a_late_world_makes_no_step_after_lockstep_or_a_pause(ask, monkeypatch):
    with dds.domain():
        physical = PhysicalCommands(VEHICLE)
        inner = make_simulator(
            Fossen(name="fossen", max_step=0.01, threads=1), VEHICLE, 1, None, physical.model
        )
        server = Server(
            inner,
            physical,
            VEHICLE.actuators,
            physical.neutral,
            ["bluerov2"],
            start=START[0].tolist(),
            step_duration=0.02,
        )
        server._due = 0.0
        monkeypatch.setattr(server.session, "spin_once", lambda seconds: ask(server))
        server.spin_once()
        assert server.time == 0
        server.close()


def test_of_two_servers_that_meet_after_their_start_the_later_leaves():
    def begin():
        physical = PhysicalCommands(VEHICLE)
        inner = make_simulator(
            Fossen(name="fossen", max_step=0.01, threads=1), VEHICLE, 1, None, physical.model
        )
        start = START[0].tolist()
        return Server(
            inner, physical, VEHICLE.actuators, physical.neutral, ["twins"], start=start, step_duration=0.02
        )

    with dds.domain():
        first, second = begin(), begin()
        for server in (first, second):
            node = server.vehicles[0].node

            def met(node=node):
                names = [name for name, _ in node.get_node_names_and_namespaces()]
                return (
                    first.since in names
                    and second.since in names
                    and node.count_publishers("/twins/odom") == 2
                )

            assert server.session.discovered(met, LIMIT)
        turns = iter([True, True, False])
        first.run(lambda: next(turns))
        with pytest.raises(InterfaceError, match=r"^/twins/odom: another server"):
            second.run(lambda: True)
        # A publisher that is no server keeps a server from starting; one that comes later does not stop it.
        second.close()
        stranger = Session()
        stranger.node("stranger").create_publisher(stranger.ros.nav.Odometry, "/twins/odom", stranger.qos)
        node = first.vehicles[0].node

        def strange():
            names = [name for name, _ in node.get_node_names_and_namespaces()]
            return (
                "stranger" in names
                and second.since not in names
                and node.count_publishers("/twins/odom") == 2
            )

        assert first.session.discovered(strange, LIMIT)
        turns = iter([True, False])
        first.run(lambda: next(turns))
        with pytest.raises(InterfaceError, match=r"^/twins/odom: another server"):
            first.check_alone(0.0)
        stranger.close()
        first.close()
