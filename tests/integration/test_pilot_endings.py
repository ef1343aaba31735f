"""Each ending of a pilot leaves the vehicle neutral and disarmed, whatever fails at that moment."""

import math

import numpy as np
import pytest

from auvbench.errors import RunError
from auvbench.pilot.mission import Logbook
from tests.bridge import NEUTRAL, Bridge, Clock
from tests.mavlink_vehicle import free_port
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


def comes_to(bridge, ending):
    ending(bridge)
    bridge.until(lambda: not bridge.pilot.armed, step=0.1)
    bridge.pilot.spin_once()


def at_rest(bridge):
    until(lambda: not bridge.vehicle.armed and bridge.vehicle.sticks[-1] == NEUTRAL)
    assert not bridge.pilot.armed
    return True


def leaves_the_depth(bridge):
    object.__setattr__(bridge.pilot.limits, "depth_high", -30.0)


def ends(bridge):
    bridge.pilot.close("the pilot was ended")


def fails(bridge):
    bridge.controller.error = ZeroDivisionError("division by zero")


def restarts(bridge):
    bridge.vehicle.restart()


def falls_silent(bridge):
    bridge.vehicle.tells = False


ENDINGS = [leaves_the_depth, ends, fails, restarts, falls_silent]


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_logbook_that_cannot_be_written_leaves_no_vehicle_armed(bridge, tmp_path, ending):
    folder = tmp_path / "missions"
    bridge.pilot.steering.logbook = Logbook(folder, {"frequency_hz": 10.0})
    bridge.fly()
    bridge.until(lambda: bridge.pilot.steering.mission.steps > 0, step=0.05)
    for path in folder.iterdir():
        path.unlink()
    folder.rmdir()
    folder.write_text("another file has the name")
    with pytest.raises(RunError, match=r"cannot be written|division by zero"):
        comes_to(bridge, ending)
    assert at_rest(bridge)
    assert bridge.said[-1].startswith("disarmed: ")


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_state_that_cannot_be_told_leaves_no_vehicle_armed(bridge, ending):
    bridge.fly()

    def speak(text):
        raise BrokenPipeError

    bridge.pilot._speak = speak
    with pytest.raises((BrokenPipeError, RunError)):
        comes_to(bridge, ending)
    bridge.pilot._speak = bridge.said.append
    bridge.pilot.close("its standard output is closed")
    assert at_rest(bridge)


def test_a_state_that_cannot_be_told_in_flight_ends_it(bridge):
    bridge.pilot.arm()

    def speak(text):
        raise OSError(28, "No space left on device")

    bridge.pilot._speak = speak
    with pytest.raises(OSError, match="No space left"):
        bridge.pilot.run(lambda: setattr(bridge.clock, "now", bridge.clock.now + 0.05) is None)
    assert at_rest(bridge)


def angle(name, fields):
    if name == "attitude":
        fields[1] = 1e38


def rate(name, fields):
    if name == "attitude":
        fields[5] = -3e38


def speed(name, fields):
    if name == "local_position_ned":
        fields[5] = 3e38


def nowhere(name, fields):
    if name == "local_position_ned":
        fields[1] = math.nan


def far_away(name, fields):
    if name == "local_position_ned":
        fields[2] = 1e38


def elsewhere(name, fields):
    """A place 20 km to the east, which a vehicle reaches with 50 m/s in 400 s."""
    if name == "local_position_ned":
        fields[2] += 2e4


@pytest.mark.parametrize("wrong", [angle, rate, speed, nowhere, far_away, elsewhere])
def test_telemetry_that_cannot_be_is_stale(bridge, wrong):
    bridge.fly()
    before = bridge.pilot.pose.copy()
    bridge.vehicle.wrong = wrong
    bridge.until(lambda: bridge.pilot.state.startswith("holding: telemetry"), step=0.05)
    until(lambda: bridge.vehicle.sticks[-1] == NEUTRAL)
    assert np.all(np.abs(bridge.pilot.pose[:3] - before[:3]) < 50.0)
    bridge.vehicle.wrong = lambda name, fields: None
    bridge.until(lambda: bridge.vehicle.sticks[-1][0] > 100, step=0.05)


def test_an_estimator_that_corrects_itself_is_followed(bridge):
    bridge.fly()
    place = bridge.pilot.pose[0]

    def corrected(name, fields):
        if name == "local_position_ned":
            fields[2] += 5.0

    bridge.vehicle.wrong = corrected
    bridge.until(lambda: bridge.pilot.pose[0] > place + 4.0, step=0.02)
    assert not any(text.startswith("disarmed:") for text in bridge.said)


def test_heartbeats_that_stop_are_stale_telemetry(bridge):
    bridge.fly()
    bridge.vehicle.beats = False
    bridge.until(lambda: bridge.pilot.state.startswith("holding: the heartbeat"), step=0.05)
    until(lambda: bridge.vehicle.sticks[-1] == NEUTRAL)
    assert bridge.pilot.vehicle.telemetry.overdue < bridge.limits.pose_timeout + 1.0
    bridge.vehicle.beats = True
    bridge.until(lambda: bridge.vehicle.sticks[-1][0] > 100, step=0.05)
    bridge.vehicle.beats = False
    bridge.until(lambda: not bridge.pilot.armed, step=0.05)
    assert at_rest(bridge)


def test_a_clock_that_stands_still_is_noticed(clock):
    made = Bridge(clock, free_port())
    with made.vehicle:
        made.open()
        made.pilot._sim_time = True
        made.fly()
        made.pilot._take_time = lambda now: None
        made.until(lambda: made.pilot.state.startswith("holding: the vehicle's clock"), step=0.05)
        until(lambda: made.vehicle.sticks[-1] == NEUTRAL)
        made.pilot.close("the test is over")
