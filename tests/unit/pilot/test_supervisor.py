"""The supervisor between a pilot and the network: what it sends, and when it sends the will."""

import ast
import contextlib
import io
import os
import signal
import socket
import subprocess
import sys
import tokenize
from pathlib import Path

import pytest

from auvbench.errors import RunError
from auvbench.integrations.mavlink import sender
from auvbench.integrations.ros2 import sender as ros2_sender
from auvbench.pilot import guard as pilots_end
from auvbench.pilot import supervisor
from auvbench.pilot.guard import Guard, Unsupervised
from tests.waiting import LIMIT, until

WILL = [b"neutral", b"disarm", b"neutral again"]


class Vehicle:
    """A receiver, and a guard of whoever sends to it."""

    def __init__(self, kind, patience):
        self.far = socket.socket(socket.AF_INET, kind)
        self.far.bind(("127.0.0.1", 0))
        self.near = socket.socket(socket.AF_INET, kind)
        host, port = self.far.getsockname()
        if kind == socket.SOCK_STREAM:
            self.far.listen()
            self.near.connect((host, port))
            self.far, server = self.far.accept()[0], self.far
            server.close()
        self.far.settimeout(LIMIT)
        number = self.near.fileno()
        words = (sender.__file__, str(number), host, str(port))
        self.guard = Guard(*words, patience=patience, descriptors=[number], isolated=True)
        assert self.guard.wait_until_ready(LIMIT)
        self.guard.leave_will(WILL)

    def hears(self, *contents):
        wanted, got = b"".join(contents), b""
        while len(got) < len(wanted):
            got += self.far.recv(4096)
        assert got == wanted

    def hears_no_more(self):
        self.far.setblocking(False)
        with contextlib.suppress(BlockingIOError):
            assert self.far.recv(4096) == b""  # a connection may be at its end

    def ended(self):
        return self.guard._process.wait(LIMIT)


@pytest.fixture
def vehicle():
    with contextlib.ExitStack() as stack:

        def make(patience=LIMIT, kind=socket.SOCK_DGRAM):
            made = Vehicle(kind, patience)
            stack.callback(made.guard.close)
            stack.callback(made.near.close)
            stack.callback(made.far.close)
            return made

        yield make


KINDS = pytest.mark.parametrize("kind", [socket.SOCK_DGRAM, socket.SOCK_STREAM])


@KINDS
def test_it_sends_what_it_is_handed_and_ends_with_the_pilot(vehicle, kind):
    vehicle = vehicle(kind=kind)
    assert vehicle.guard.forward(b"one")
    vehicle.guard.hold()
    assert vehicle.guard.forward(b"two")
    vehicle.guard.release()
    vehicle.guard.close()
    assert vehicle.ended() == 0
    vehicle.hears(b"one", b"two")
    vehicle.hears_no_more()


@KINDS
def test_a_pilot_that_ends_without_a_goodbye_leaves_its_will(vehicle, kind, capfd):
    vehicle = vehicle(kind=kind)
    vehicle.guard.hold()
    vehicle.guard.forward(b"thrust")
    vehicle.guard.close()
    assert vehicle.ended() == supervisor.SENT
    vehicle.hears(b"thrust", *WILL)
    assert capfd.readouterr().err == (
        "pilot: the pilot has ended; neutral sticks and the order to disarm were sent\n"
    )


def test_a_pilot_that_is_silent_leaves_its_will_and_may_not_command_any_more(vehicle, capfd):
    vehicle = vehicle(patience=0.2)
    vehicle.guard.hold()
    vehicle.hears(*WILL)
    assert vehicle.ended() == supervisor.SENT
    with pytest.raises(Unsupervised, match="silent for more than") as raised:
        vehicle.guard.forward(b"thrust")
    assert raised.value.fired
    assert vehicle.guard.forward(b"thrust")  # swallowed: the vehicle may have another pilot by now
    vehicle.hears_no_more()
    assert "the pilot has been silent for 0." in capfd.readouterr().err


def test_a_pilot_without_a_vehicle_may_be_silent(vehicle):
    vehicle = vehicle(patience=0.05)
    # It reads both messages at once, however long this process pauses between them.
    os.kill(vehicle.guard._process.pid, signal.SIGSTOP)
    vehicle.guard.hold()
    vehicle.guard.release()
    os.kill(vehicle.guard._process.pid, signal.SIGCONT)
    with pytest.raises(subprocess.TimeoutExpired):
        vehicle.guard._process.wait(0.3)
    vehicle.hears_no_more()


def test_a_message_that_comes_too_late_is_not_sent(vehicle):
    vehicle = vehicle(patience=0.2)
    os.kill(vehicle.guard._process.pid, signal.SIGSTOP)
    vehicle.guard.hold()
    vehicle.guard.forward(b"thrust")
    until(lambda: pilots_end.time.monotonic() > vehicle.guard._handed + 0.2)
    os.kill(vehicle.guard._process.pid, signal.SIGCONT)
    vehicle.hears(*WILL)


def test_a_pilot_that_goes_after_commands_that_came_too_late_leaves_its_will(vehicle, capfd):
    vehicle = vehicle(patience=0.2)
    os.kill(vehicle.guard._process.pid, signal.SIGSTOP)
    vehicle.guard._holds = True  # two messages: a halted supervisor's buffer takes no more
    vehicle.guard.forward(b"disarm")
    until(lambda: pilots_end.time.monotonic() > vehicle.guard._handed + 0.2)
    vehicle.guard.release()
    os.kill(vehicle.guard._process.pid, signal.SIGCONT)
    vehicle.hears(*WILL)
    assert vehicle.ended() == supervisor.SENT
    assert "the pilot's last commands came too late to be sent" in capfd.readouterr().err


def test_signals_that_end_the_pilot_do_not_end_it(vehicle):
    vehicle = vehicle()
    number = vehicle.guard._process.pid
    assert os.getsid(number) == number
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        os.kill(number, getattr(signal, name))
    vehicle.guard.hold()
    vehicle.guard.forward(b"thrust")
    vehicle.guard.close()
    assert vehicle.ended() == supervisor.SENT
    vehicle.hears(b"thrust", *WILL)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_supervisor_that_is_gone_or_hangs_is_told_once(vehicle, number):
    vehicle = vehicle(patience=0.3)
    vehicle.guard.forward(b"one")
    vehicle.hears(b"one")
    os.kill(vehicle.guard._process.pid, number)
    said = r"ended \(exit code -9\)" if number == signal.SIGKILL else "does not answer"
    with pytest.raises(Unsupervised, match=said) as raised:
        until(lambda: not vehicle.guard.forward(b"two"))
    assert not raised.value.fired
    assert not vehicle.guard.forward(b"three")  # the caller must send
    vehicle.guard.release()
    with pytest.raises(Unsupervised):
        vehicle.guard.hold()


def test_a_supervisor_that_was_only_late_sends_its_will_after_a_pilot_that_died(vehicle):
    vehicle = vehicle(patience=0.3)
    vehicle.guard.hold()
    os.kill(vehicle.guard._process.pid, signal.SIGSTOP)
    with pytest.raises(Unsupervised, match="does not answer"):
        until(lambda: not vehicle.guard.forward(b"thrust"))
    os.kill(vehicle.guard._process.pid, signal.SIGCONT)
    vehicle.hears(*WILL)
    assert vehicle.ended() == supervisor.SENT


def test_a_standard_error_that_nobody_reads_does_not_hold_it(vehicle):
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    with contextlib.suppress(BlockingIOError):
        while True:
            os.write(writer, bytes(4096))
    os.set_blocking(writer, True)
    before = os.dup(2)
    os.dup2(writer, 2)
    try:
        vehicle = vehicle()
    finally:
        os.dup2(before, 2)
        os.close(before)
    vehicle.guard.hold()
    vehicle.guard.close()
    vehicle.hears(*WILL)
    assert vehicle.ended() == supervisor.SENT
    os.close(reader)
    os.close(writer)


def test_a_supervisor_that_cannot_be_started(monkeypatch):
    monkeypatch.setattr(pilots_end.sys, "executable", "/nowhere/python")
    with pytest.raises(RunError, match="supervisor cannot be started: No such file"):
        Guard(sender.__file__, "0", "127.0.0.1", "1", patience=1.0)


def test_a_supervisor_that_ends_at_its_start_is_one_line(capfd):
    broken = Guard(sender.__file__, "no number", "127.0.0.1", "1", patience=1.0, isolated=True)
    with pytest.raises(Unsupervised, match=r"ended \(exit code 1\)|ended \(exit code -9\)"):
        broken.wait_until_ready(LIMIT)
    broken.close()
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith("pilot: its supervisor cannot start: ValueError")


def test_its_program_fits_on_two_screens_and_imports_little():
    text = Path(supervisor.__file__).read_text(encoding="utf-8")
    code = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.string.strip() and not token.string.startswith(('"""', "#")):
            code.update(range(token.start[0], token.end[0] + 1))
    assert len(code) <= 125
    assert not foreign(supervisor)
    assert not foreign(sender)
    assert foreign(ros2_sender) == {"rclpy", "std_msgs"}


def foreign(module):
    """Return what the program of a module imports besides the standard library."""
    names = set()
    for node in ast.walk(ast.parse(Path(module.__file__).read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names.add(node.module.partition(".")[0])
    return names - set(sys.stdlib_module_names)
