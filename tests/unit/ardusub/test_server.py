"""Lock-step over UDP, against a stand-in for ArduSub that speaks the same bytes."""

import os
import random
import socket
import struct
import subprocess
import time

import pytest

from auvbench.errors import UserError
from auvbench.integrations.ardusub import server as serving_module
from auvbench.integrations.ardusub.physics import Physics
from tests.ardusub_peer import NEUTRAL, Peer, Serving, configuration, serving
from tests.waiting import until

DEEP = "task.start=[0,0,-20]"
AHEAD = (1350, 1350, 1650, 1650, *NEUTRAL[4:])
DIVE = (1500,) * 4 + (1700,) * 2 + (1500,) * 10


@pytest.fixture
def server():
    with serving(DEEP) as one:
        yield one


@pytest.fixture
def peer(server):
    with Peer(server.port) as one:
        yield one


def test_every_packet_is_one_step_of_its_frame_rate(server, peer):
    times = [peer.step(AHEAD)["timestamp"] for _ in range(5)]
    peer.rate = 1200
    times += [peer.step(AHEAD)["timestamp"] for _ in range(3)]
    expected = [k / 400 for k in range(1, 6)] + [5 / 400 + k / 1200 for k in range(1, 4)]
    assert times == pytest.approx(expected, abs=1e-9)
    assert peer.silent()


def test_the_replies_are_the_states_of_the_same_physics_in_process(server, peer):
    alone = Physics(configuration(DEEP))
    for k in range(200):
        reply, state = peer.step(AHEAD if k < 100 else DIVE), alone.step(AHEAD if k < 100 else DIVE, 1 / 400)
        assert reply["position"] == pytest.approx(state.position, abs=1e-9)
        assert reply["imu"]["accel_body"] == pytest.approx(state.specific_force, abs=1e-9)
        assert reply["quaternion"] == pytest.approx(state.quaternion, abs=1e-9)
    assert reply["position"][0] > 0.01
    assert server.server.ports[0].physics.simulator.pose.tolist() == alone.simulator.pose.tolist()


def test_a_repeated_packet_gets_the_same_reply_and_no_step(server, peer):
    first = [peer.step(AHEAD) for _ in range(10)][-1]
    for _ in range(3):
        peer.send(AHEAD, count=peer.count - 1)
        assert peer.receive() == first
    assert peer.step(AHEAD)["timestamp"] == pytest.approx(11 / 400)


def test_a_lost_packet_or_reply_costs_no_step(server, peer):
    """ArduSub sends again what is lost on the way, and again when the reply is lost."""
    rng = random.Random(0)
    for count in range(100):
        while True:
            if rng.random() < 0.3:  # lost on the way
                continue
            peer.send(AHEAD, count=count)
            reply = peer.receive()
            if rng.random() >= 0.3:  # else the reply is lost
                break
        assert reply["timestamp"] == pytest.approx((count + 1) / 400, abs=1e-8)


def test_repetitions_that_wait_in_the_queue_get_one_reply(peer, server, monkeypatch):
    """A slow step: two copies of the same packet wait, of which the second must not be taken for the next step."""
    peer.step()
    port = server.server.ports[0]
    step = port.physics.step

    def slow(pwm, duration):
        for _ in range(3):
            peer.send(AHEAD, count=2)
        monkeypatch.setattr(port.physics, "step", step)
        return step(pwm, duration)

    monkeypatch.setattr(port.physics, "step", slow)
    peer.send(AHEAD, count=1)
    assert peer.receive()["timestamp"] == pytest.approx(2 / 400)
    assert peer.receive()["timestamp"] == pytest.approx(3 / 400)
    assert peer.silent()


def test_a_count_that_goes_back_resets_the_vehicle(server, peer):
    before = [peer.step(AHEAD) for _ in range(400)]
    assert before[-1]["velocity"][0] > 0.1
    peer.count = 0
    assert [peer.step(AHEAD) for _ in range(400)] == before
    assert server.said("restarted")


def test_the_vehicle_is_held_until_a_motor_turns():
    """A vehicle that is heavier than water would sink while ArduSub takes its depth for that of the surface."""
    with serving("vehicle=bluerov2_heavy", "task.start=[0,0,-20]") as server, Peer(server.port) as peer:
        for pwm in ((0,) * 16, NEUTRAL):
            still = [peer.step(pwm) for _ in range(400)][-1]
            assert still["position"] == [0.0, 0.0, 20.0]
            assert still["velocity"] == [0.0, 0.0, 0.0]
            assert still["imu"]["accel_body"] == pytest.approx([0.0, 0.0, -9.80665])
        peer.step(AHEAD)
        free = [peer.step(NEUTRAL) for _ in range(800)][-1]
        assert free["timestamp"] == pytest.approx(1601 / 400)
        assert abs(free["position"][2] - 20.0) > 0.01
        peer.count = 0
        assert [peer.step(NEUTRAL) for _ in range(100)][-1]["position"] == [0.0, 0.0, 20.0]


def test_a_server_that_starts_late_takes_any_count(server, peer):
    peer.count = 123_456
    assert peer.step()["timestamp"] == pytest.approx(1 / 400)
    assert peer.step()["timestamp"] == pytest.approx(2 / 400)


def test_thirty_two_channels_are_the_same_vehicle(server, peer):
    with serving(DEEP) as other, Peer(other.port) as wide:
        for _ in range(100):
            assert wide.step((*AHEAD, *[1900] * 16)) == peer.step(AHEAD)


def test_garbage_is_told_once_and_ignored(server, peer):
    first = peer.step()
    with Peer(server.port) as stranger:
        for datagram in (b"hello", b"", struct.pack("<HHI16H", 1, 400, 7, *NEUTRAL), os.urandom(3000)):
            stranger.raw(datagram)
        assert stranger.silent()
    peer.raw(struct.pack("<HHI16H", 18458, 0, 1, *NEUTRAL))
    assert "is the sender ArduSub" in server.said("is the sender ArduSub")
    assert peer.step()["timestamp"] == pytest.approx(first["timestamp"] + 1 / 400)
    assert sum("is the sender ArduSub" in line for line in server.lines) == 1
    assert server.error is None


def test_a_second_peer_is_told_of_and_ignored_while_the_first_flies(server, peer):
    peer.step(AHEAD)
    with Peer(server.port) as second:
        second.send(count=50)
        assert second.silent()
        assert peer.step(AHEAD)["timestamp"] == pytest.approx(2 / 400)
        assert "--vehicles 2" in server.said("is ignored")


def test_a_new_peer_takes_over_when_the_old_one_is_silent(server, peer, monkeypatch):
    for _ in range(5):
        peer.step(AHEAD)
    with Peer(server.port) as second:
        second.send(count=7)
        assert second.silent()
        monkeypatch.setattr(serving_module, "SILENT", 0.0)
        second.count = 7
        assert second.step()["timestamp"] == pytest.approx(1 / 400)
        assert second.step()["timestamp"] == pytest.approx(2 / 400)
    assert not any("is ignored" in line for line in server.lines)


def test_a_slow_peer_costs_simulated_time_nothing(server, peer):
    peer.step(AHEAD)
    time.sleep(0.3)
    assert peer.step(AHEAD)["timestamp"] == pytest.approx(2 / 400)


def test_vehicles_on_several_ports_are_independent():
    vehicles = [Physics(configuration(DEEP)) for _ in range(2)]
    server = Serving(vehicles, port=free_ports())
    try:
        with Peer(server.port) as a, Peer(server.port + 10) as b:
            for _ in range(200):
                first = a.step(AHEAD)
            second = b.step(DIVE)
        assert (first["timestamp"], second["timestamp"]) == (pytest.approx(0.5), pytest.approx(1 / 400))
        assert first["position"][0] > second["position"][0]
    finally:
        server.close()


def free_ports():
    """A port that is free together with the one 10 above."""
    while True:
        with (
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as a,
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as b,
        ):
            a.bind(("127.0.0.1", 0))
            number = a.getsockname()[1]
            try:
                b.bind(("127.0.0.1", number + 10))
            except (OSError, OverflowError):
                continue
            return number


def test_a_taken_port_is_refused_and_the_others_given_back(server):
    with pytest.raises(UserError, match=f"UDP port {server.port} is taken"):
        Serving([Physics(configuration(DEEP))], port=server.port)
    with pytest.raises(UserError, match="taken"):
        Serving([Physics(configuration(DEEP))] * 2, port=server.port - 10)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", server.port - 10))


def test_an_address_of_another_machine_is_refused():
    with pytest.raises(UserError, match="--address"):
        Serving([Physics(configuration(DEEP))], address="192.0.2.1")


def test_silence_is_told_of_and_ends_the_server_if_asked(monkeypatch):
    monkeypatch.setattr(serving_module, "PATIENCE", 0.05)
    monkeypatch.setattr(serving_module, "LOOK", 0.05)
    with serving(DEEP) as waiting:
        assert f"UDP 127.0.0.1:{waiting.port}" in waiting.said("no packet")
        with Peer(waiting.port) as peer:
            peer.step()
            waiting.said("has been silent")
            peer.step()
    with serving(DEEP, give_up=0.2) as ending:
        assert "--give-up" in str(ending.failure())
        assert isinstance(ending.error, UserError)


def test_progress_has_time_pace_and_rate(server_every):
    server, peer = server_every
    until(lambda: peer.step(AHEAD) and server.progress)
    assert "s simulated" in server.progress[0]
    assert "x real time" in server.progress[0]
    assert "at 400 Hz" in server.progress[0]


@pytest.fixture
def server_every():
    with serving(DEEP, every=0.1) as server, Peer(server.port) as peer:
        yield server, peer


REAL = os.environ.get("AUVBENCH_ARDUSUB", "")


@pytest.mark.slow
@pytest.mark.ardusub
@pytest.mark.skipif(not REAL, reason="AUVBENCH_ARDUSUB names no program of ArduSub's SITL")
def test_the_real_ardusub_steps_and_starts_anew(server, tmp_path):
    physics = server.server.ports[0].physics
    flags = ["-w", "--model", "JSON:127.0.0.1", "--sim-port-out", str(server.port), "--speedup", "50"]
    flags += ["--base-port", str(free_ports()), "--home", "33.810313,-118.393867,0,0"]
    flags += ["--serial0", f"udpclient:127.0.0.1:{free_ports()}"]  # on TCP it would wait for a ground station
    for start in (1, 2):
        with subprocess.Popen([REAL, *flags], cwd=tmp_path, stdout=subprocess.DEVNULL) as program:
            try:
                until(
                    lambda start=start: (
                        len([line for line in server.lines if "at its start" in line]) == start
                    )
                )
                until(lambda: physics.time > 5.0, "five simulated seconds")
            finally:
                program.kill()
    assert server.error is None
    assert server.server.ports[0].frame_rate == 1200


EIGHT = (1400, 1400, 1600, 1600, 1450, 1550, 1420, 1520)


@pytest.mark.parametrize(
    ("vehicle", "pwm", "match"),
    [
        ("bluerov2_heavy", (1400, 1400, 1600, 1600, 1450, 1450) + (0,) * 10, "FRAME_CONFIG to 2"),
        ("bluerov2", (*EIGHT, *NEUTRAL[8:]), "FRAME_CONFIG to 1"),
    ],
)
def test_another_frame_than_the_vehicles_ends_the_server(vehicle, pwm, match):
    with serving(DEEP, f"vehicle={vehicle}") as server, Peer(server.port) as peer:
        peer.step((0,) * 16)  # before ArduSub is set up
        for _ in range(60):
            peer.send(pwm)
            peer.count += 1
            if peer.silent(0.5):
                break
        assert match in str(server.failure())


def test_a_camera_mount_on_channel_eight_is_no_other_frame(server, peer):
    for k in range(200):
        peer.step((*AHEAD[:4], 1450, 1450, 0, 1100 + 4 * k, *NEUTRAL[8:]))
    assert server.error is None
