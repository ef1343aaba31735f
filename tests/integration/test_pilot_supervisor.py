"""A pilot that dies or hangs, and a supervisor that does: the vehicle ends neutral and disarmed."""

import os
import select
import signal
import socket
import threading

import pytest

from auvbench.cli import main
from auvbench.errors import RunError
from auvbench.pilot import guard, supervisor
from auvbench.pilot.guard import Unsupervised
from tests import dds
from tests.bridge import NEUTRAL, Bridge, Clock
from tests.mavlink_vehicle import ArduSub, free_port
from tests.waiting import LIMIT, until

pytestmark = pytest.mark.slow


@pytest.fixture
def bridge(monkeypatch):
    clock = Clock()
    monkeypatch.setattr("auvbench.pilot.loop.time", clock)
    made = Bridge(clock, free_port())
    with made.vehicle:
        made.open()
        yield made
        made.pilot.close("the test is over")


def at_rest(vehicle):
    return not vehicle.armed and vehicle.sticks[-1] == NEUTRAL


def in_flight(vehicle):
    return any(sticks != NEUTRAL for sticks in vehicle.sticks)


def later(deed):
    """Python that lets the pilot's controller do something in its 20th step."""
    return (
        "import os, signal, time; from auvbench.pilot.steering import Steering; steps, act = [], Steering.act\n"
        f"def late(*words): steps.append(1); len(steps) == 20 and {deed}; return act(*words)\n"
        "Steering.act = late"
    )


@pytest.mark.parametrize(
    ("number", "before"),
    [
        (signal.SIGKILL, ""),
        (signal.SIGSTOP, ""),
        (None, later("os.kill(os.getpid(), signal.SIGFPE)")),
        (None, later("time.sleep(3600)")),
    ],
    ids=["killed", "halted", "the policy divides by zero", "the policy hangs"],
)
def test_a_pilot_that_dies_or_hangs(number, before):
    port = free_port()
    with ArduSub(port) as sub:
        words = ["pid", "--mavlink", f"udp:127.0.0.1:{port}", "--goal", "3", "400", "-14", "--arm"]
        pilot = dds.Process("pilot", *words, "--pose-timeout", "3", before=before)
        try:
            until(lambda: in_flight(sub))
            if number is not None:
                pilot.send(number)
            until(lambda: at_rest(sub))
            pilot.says("neutral sticks and the order to disarm were sent")
        finally:
            pilot.process.kill()
            pilot.ends()


def test_a_halted_pilot_that_goes_on_commands_no_more():
    port = free_port()
    with ArduSub(port) as sub:
        words = ["pid", "--mavlink", f"udp:127.0.0.1:{port}", "--goal", "3", "400", "-14", "--arm"]
        pilot = dds.Process("pilot", *words, "--pose-timeout", "3")
        try:
            until(lambda: in_flight(sub))
            pilot.send(signal.SIGSTOP)
            until(lambda: at_rest(sub))
            pilot.says("neutral sticks")
            sub.armed, before = True, len(sub.sticks)  # by a person
            pilot.send(signal.SIGCONT)
            assert pilot.ends() == 2
        finally:
            pilot.process.kill()
            pilot.ends()
        assert "its supervisor brought the vehicle to rest" in pilot.lines[-1]
        assert len(sub.sticks) == before
        assert sub.armed


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_without_its_supervisor_a_pilot_disarms_and_ends(bridge, number):
    bridge.fly()
    os.kill(bridge.pilot.guard._process.pid, number)
    # Only how soon a hanging supervisor is noticed; a busy machine may let the pilot itself fall silent for longer.
    bridge.pilot.guard._socket.settimeout(0.5)
    with pytest.raises(Unsupervised, match="a pilot does not steer without a supervisor"):
        bridge.pilot.run(lambda: setattr(bridge.clock, "now", bridge.clock.now + 0.05) is None)
    until(lambda: at_rest(bridge.vehicle))


def test_without_its_supervisor_a_pilot_does_not_arm(bridge):
    os.kill(bridge.pilot.guard._process.pid, signal.SIGKILL)
    bridge.pilot.guard._process.wait(LIMIT)
    with pytest.raises(Unsupervised):
        bridge.pilot.arm()
    assert not bridge.vehicle.armed


def test_a_supervisor_that_dies_while_the_vehicle_is_brought_to_rest(bridge):
    bridge.fly()
    os.kill(bridge.pilot.guard._process.pid, signal.SIGKILL)
    bridge.pilot.guard._process.wait(LIMIT)
    with pytest.raises(Unsupervised):
        bridge.pilot.close("the pilot was ended")
    until(lambda: at_rest(bridge.vehicle))


def test_an_interruption_while_the_vehicle_is_brought_to_rest_leaves_that_to_the_supervisor(bridge):
    bridge.fly()

    def interrupted(seconds):
        raise KeyboardInterrupt

    bridge.pilot.vehicle.disarm = interrupted
    with pytest.raises(KeyboardInterrupt):
        bridge.pilot.close("the pilot was ended")
    until(lambda: at_rest(bridge.vehicle))


def test_an_error_while_it_arms_leaves_that_to_the_supervisor(bridge):
    def fails(*_):
        raise OSError(5, "Input/output error")

    bridge.pilot.vehicle.take_over, take_over = lambda: take_over() or fails(), bridge.pilot.vehicle.take_over
    bridge.pilot.vehicle.disarm = fails
    with pytest.raises(OSError, match="Input/output"):
        bridge.pilot.arm()
    assert bridge.vehicle.armed
    bridge.pilot.close("it cannot arm")
    until(lambda: at_rest(bridge.vehicle))


@pytest.fixture
def stream():
    """A vehicle behind a TCP port, and the port."""
    over = threading.Event()
    with (
        socket.create_server(("127.0.0.1", 0)) as server,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as relay,
    ):
        relay.bind(("127.0.0.1", 0))

        def carry():
            connection, _ = server.accept()
            vehicle = None
            with connection:
                while not over.is_set():
                    for ready in select.select([connection, relay], [], [], 0.05)[0]:
                        if ready is relay:
                            data, vehicle = relay.recvfrom(4096)
                            connection.sendall(data)
                        elif vehicle is not None and (data := connection.recv(4096)):
                            relay.sendto(data, vehicle)
                        else:
                            return  # both ends of the pilot are closed

        thread = threading.Thread(target=carry)
        with ArduSub(relay.getsockname()[1]) as sub:
            thread.start()
            yield sub, server.getsockname()[1]
            over.set()
            thread.join()


def test_over_tcp_the_supervisor_sends_on_the_connection_of_the_pilot(stream, monkeypatch):
    sub, port = stream
    clock = Clock()
    monkeypatch.setattr("auvbench.pilot.loop.time", clock)
    made = Bridge(clock, port)
    made.vehicle = sub
    made.open(f"tcp:127.0.0.1:{port}")
    made.fly()
    made.pilot.guard._socket.close()  # as if the pilot had died
    until(lambda: at_rest(sub))
    assert made.pilot.guard._process.wait(LIMIT) == supervisor.SENT
    made.pilot.link._socket.close()


def test_a_vehicle_that_does_not_confirm_is_told_once_more_at_the_end(bridge):
    bridge.fly()
    bridge.pilot.vehicle.disarm = lambda seconds: False
    bridge.pilot.close("the pilot was ended")
    until(lambda: at_rest(bridge.vehicle))


def test_a_supervisor_that_cannot_be_started_is_one_line(monkeypatch, capsys):
    monkeypatch.setattr(guard.sys, "executable", "/nowhere/python")
    port = free_port()
    with ArduSub(port) as sub:
        assert main(["pilot", "pid", "--mavlink", f"udp:127.0.0.1:{port}", "--goal", "5", "0", "-12"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "supervisor cannot be started: No such file or directory" in line
    assert not sub.armed


def test_a_lost_connection_over_which_nothing_comes_back_is_one_error(bridge):
    bridge.fly()
    bridge.pilot.link._lost = lambda: RunError("the other end closed the connection")

    def lost(seconds):
        raise bridge.pilot.link._lost()
        yield

    bridge.pilot.link.receive = lost
    with pytest.raises(RunError, match="closed the connection"):
        bridge.pilot.run(lambda: True)
    until(lambda: at_rest(bridge.vehicle))
