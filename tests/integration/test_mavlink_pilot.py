"""A pilot over real MAVLink bytes: it steers when all is well, and neutral sticks are its answer to everything else."""

import os
import pty
import random
import signal
import socket
import subprocess
import sys
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest

from auvbench.cli import main
from auvbench.errors import RunError
from auvbench.integrations.ardusub.radio import dialect
from auvbench.integrations.mavlink import autopilot
from auvbench.integrations.mavlink.link import Link
from auvbench.pilot.excite import Excite
from auvbench.pilot.steering import Limits
from tests import dds
from tests.bridge import NEUTRAL, Bridge, Clock
from tests.mavlink_vehicle import MANUAL, ArduSub, free_port
from tests.waiting import until

pytestmark = pytest.mark.slow


@pytest.fixture
def clock(monkeypatch):
    made = Clock()
    monkeypatch.setattr("auvbench.pilot.loop.time", made)
    return made


@pytest.fixture
def bridge(clock):
    made = Bridge(clock, free_port())
    with made.vehicle:
        made.open()
        yield made
        made.pilot.close("the test is over")


def test_it_starts_disarmed_and_commands_nothing(bridge):
    bridge.until(lambda: bridge.pilot.age < 0.5)
    for _ in range(50):
        bridge.clock.now += 0.05
        bridge.pilot.spin_once()
    assert bridge.vehicle.sticks == []
    assert not bridge.vehicle.armed
    assert bridge.vehicle.mode != MANUAL


def test_told_to_arm_it_switches_to_manual_arms_and_pushes_ahead(bridge):
    start = bridge.vehicle.position
    bridge.fly()
    assert bridge.vehicle.armed
    assert bridge.vehicle.mode == MANUAL
    assert bridge.vehicle.sticks[0] == NEUTRAL
    # Its bow looks to the north at the start.
    bridge.until(lambda: bridge.vehicle.position[1] > start[1] + 0.5, step=0.05)


def test_the_pose_is_that_of_the_vehicle(bridge):
    bridge.fly()
    bridge.until(lambda: bridge.vehicle.position[1] > 0.5, step=0.05)
    bridge.pilot.disarm("the test looks")
    physics = bridge.vehicle.physics
    bridge.vehicle.tells = False
    bridge.until(
        lambda: (
            bridge.pilot._stamp == 1_000_000 * max(s for s, _ in bridge.pilot.vehicle.telemetry.told.values())
        )
    )
    bridge.vehicle.__exit__()
    pose = physics.simulator.pose[0]
    # Single precision on the way, and less than a second of drifting since.
    np.testing.assert_allclose(bridge.pilot.pose[:3], pose[:3], atol=0.6)
    np.testing.assert_allclose(abs(bridge.pilot.pose[3:] @ pose[3:]), 1.0, atol=0.02)


def test_armed_elsewhere_in_manual_it_steers(bridge):
    bridge.vehicle.mode, bridge.vehicle.armed = MANUAL, True
    bridge.until(lambda: bridge.pilot.armed)
    bridge.until(lambda: bridge.vehicle.sticks and bridge.vehicle.sticks[-1][0] > 100, step=0.05)


def test_a_vehicle_that_is_armed_before_is_said_to_be(clock):
    made = Bridge(clock, free_port())
    made.vehicle.armed = True
    with made.vehicle:
        made.open()
        try:
            assert "it is armed already: disarm it first, or give --arm" in made.pilot.cue
            assert not made.pilot.armed
        finally:
            made.pilot.close("the test is over")


def test_armed_elsewhere_in_another_mode_it_is_left_alone(bridge):
    bridge.vehicle.mode, bridge.vehicle.armed = 2, True
    bridge.until(lambda: any("its mode is 2" in text for text in bridge.said))
    assert not bridge.pilot.armed
    assert bridge.vehicle.sticks == []
    assert bridge.vehicle.armed


def excited(bridge, **limits):
    vehicle = bridge.pilot.steering.vehicle
    manoeuvre = Excite(vehicle, ["surge"], 0.3, 6.0, 10.0)
    bridge.pilot.steering = replace(
        bridge.pilot.steering,
        controller=manoeuvre,
        once=True,
        limits=replace(bridge.limits, goal_radius=0.0, max_steps=manoeuvre.steps, **limits),
    )
    bridge.pilot.limits = bridge.pilot.steering.limits
    bridge.until(lambda: bridge.pilot.age < 0.5)
    assert bridge.pilot.arm() == ""
    return bridge.pilot


def test_a_manoeuvre_pushes_to_and_fro_once_and_disarms(bridge):
    pilot = excited(bridge)
    place = pilot.steering.waypoint.copy()
    assert not pilot.steer_to([3.0, 0.0, -5.0])  # a goal does not begin it again, nor move the room
    np.testing.assert_array_equal(pilot.steering.waypoint, place)
    bridge.until(lambda: pilot.finished, step=0.02)
    assert "disarmed: the manoeuvre is over" in bridge.said
    surges = {stick[0] for stick in bridge.vehicle.sticks}
    assert min(surges) < 0 < max(surges)
    until(lambda: not bridge.vehicle.armed)
    assert bridge.vehicle.sticks[-1] == NEUTRAL


def test_a_manoeuvre_ends_where_it_leaves_its_room(bridge):
    pilot = excited(bridge, reach=0.01)
    bridge.until(lambda: not pilot.armed, step=0.02)
    assert any("m from where it was armed, more than 0.01 m" in text for text in bridge.said)
    assert pilot.finished
    until(lambda: not bridge.vehicle.armed)
    assert bridge.vehicle.sticks[-1] == NEUTRAL


def test_stale_telemetry_is_neutral_and_in_the_end_disarmed(bridge):
    bridge.fly()
    bridge.vehicle.tells = False
    bridge.until(lambda: bridge.pilot.state.startswith("holding"), step=0.1)
    assert bridge.pilot.armed
    bridge.until(lambda: bridge.vehicle.sticks[-1] == NEUTRAL)
    bridge.until(lambda: not bridge.pilot.armed, step=0.5)
    until(lambda: not bridge.vehicle.armed)
    assert bridge.vehicle.sticks[-1] == NEUTRAL
    assert any("disarmed: telemetry is" in text for text in bridge.said)


def unconfirmed(bridge):
    """Fly, and disarm a vehicle that does not obey."""
    bridge.fly()
    bridge.vehicle.ignores_disarming = True
    bridge.pilot.disarm("the test")
    assert bridge.said[-2:] == [
        "ArduSub has not confirmed that it is disarmed; the order is repeated",
        "disarmed: the test",
    ]
    assert bridge.vehicle.armed


def test_a_vehicle_that_does_not_disarm_is_told_again(bridge):
    unconfirmed(bridge)
    bridge.pilot.spin_once()
    assert bridge.vehicle.armed
    bridge.vehicle.ignores_disarming = False
    bridge.pilot.spin_once()
    assert not bridge.vehicle.armed
    assert bridge.pilot.guard._process.poll() is None
    told = len([text for text in bridge.said if "the order is repeated" in text])
    assert told == 1
    bridge.fly()


@pytest.mark.parametrize("end", ["closes", "dies"])
def test_a_pilot_that_ends_before_its_vehicle_disarmed_still_brings_it_to_rest(bridge, end):
    unconfirmed(bridge)
    bridge.vehicle.ignores_disarming = False
    if end == "dies":
        bridge.pilot.guard._socket.shutdown(socket.SHUT_RDWR)
        until(lambda: not bridge.vehicle.armed)
    with pytest.raises(RunError, match="supervisor") if end == "dies" else nullcontext():
        bridge.pilot.close("the test is over")
    until(lambda: not bridge.vehicle.armed)
    assert bridge.vehicle.sticks[-1] == NEUTRAL


def test_a_position_that_stops_is_stale_too(bridge):
    bridge.fly()
    bridge.vehicle.positions = False
    bridge.until(lambda: bridge.pilot.state.startswith("holding"), step=0.1)


def test_a_restart_disarms_and_telemetry_is_asked_for_again(bridge):
    bridge.fly()
    bridge.vehicle.restart()
    bridge.until(lambda: not bridge.pilot.armed, step=0.02)
    # Its streams went with the restart.
    bridge.until(lambda: bridge.pilot._stamp < 3_600_000_000_000 and bridge.pilot.age < 0.5, step=0.3)
    assert any("the clock went back" in text for text in bridge.said)
    bridge.fly()


def test_a_failsafe_of_the_vehicle_disarms_the_pilot(bridge):
    bridge.fly()
    bridge.vehicle.send("statustext", 2, b"Lost manual control\x1b[2J")
    bridge.vehicle.armed = False
    bridge.until(lambda: not bridge.pilot.armed)
    (said,) = [text for text in bridge.said if text.startswith("disarmed: ArduSub disarmed")]
    assert "Lost manual control" in said
    assert "\x1b" not in said


def test_another_mode_takes_the_vehicle_from_the_pilot_and_leaves_it_armed(bridge):
    bridge.fly()
    bridge.vehicle.mode = 16  # POSHOLD
    bridge.until(lambda: not bridge.pilot.armed)
    until(lambda: bridge.vehicle.sticks[-1] == NEUTRAL)
    assert bridge.vehicle.armed
    assert bridge.vehicle.mode == 16


def test_a_depth_limit_disarms(clock):
    limits = Limits(depth_low=-60.0, depth_high=-19.0, goal_radius=1.0, max_steps=10_000)
    made = Bridge(clock, free_port(), limits=limits)
    made.controller.answer = np.array([[0.0, 0.0, 0.0, 0.0, 0.5, -0.5]])  # up
    with made.vehicle:
        made.open()
        assert made.pilot.arm() == ""
        made.until(lambda: not made.pilot.armed, step=0.05)
        until(lambda: not made.vehicle.armed)
        assert any("is not within -60 .. -19 m" in text for text in made.said)
        made.pilot.close("the test is over")


@pytest.mark.parametrize(
    ("answer", "error"),
    [
        (None, ZeroDivisionError("division by zero")),
        (np.full((1, 6), np.nan), None),
        (np.zeros((1, 5)), None),
    ],
)
def test_a_controller_that_fails_leaves_it_neutral_and_disarmed(bridge, answer, error):
    bridge.fly()
    bridge.controller.answer, bridge.controller.error = answer, error
    with pytest.raises(RunError):
        bridge.until(lambda: False, step=0.05)
    until(lambda: not bridge.vehicle.armed)
    assert bridge.vehicle.sticks[-1] == NEUTRAL


def test_a_vehicle_that_refuses_arming_is_quoted(bridge):
    bridge.vehicle.refuses = True
    assert bridge.pilot.arm() == "ArduSub refuses arming: Arm: Compass not calibrated"
    assert not bridge.pilot.armed


def test_a_second_vehicle_is_not_armed_with_and_not_listened_to(bridge):
    with ArduSub(bridge.port, system=2) as other:
        other.boot = 900_000
        bridge.until(lambda: bridge.pilot.vehicle.company)
        assert "a second vehicle" in bridge.pilot.arm()
        assert not bridge.vehicle.armed
        assert not other.armed
    bridge.pilot.vehicle._others.clear()
    bridge.fly()
    with ArduSub(bridge.port, system=2) as other:
        bridge.until(lambda: bridge.pilot.vehicle.company, step=0.02)
        assert bridge.pilot.armed
        assert other.sticks == []


def test_the_gain_of_the_joystick_is_followed(bridge):
    bridge.fly()
    before = bridge.vehicle.sticks[-1][0]
    bridge.vehicle.gain = 0.5
    bridge.vehicle.send("named_value_float", 0, b"PilotGain", 0.5)
    bridge.until(lambda: bridge.vehicle.sticks[-1][0] > 1.9 * before, step=0.05)


def garbage(seed):
    """Datagrams that are no messages, or damaged ones."""
    d, rng = dialect(), random.Random(seed)
    whole = d.MAVLink_attitude_message(1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0).pack(d.MAVLink(None, 1, 1))
    for _ in range(300):
        kind = rng.randrange(5)
        if kind == 0:
            yield rng.randbytes(rng.randrange(0, 600))
        elif kind == 1:
            yield whole[: rng.randrange(len(whole))]
        elif kind == 2:
            damaged = bytearray(whole)
            damaged[rng.randrange(len(whole))] ^= 1 << rng.randrange(8)
            yield bytes(damaged)
        elif kind == 3:
            yield b"\xfd" + rng.randbytes(rng.randrange(0, 300))
        else:
            # A right checksum, and fields that mean nothing.
            numbers = [rng.choice([float("nan"), float("inf"), 1e38, -1e38]) for _ in range(6)]
            yield d.MAVLink_attitude_message(rng.randrange(2**32), *numbers).pack(d.MAVLink(None, 1, 1))


def test_garbage_does_not_stop_a_flight(bridge):
    bridge.fly()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        for data in garbage(0):
            stranger.sendto(data, ("127.0.0.1", bridge.port))
            bridge.clock.now += 0.002
            bridge.pilot.spin_once()
    assert bridge.pilot.armed
    bridge.until(lambda: bridge.vehicle.sticks[-1][0] > 100, step=0.02)


def test_garbage_of_the_vehicle_itself_is_dropped(bridge):
    bridge.until(lambda: bridge.pilot.age < 0.5)
    for data in garbage(1):
        bridge.vehicle._socket.sendto(data, ("127.0.0.1", bridge.port))
        bridge.pilot.spin_once()
        assert np.all(np.isfinite(bridge.pilot.pose))


def test_messages_over_tcp_survive_garbage_before_them_and_an_end_is_one_line():
    d = dialect()
    with socket.create_server(("127.0.0.1", 0)) as server:
        opened = Link(f"tcp:127.0.0.1:{server.getsockname()[1]}")
        other, _ = server.accept()
        with other:
            for data in garbage(2):
                other.sendall(data)
            other.sendall(bytes(600))  # what a damaged message may still wait for
            beat = d.MAVLink_heartbeat_message(12, 3, 0, 19, 4, 3)
            other.sendall(beat.pack(d.MAVLink(None, srcSystem=7, srcComponent=1)))
            seen = []
            until(lambda: seen.extend(opened.receive(0.1)) or any(m.get_srcSystem() == 7 for _, m in seen))
        with pytest.raises(RunError, match="closed the connection"):
            until(lambda: list(opened.receive(0.1)) and False)
        opened.close()


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"FS_PILOT_INPUT": 0.0}, ["FS_PILOT_INPUT is 0 (off), should be 2 (disarm)"]),
        ({"FS_GCS_ENABLE": 1.0}, ["FS_GCS_ENABLE is 1 (only warns)"]),
        (
            {"FS_PILOT_INPUT": None, "FS_GCS_TIMEOUT": 60.0},
            ["FS_PILOT_INPUT is unknown", "FS_GCS_TIMEOUT is 60 s"],
        ),
        ({"FS_GCS_TIMEOUT": None}, []),
        ({"FS_GCS_ENABLE": 4.0}, []),
    ],
)
def test_failsafes_of_the_vehicle_that_are_off_are_named_before_it_arms(clock, monkeypatch, changed, words):
    monkeypatch.setattr(autopilot, "TOLD", 0.5)
    made = Bridge(clock, free_port())
    parameters = {**made.vehicle.parameters, **changed}
    made.vehicle.parameters = {name: value for name, value in parameters.items() if value is not None}
    with made.vehicle:
        made.open()
        armed = []
        made.pilot.vehicle.take_over = lambda take_over=made.pilot.vehicle.take_over: (
            armed.append(len(made.said)) or take_over()
        )
        made.fly()
        warnings = [text for text in made.said[: armed[0]] if text.startswith("warning: ")]
        made.pilot.close("the test is over")
    assert len(warnings) == bool(words)
    for word in words:
        assert word in warnings[0]


# The command.


@pytest.fixture
def impatient(monkeypatch):
    monkeypatch.setattr(autopilot, "FOUND", 1.0)
    monkeypatch.setattr("auvbench.integrations.mavlink.pilot.TELEMETRY", 1.0)


def refused(capsys, *words):
    assert main(["pilot", "pid", "--goal", "5", "0", "-12", *words]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    return line


def test_no_vehicle(impatient, capsys):
    assert "no vehicle was heard in 1 s" in refused(capsys, "--mavlink", f"udp:127.0.0.1:{free_port()}")


def test_without_pymavlink_the_extra_is_named(monkeypatch, capsys):
    dialect.cache_clear()
    monkeypatch.setitem(sys.modules, "pymavlink.dialects.v20.ardupilotmega", None)
    assert "pip install 'auvbench[mavlink]'" in refused(capsys, "--mavlink", "udp:127.0.0.1:14550")
    dialect.cache_clear()


def test_a_peer_that_is_no_submarine(capsys):
    port = free_port()
    copter = ArduSub(port)
    copter.kind = copter.d.MAV_TYPE_QUADROTOR
    with copter:
        line = refused(capsys, "--mavlink", f"udp:127.0.0.1:{port}")
    assert "is not an ArduPilot submarine (MAV_TYPE 2, must be 12" in line
    assert copter.heard == []


def test_another_frame(capsys):
    port = free_port()
    with ArduSub(port, "bluerov2_heavy"):
        line = refused(capsys, "--mavlink", f"udp:127.0.0.1:{port}")
    assert (
        "--vehicle bluerov2_2026: has the frame vectored (FRAME_CONFIG 1), but ArduSub has FRAME_CONFIG 2"
        in line
    )


def test_no_position(impatient, capsys):
    port = free_port()
    vehicle = ArduSub(port)
    vehicle.positions = False
    with vehicle:
        line = refused(capsys, "--mavlink", f"udp:127.0.0.1:{port}")
    assert "LOCAL_POSITION_NED did not come" in line


def test_a_vehicle_that_refuses_arming(capsys):
    port = free_port()
    vehicle = ArduSub(port)
    vehicle.refuses = True
    with vehicle:
        line = refused(capsys, "--mavlink", f"udp:127.0.0.1:{port}", "--arm", "--pose-timeout", "60")
    assert line.endswith("--arm: ArduSub refuses arming: Arm: Compass not calibrated")
    assert not vehicle.armed


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--mavlink", "serial:/dev/ttyACM0"], "must be udp:HOST:PORT"),
        (["--mavlink", "udp:127.0.0.1:70000"], "must be udp:HOST:PORT"),
        (["--mavlink", "udp:127.0.0.1:14550", "--namespace", "alpha"], "--namespace alpha"),
        (["--mavlink", "udp:127.0.0.1:14550", "--vehicle", "lrauv"], "only thrusters"),
        (["--mavlink", "udp:127.0.0.1:14550", "--vehicle", "rexrov"], "fit none of ArduSub's frames"),
        (["--mavlink", "udp:127.0.0.1:14550", "--frequency", "0.5"], "must be at least 1 Hz"),
        (["--mavlink", "udp:127.0.0.1:14550", "--goal", "0", "0", "-70"], "must be within -60 .. -1 m"),
        (["--arm"], "--arm: needs --mavlink"),
    ],
)
def test_what_is_typed_wrong(words, message, capsys):
    assert message in refused(capsys, *words)


def test_a_port_that_is_taken(capsys):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as owner:
        owner.bind(("127.0.0.1", 0))
        address = f"udp:127.0.0.1:{owner.getsockname()[1]}"
        assert f"--mavlink {address}: cannot listen: Address already in use" in refused(
            capsys, "--mavlink", address
        )


@pytest.mark.parametrize("vehicle", ["bluerov2", "bluerov2_heavy"])
def test_a_mission_from_command_to_replay(vehicle, tmp_path, capsys):
    port, folder = free_port(), tmp_path / "missions"
    words = ["--mavlink", f"udp:127.0.0.1:{port}", "--vehicle", vehicle, "--goal", "3", "6", "-14"]
    with ArduSub(port, vehicle) as sub:
        flags = ["--arm", "--sim-time", "--pose-timeout", "60", "--record", str(folder)]
        pilot = dds.Process("pilot", "pid", *words, *flags)
        try:
            pilot.says("reaches")
            pilot.says("waypoint reached")
            assert np.linalg.norm(np.subtract(sub.position, (3.0, 6.0, -14.0))) < 3.5
            pilot.send(signal.SIGINT)
            assert pilot.ends() == 0, pilot.output
        finally:
            pilot.stop()
        assert not sub.armed
        assert sub.sticks[-1] == NEUTRAL
    assert main(["replay", str(folder)]) == 0
    assert "success after" in capsys.readouterr().out


@pytest.mark.parametrize("end", ["enter", "sigterm"])
def test_the_stop_key_and_sigterm_in_mid_flight(end):
    port = free_port()
    leader, follower = pty.openpty()
    with ArduSub(port) as sub:
        words = ["--mavlink", f"udp:127.0.0.1:{port}", "--goal", "3", "400", "-14", "--arm"]
        terminal = f"import os, fcntl, termios; os.setsid(); os.dup2({follower}, 0); fcntl.ioctl(0, termios.TIOCSCTTY, 0)"
        pilot = dds.Process(
            "pilot", "pid", *words, "--pose-timeout", "60", before=terminal, descriptors=[follower]
        )
        try:
            until(lambda: sub.armed and len(sub.sticks) > 5 and sub.sticks[-1] != NEUTRAL)
            if end == "enter":
                os.write(leader, b"\n")
            else:
                pilot.send(signal.SIGTERM)
            assert pilot.ends() == 0, pilot.output
        finally:
            pilot.stop()
            os.close(leader)
            os.close(follower)
        assert not sub.armed
        assert sub.sticks[-1] == NEUTRAL


REAL = os.environ.get("AUVBENCH_ARDUSUB", "")


@pytest.mark.ardusub
@pytest.mark.skipif(not REAL, reason="AUVBENCH_ARDUSUB names no program of ArduSub's SITL")
def test_the_real_ardusub_is_steered_to_a_waypoint(tmp_path):
    water, port = free_port(), free_port()
    parameters = tmp_path / "sub.parm"
    parameters.write_text(
        "JS_GAIN_DEFAULT 1\nBTN0_FUNCTION 4\n", encoding="ascii"
    )  # it arms with a button that disarms
    flags = ["-w", "--model", "JSON:127.0.0.1", "--sim-port-out", str(water), "--speedup", "5"]
    flags += ["--base-port", str(free_port()), "--home", "33.810313,-118.393867,0,0"]
    flags += ["--defaults", str(parameters), "--serial0", f"udpclient:127.0.0.1:{port}"]
    server = dds.Process("serve", "--face", "ardusub", "--port", str(water))
    try:
        server.says("waiting for ArduSub")
        with subprocess.Popen([REAL, *flags], cwd=tmp_path, stdout=subprocess.DEVNULL) as program:
            goal = ["--goal", "3", "4", "-8", "--depth", "-60", "1", "--goal-radius", "1"]
            words = ["pid", "--mavlink", f"udp:127.0.0.1:{port}", *goal, "--arm", "--sim-time"]
            pilot = dds.Process("pilot", *words, "--pose-timeout", "60")
            try:
                pilot.says("waypoint reached")
                pilot.send(signal.SIGINT)
                assert pilot.ends() == 0, pilot.output
                assert "has not confirmed that it is disarmed" not in pilot.output
            finally:
                pilot.stop()
                program.kill()
    finally:
        server.stop()
