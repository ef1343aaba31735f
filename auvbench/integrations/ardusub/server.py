"""Serve vehicles on UDP ports; each vehicle is in lock-step with the ArduSub that sends to the vehicle's port."""

from __future__ import annotations

import contextlib
import errno
import selectors
import socket
import time
from collections.abc import Callable, Sequence
from functools import partial

from auvbench.errors import UserError
from auvbench.integrations.ardusub import protocol
from auvbench.integrations.ardusub.frames import FRAMES, NEUTRAL, Motors, driven_pulse
from auvbench.integrations.ardusub.physics import Physics
from auvbench.integrations.ardusub.protocol import Packet, PacketError

Address = tuple[str, int]

LOOK = 0.5
"""time in s between two checks of the clock and of Ctrl-C while nothing arrives"""
SILENT = 2.0
"""silence in s after which another ArduSub may take a port; a waiting ArduSub repeats its packet every second"""
PATIENCE = 10.0
"""silence in s before the server prints what to check; also the default interval of reports in s"""
_AT_ONCE = 64
"""largest number of datagrams to read from a port before the next port's turn"""
_DIFFERENCE = 5
"""difference of a pulse from neutral in us above which its motor turns"""
_SUSPICION = 50
"""number of consecutive packets that must match another frame before the server reports an error"""


class FrameCheck:
    """Checks whether ArduSub is set to the vehicle's frame, by the channels on which ArduSub sends pulses."""

    def __init__(self, motors: Motors) -> None:
        self._motors = motors
        self._suspicion = 0
        self.turned = False
        """whether a motor has turned since ArduSub started"""

    def check(self, pwm: Sequence[int]) -> None:
        """Check a packet's PWM in us.

        Raises:
            UserError: ArduSub drives fewer motors than the vehicle has, or it is set to the frame vectored_6dof and the
                vehicle has the frame vectored.
        """
        count = len(self._motors.order)
        turning = any(driven_pulse(p) and abs(p - NEUTRAL) > _DIFFERENCE for p in pwm[:count])
        if not turning:  # before ArduSub is set up, channels have no pulse
            return
        self.turned = True
        for channel, pulse in enumerate(pwm[:count], 1):
            if not driven_pulse(pulse):
                raise self._other(f"channel {channel} has no PWM: ArduSub has fewer than {count} motors")
        if self._motors.frame is not FRAMES["vectored"]:
            return
        # In vectored_6dof, roll and pitch cancel in the sum of each diagonal pair of the four vertical motors, so a + d equals
        # b + c except for rounding of PWM.
        a, b, c, d = pwm[4:8]
        moved = all(driven_pulse(p) and abs(p - NEUTRAL) > _DIFFERENCE for p in (c, d))
        self._suspicion = self._suspicion + 1 if moved and abs(a + d - b - c) <= 4 else 0
        if self._suspicion >= _SUSPICION:
            raise self._other("channels 7 and 8 turn as motors of vectored_6dof (FRAME_CONFIG 2)")

    def _other(self, why: str) -> UserError:
        frame, name = self._motors.frame, self._motors.vehicle.name
        if frame is None:
            return UserError(
                f"{why}; {name} has {len(self._motors.order)} motors: set FRAME_CONFIG and --motors to match"
            )
        return UserError(
            f"{why}; vehicle={name} is {frame.name}: set FRAME_CONFIG to {frame.config} and reboot ArduSub, or serve another vehicle"
        )


class Port:
    """A vehicle and the ArduSub that controls it.

    Args:
        physics: physics of the vehicle.
        address: address to listen at.
        say: function that prints a line.

    Raises:
        UserError: the port is taken, or the address does not belong to this machine.
    """

    def __init__(self, physics: Physics, address: Address, say: Callable[[str], None]) -> None:
        self.physics = physics
        self.say = say
        self.peer: Address | None = None
        self.steps = 0
        self.frame_rate = 0
        self.heard = time.monotonic()
        """time of the peer's last packet, or of the server's start"""
        self.socket = _listen(address)
        self.number: int = self.socket.getsockname()[1]
        self._count = -1
        self._reply = b""
        self._rival: Address | None = None
        """address of another sender that has sent a packet since the peer's last packet"""
        self._told: set[str] = set()
        self._frame = FrameCheck(physics.motors)

    def serve(self) -> None:
        """Answer the packets that have arrived.

        Raises:
            UserError: ArduSub has a different frame than the vehicle.
            TrainingError: the motion is not finite.
        """
        packet = self._newest()
        if packet is None or self.peer is None:
            return
        if packet.frame_count != self._count:
            if packet.frame_count < self._count:
                self._begin("ArduSub restarted")
            self._frame.check(packet.pwm)
            self._count, self.frame_rate = packet.frame_count, packet.frame_rate
            # ArduSub takes its depth during sensor setup as the surface. A heavy vehicle would sink meanwhile, so each
            # vehicle is held until a motor turns.
            held = not self._frame.turned
            move = self.physics.hold if held else partial(self.physics.step, packet.pwm)
            self._reply = protocol.reply(move(packet.duration))
            self.steps += 1
        # ArduSub repeats its packet if a reply is lost.
        with contextlib.suppress(OSError):
            self.socket.sendto(self._reply, self.peer)

    def _newest(self) -> Packet | None:
        """Return the peer's newest packet, or None; earlier packets are repetitions or out of date."""
        newest = None
        for _ in range(_AT_ONCE):
            try:
                datagram, sender = self.socket.recvfrom(protocol.LARGEST + 1)
            except OSError:
                break
            try:
                packet = protocol.parse(datagram)
            except PacketError as error:
                self._tell_once(
                    "garbage",
                    f"{_shown(sender)} sent {error}; the packet is ignored; is the sender ArduSub with --model JSON?",
                )
                continue
            if self._accepts(sender):
                newest = packet
        return newest

    def _accepts(self, sender: Address) -> bool:
        """Return whether a sender controls this vehicle: the first sender does, until it is silent for `SILENT` s."""
        now = time.monotonic()
        if sender != self.peer:
            if self.peer is not None and now - self.heard < SILENT:
                self._rival = sender
                return False
            self.peer, self._rival = sender, None
            self._begin(f"ArduSub at {_shown(sender)}")
        elif self._rival is not None:
            self._tell_once(
                "rival",
                f"{_shown(self._rival)} also sends, and is ignored: {_shown(sender)} controls this vehicle; "
                "give each ArduSub an"
                f" instance (-I 1: port {self.number + protocol.PORT_STEP}) and serve --vehicles 2",
            )
            self._rival = None
        self.heard = now
        return True

    def _begin(self, why: str) -> None:
        """Reset the vehicle for an ArduSub that starts."""
        self.physics.reset()
        self._count, self._frame = -1, FrameCheck(self.physics.motors)
        self.say(f"port {self.number}: {why}; {self.physics.vehicle.name} at its start")

    def _tell_once(self, what: str, text: str) -> None:
        if what not in self._told:
            self._told.add(what)
            self.say(f"port {self.number}: {text}")


class Server:
    """Server of one vehicle for each of ArduPilot's instances 0, 1, ..., whose ports are 10 apart.

    Args:
        vehicles: one vehicle for each port.
        address: address to listen at.
        port: first port.
        give_up: time in s without a packet from any ArduSub after which `run` raises an error; None: wait forever.
        say: function that prints a line.
        report: function that prints a line of progress, called about every `every` s.
        every: interval of reports, s.

    Raises:
        UserError: a port is taken, or the address does not belong to this machine.
    """

    def __init__(
        self,
        vehicles: Sequence[Physics],
        address: str = "127.0.0.1",
        port: int = protocol.PORT,
        *,
        give_up: float | None = None,
        say: Callable[[str], None] = print,
        report: Callable[[str], None] = print,
        every: float = PATIENCE,
    ) -> None:
        self.say = say
        self._report, self._every = report, every
        self._give_up = give_up
        self._selector = selectors.DefaultSelector()
        self.ports: list[Port] = []
        try:
            for i, physics in enumerate(vehicles):
                self.ports.append(Port(physics, (address, port + i * protocol.PORT_STEP), say))
        except UserError:
            self.close()
            raise
        for entry in self.ports:
            self._selector.register(entry.socket, selectors.EVENT_READ, entry)
        self._meter = Meter(self.ports)
        self._hinted = False

    def compile(self) -> None:
        """Compile the functions of a step before ArduSub waits for them."""
        for port in self.ports:
            port.physics.step((0,) * protocol.CHANNELS[min(protocol.CHANNELS)], 1e-3)
            port.physics.reset()
            port.heard = time.monotonic()

    def run(self, go_on: Callable[[], bool]) -> None:
        """Serve while `go_on()` returns True.

        Raises:
            UserError: ArduSub has a different frame than the vehicle, or every ArduSub was silent for
                `give_up` s.
            TrainingError: the motion is not finite.
        """
        while go_on():
            for key, _ in self._selector.select(LOOK):
                key.data.serve()
            self._watch()

    def _watch(self) -> None:
        """Report progress, or what to check if nothing arrives."""
        now = time.monotonic()
        silence = now - max(port.heard for port in self.ports)
        if silence < PATIENCE:
            self._hinted = False
        if self._give_up is not None and silence >= self._give_up:
            raise UserError(f"{self._silence(silence)} (--give-up {self._give_up:g})")
        if silence >= PATIENCE and not self._hinted:
            self._hinted = True
            self.say(f"{self._silence(silence)}; waiting")
        if now - self._meter.began >= self._every and (line := self._meter.line(now)):
            self._report(line)

    def _silence(self, silence: float) -> str:
        host, port = self.ports[0].socket.getsockname()
        if all(entry.peer is None for entry in self.ports):
            return (
                f"no packet on UDP {host}:{port} for {silence:.0f} s: is ArduSub running with {started(host, port)}? If ArduSub is on"
                " another machine, serve with --address 0.0.0.0"
            )
        return f"ArduSub has been silent for {silence:.0f} s: was it stopped or paused?"

    def close(self) -> None:
        """Close the ports."""
        self._selector.close()
        for port in self.ports:
            port.socket.close()


class Meter:
    """Meter of simulated time, its ratio to real time, and steps per second."""

    def __init__(self, ports: Sequence[Port]) -> None:
        self._ports = ports
        self.began = time.monotonic()
        self._steps = 0

    def line(self, now: float) -> str:
        """Return the progress since the last line; '' if no vehicle moved."""
        steps = sum(port.steps for port in self._ports)
        rate = (steps - self._steps) / (now - self.began)
        self.began, self._steps = now, steps
        moving = [port for port in self._ports if port.frame_rate]
        if not moving or rate == 0.0:
            return ""
        simulated = ", ".join(f"{port.physics.time:,.1f} s" for port in moving[:4])
        more = "" if len(moving) <= 4 else " ..."
        pace = rate / sum(port.frame_rate for port in moving)
        rates = ", ".join(map(str, sorted({port.frame_rate for port in moving})))
        return f"{simulated}{more} simulated, {pace:.2f} x real time, {rate:,.0f} steps/s at {rates} Hz"


def started(address: str, port: int) -> str:
    """Return the command-line flags that make ArduSub send to a port.

    >>> started("127.0.0.1", 9002), started("127.0.0.1", 9022), started("127.0.0.1", 9003)
    ('--model JSON:127.0.0.1', '-I 2 --model JSON:127.0.0.1', '--model JSON:127.0.0.1 --sim-port-out 9003')
    """
    instance, rest = divmod(port - protocol.PORT, protocol.PORT_STEP)
    model = f"--model JSON:{'THIS_MACHINE' if address == '0.0.0.0' else address}"
    if rest or not 0 <= instance < 100:
        return f"{model} --sim-port-out {port}"
    return f"-I {instance} {model}" if instance else model


def _listen(address: Address) -> socket.socket:
    if not address[0].strip():  # the socket would listen at all addresses
        raise UserError(
            "--address '': must be an IPv4 address of this machine; 0.0.0.0 listens at all addresses"
        )
    listener = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    listener.setblocking(False)
    try:
        listener.bind(address)
    except (OSError, OverflowError) as error:
        listener.close()
        code = getattr(error, "errno", None)
        if code == errno.EADDRINUSE:
            raise UserError(
                f"UDP port {address[1]} is taken: is another auvbench serve running? Use --port N"
            ) from None
        if code == errno.EACCES:
            raise UserError(f"--port {address[1]}: must be at least 1024 without special rights") from None
        raise UserError(
            f"--address {address[0]}: is not an IPv4 address of this machine; 0.0.0.0 listens at all addresses"
        ) from None
    return listener


def _shown(address: Address) -> str:
    return f"{address[0]}:{address[1]}"
