"""Receive ArduSub's telemetry over a link and send commands to ArduSub.

Sources: ArduSub/GCS_MAVLink_Sub.cpp, ArduSub/mode.h, ArduSub/failsafe.cpp, libraries/GCS_MAVLink/GCS_Common.cpp.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from functools import partial
from typing import Any

from auvbench.errors import UserError
from auvbench.integrations.ardusub.radio import MANUAL
from auvbench.integrations.mavlink.failsafes import FAILSAFES
from auvbench.integrations.mavlink.link import TURN, Link, Peer
from auvbench.integrations.mavlink.mixer import NEUTRAL, Sticks
from auvbench.integrations.mavlink.telemetry import FIELDS, Telemetry
from auvbench.untrusted.text import short

FOUND = 10.0
"""longest time in s to wait for a vehicle's first message, and for the answer to a request"""
AGAIN = 0.5
"""time in s after which an unanswered request is repeated"""
TOLD = 2.0
"""longest time in s to wait for the failsafes' parameters; an older ArduSub does not answer a request for a parameter that it lacks"""
SILENT = 5.0
"""time in s without a message after which `company` no longer reports a second vehicle"""
BEAT = 0.1
"""requested interval of heartbeats in s; heartbeats report the mode"""
WARNING = 4
"""MAV_SEVERITY of a warning; more severe messages have lower numbers"""
ROUNDS = 6
"""number of times that `Autopilot.will` repeats neutral sticks and the command to disarm, since packets may be lost"""
PARAMETERS = {"FRAME_CONFIG": (0.0, 100.0), "JS_THR_GAIN": (0.1, 10.0), "MOT_FV_CPLNG_K": (0.0, 10.0)}
"""parameters that the mixer needs, with their valid ranges"""


class Autopilot:
    """The vehicle on a link.

    Args:
        link: open link.
        rate: requested rate of telemetry, Hz.
        say: function called with the vehicle's warnings.

    Attributes:
        armed: whether the vehicle was armed in its last heartbeat.
        mode: mode in the last heartbeat.
        gain: joystick gain that the vehicle reports.
        parameters: values of the parameters in `PARAMETERS` by name, and of the parameters in `FAILSAFES` that the
            vehicle has.
        telemetry: attitude, position and heartbeats.
        warning: last warning.

    Raises:
        UserError: no vehicle is heard, or the vehicle is not an ArduPilot submarine or does not answer.
    """

    def __init__(self, link: Link, rate: float, say: Callable[[str], None] = lambda text: None) -> None:
        self.link, self._say = link, say
        self._dialect = link.dialect
        self._interval = 1e6 / rate  # us
        self.armed, self.mode = False, -1
        self.gain = math.nan
        self.parameters: dict[str, float] = {}
        self.warning = ""
        self._who: tuple[Peer, int] | None = None
        self._others: dict[tuple[Peer, int], float] = {}  # time of the last message of each vehicle
        self._answers: dict[int, int] = {}  # results by command
        self.telemetry = Telemetry()
        self._beat = self._asked = -math.inf
        if not self.until(lambda: self._who is not None, FOUND):
            raise UserError(
                f"--mavlink {link.address}: no vehicle was heard in {FOUND:g} s; check that ArduSub sends to this address"
                " (SITL: --serial0 udpclient:HOST:PORT; BlueOS: an endpoint) and that no other program has the port"
            )
        for name in PARAMETERS:
            self._need(lambda name=name: name in self.parameters, name, partial(self._ask, name))  # type: ignore[misc]
        self.until(lambda: self.parameters.keys() >= FAILSAFES.keys(), TOLD, self._ask_failsafes)
        self._need(lambda: not math.isnan(self.gain), "NAMED_VALUE_FLOAT PilotGain", self.ask_telemetry)

    def _need(self, condition: Callable[[], bool], what: str, ask: Callable[[], None]) -> None:
        if not self.until(condition, FOUND, ask):
            raise UserError(
                f"--mavlink {self.link.address}: the vehicle did not send {what} in {FOUND:g} s; is it ArduSub?"
            )

    def until(
        self, condition: Callable[[], bool], seconds: float, ask: Callable[[], None] = lambda: None
    ) -> bool:
        """Handle messages until `condition()` is true, for at most `seconds`; return whether it is true.

        Calls `ask` at once, and again every `AGAIN` s.
        """
        end, again = time.monotonic() + seconds, -math.inf
        while not condition():
            now = time.monotonic()
            if now >= end:
                return False
            if now >= again:
                ask()
                again = now + AGAIN
            self.receive(min(end, again, now + TURN) - now)
        return True

    def _ask(self, name: str) -> None:
        self._send("param_request_read", name.encode(), -1, component=True)

    def _ask_failsafes(self) -> None:
        for name in FAILSAFES.keys() - self.parameters.keys():
            self._ask(name)

    # Incoming messages.

    def receive(self, seconds: float) -> None:
        """Handle the messages that have arrived, or wait at most `seconds` for one.

        Raises:
            RunError: the link was closed.
            UserError: the first vehicle that is heard is not an ArduPilot submarine.
        """
        if time.monotonic() - self._beat >= 1.0:
            self._beat = time.monotonic()
            self._send_heartbeat()
        for peer, message in self.link.receive(seconds):
            # 1 is the autopilot; cameras and companion computers of the same vehicle have other numbers.
            if message.get_srcComponent() != 1:
                continue
            sender = (peer, message.get_srcSystem())
            if message.get_type() == "HEARTBEAT":
                self._heartbeat(sender, message)
            elif sender == self._who:
                self._handle(message)

    def _heartbeat(self, who: tuple[Peer, int], message: Any) -> None:
        d = self._dialect
        if message.autopilot == d.MAV_AUTOPILOT_INVALID or message.type == d.MAV_TYPE_GCS:
            return
        if self._who is None:
            if message.type != d.MAV_TYPE_SUBMARINE or message.autopilot != d.MAV_AUTOPILOT_ARDUPILOTMEGA:
                raise UserError(
                    f"--mavlink {self.link.address}: system {who[1]} at {_written(who[0])} is not an ArduPilot submarine"
                    f" (MAV_TYPE {message.type}, must be {d.MAV_TYPE_SUBMARINE}; MAV_AUTOPILOT {message.autopilot}, must be"
                    f" {d.MAV_AUTOPILOT_ARDUPILOTMEGA})"
                )
            self._who = who
        if who != self._who:
            self._others[who] = time.monotonic()
            return
        self.armed = bool(message.base_mode & d.MAV_MODE_FLAG_SAFETY_ARMED)
        self.mode = message.custom_mode
        self.telemetry.beat()

    def _handle(self, message: Any) -> None:
        kind = message.get_type()
        if kind in FIELDS:
            self.telemetry.take(message)
        elif kind == "PARAM_VALUE":
            low, high = {**PARAMETERS, **FAILSAFES}.get(message.param_id, (math.inf, -math.inf))
            if low <= message.param_value <= high:
                self.parameters[message.param_id] = message.param_value
        elif kind == "NAMED_VALUE_FLOAT":
            if message.name == "PilotGain" and 0.1 <= message.value <= 1.0:
                self.gain = message.value
        elif kind == "COMMAND_ACK":
            self._answers[message.command] = message.result
        elif kind == "STATUSTEXT" and message.severity <= WARNING:
            self.warning = short(message.text, 80)
            self._say(f"ArduSub: {self.warning}")

    @property
    def company(self) -> str:
        """Return system number and address of a second vehicle heard on the link; '' without a second vehicle."""
        for (peer, system), when in self._others.items():
            if time.monotonic() - when < SILENT:
                return f"system {system} at {_written(peer)}"
        return ""

    @property
    def peer(self) -> Peer:
        """Return the vehicle's address."""
        assert self._who is not None
        return self._who[0]

    @property
    def who(self) -> str:
        """Return the vehicle's system number and address as text."""
        assert self._who is not None
        return f"system {self._who[1]} at {_written(self._who[0])}"

    # Outgoing messages.

    def ask_telemetry(self) -> None:
        """Request attitude, position, frequent heartbeats and the joystick's gain."""
        d = self._dialect
        for message in (d.MAVLINK_MSG_ID_ATTITUDE, d.MAVLINK_MSG_ID_LOCAL_POSITION_NED):
            self._command(d.MAV_CMD_SET_MESSAGE_INTERVAL, message, self._interval)
        self._command(d.MAV_CMD_SET_MESSAGE_INTERVAL, d.MAVLINK_MSG_ID_HEARTBEAT, 1e6 * BEAT)
        # ArduSub sends its named values only with this stream.
        self._send("request_data_stream", d.MAV_DATA_STREAM_EXTENDED_STATUS, 2, 1, component=True)

    def manual_control(self, sticks: Sticks) -> None:
        """Send the positions of the sticks."""
        self.link.send(self._manual_control(sticks), self.peer)

    def _manual_control(self, sticks: Sticks) -> Any:
        extensions = 3  # bits for the fields s and t
        fields = (sticks.x, sticks.y, sticks.z, sticks.r, 0, 0, extensions, sticks.s, sticks.t)
        return self._message("manual_control", *fields)

    def take_over(self) -> str:
        """Switch the vehicle to MANUAL and arm it; return why this failed, or ''."""
        d = self._dialect
        self._answers.clear()
        self.warning = ""
        if not self.until(
            lambda: self.mode == MANUAL, 3.0, lambda: self._command(d.MAV_CMD_DO_SET_MODE, 1, MANUAL)
        ):
            return self._refused("the mode MANUAL")
        self.manual_control(NEUTRAL)
        arm = d.MAV_CMD_COMPONENT_ARM_DISARM

        def answered() -> bool:
            return self.armed or self._answers.get(arm, d.MAV_RESULT_ACCEPTED) != d.MAV_RESULT_ACCEPTED

        if not self.until(answered, 5.0, lambda: self._command(arm, 1)) or not self.armed:
            self._command(arm, 0)  # the vehicle must not stay armed if it carries out the command to arm late
            return self._refused("arming")
        return ""

    def _refused(self, what: str) -> str:
        return f"ArduSub refuses {what}" + (f": {self.warning}" if self.warning else "")

    def disarm(self, seconds: float) -> bool:
        """Request disarming until the vehicle's heartbeat confirms it, for at most `seconds`; return whether it was confirmed.

        An acknowledgement is not proof: it may be the late answer to an earlier command to arm.
        """
        arm = self._dialect.MAV_CMD_COMPONENT_ARM_DISARM
        return self.until(lambda: not self.armed, seconds, lambda: self._command(arm, 0))

    def will(self) -> list[bytes]:
        """Return the packets that bring the vehicle to rest from any state."""
        disarm = (self._dialect.MAV_CMD_COMPONENT_ARM_DISARM, 0, *[0.0] * 7)
        messages = [self._manual_control(NEUTRAL), self._message("command_long", *disarm, component=True)]
        return [self.link.pack(message) for _ in range(ROUNDS) for message in messages]

    def _command(self, command: int, *values: float) -> None:
        numbers = [*values, *[0.0] * (7 - len(values))]
        self._send("command_long", command, 0, *numbers, component=True)

    def _send_heartbeat(self) -> None:
        d = self._dialect
        if self._who is not None:
            beat = d.MAVLink_heartbeat_message(
                d.MAV_TYPE_GCS, d.MAV_AUTOPILOT_INVALID, 0, 0, d.MAV_STATE_ACTIVE, 3
            )
            self.link.send(beat, self._who[0])

    def _send(self, name: str, *fields: Any, component: bool = False) -> None:
        self.link.send(self._message(name, *fields, component=component), self.peer)

    def _message(self, name: str, *fields: Any, component: bool = False) -> Any:
        """Return a message whose first field is the vehicle's system number, then 1 (the autopilot) if `component`, then `fields`."""
        assert self._who is not None
        target = (self._who[1], 1) if component else (self._who[1],)
        return getattr(self._dialect, f"MAVLink_{name}_message")(*target, *fields)


def _written(peer: Peer) -> str:
    return f"{peer[0]}:{peer[1]}"
