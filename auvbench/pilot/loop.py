"""Run the loop of a pilot, which steers a vehicle with a controller and commands zero thrust when in doubt.

A pilot starts disarmed, and sends no commands while disarmed. An armed pilot steers only if it has a recent pose within the
depth limits, a waypoint and a finite action; otherwise it commands zero thrust. Its last command is also zero thrust.

At every end, the pilot first commands zero thrust, then disarms, and then does everything that may fail (writing the logbook,
printing to a closed standard output). If the pilot was killed or hangs, its supervisor commands zero thrust instead
(`auvbench.pilot.guard`).
"""

from __future__ import annotations

import contextlib
import math
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from auvbench.errors import AuvbenchError, RunError
from auvbench.pilot.guard import Guard, Unsupervised
from auvbench.pilot.possible import is_jump, is_possible
from auvbench.pilot.steering import Steering
from auvbench.vehicles.physical import PhysicalCommands

Floats = NDArray[np.float64]

RESTS = 3
"""number of zero-thrust commands that bring the vehicle to rest, since a single command may be lost"""
TURN = 0.02
"""longest single wait in s; an old pose is noticed at most this much later"""


class Pilot(ABC):
    """One vehicle under one controller. A subclass implements the communication with the vehicle.

    Args:
        steering: controller with its limits.
        sim_time: whether to step by the vehicle's clock instead of this machine's; ages of poses always use
            this machine's clock.
        say: function called with each change of state.
    """

    source: str
    """source of the pose, for messages"""
    guard: Guard
    """supervisor of the pilot"""

    def __init__(
        self, steering: Steering, *, sim_time: bool = False, say: Callable[[str], None] = lambda text: None
    ) -> None:
        self.steering, self.limits, self._speak = steering, steering.limits, say
        self.physical = PhysicalCommands(steering.vehicle)
        self.period = 1.0 / steering.frequency  # s
        self.armed = False
        self.state = ""
        self.pose: Floats = np.full(7, np.nan)
        self.velocity: Floats = np.zeros(6)
        self._received = (
            self._ticked
        ) = -math.inf  # arrival of the pose and of the vehicle's time, by this machine's clock
        self._stamp = -1
        self._now = -1.0  # s, by the vehicle's clock
        self._sim_time = sim_time
        self._slow = 0
        self._filtered = False
        self._due = 0.0
        self._closed = False
        self._owes_rest = False  # True until the vehicle confirms that it is at rest
        self._unsaid: Exception | None = None
        self.finished = False
        """whether the only mission of a pilot with `steering.once` has ended, with any outcome"""

    # The network.

    @abstractmethod
    def _receive(self, seconds: float) -> None:
        """Handle messages for at most `seconds`."""

    @abstractmethod
    def _command(self, quantities: Floats) -> None:
        """Send the physical commands (n_u,) of the actuators; thrusters' commands are forces in N."""

    @abstractmethod
    def _take_over(self) -> str:
        """Make the vehicle accept commands; return the reason if it does not, else ''."""

    @abstractmethod
    def _leave(self, was_armed: bool) -> None:
        """Wait briefly for the last command to arrive, then close the connection to the vehicle."""

    def _rest(self) -> bool:
        """Command zero thrust several times; return whether the vehicle is known to be at rest."""
        for _ in range(RESTS):
            self._command(self.physical.neutral)
        return True

    def _rest_and_release(self) -> None:
        try:
            self._owes_rest = not self._rest()
            # Until the vehicle is known to be at rest, the supervisor sends its will if the pilot ends.
            if not self._owes_rest:
                self.guard.release()
        except BaseException as error:
            if self.guard.lost is not None:  # the supervisor is lost, so this process sends the commands
                self._rest()
            if not isinstance(error, Unsupervised):
                raise
            self._unsaid = self._unsaid or error  # the error ends the pilot

    def _report(self, text: str) -> None:
        self._say(text)

    def _say(self, text: str) -> None:
        """Print a state; `_settle` later raises an exception of the print, such as a closed standard output."""
        try:
            self._speak(text)
        except Exception as error:
            self._unsaid = self._unsaid or error

    def _settle(self) -> None:
        """Write the ended missions, and raise the exception that `_say` or `_rest_and_release` has stored.

        Writing may fail or take long, so an armed pilot first commands zero thrust.

        Raises:
            RunError: the logbook cannot be written.
            Exception: an exception of `say`.
        """
        if self.steering.ended:
            if self.armed:
                self._command(self.physical.neutral)
            self.steering.write()
        if self._unsaid is not None:
            error, self._unsaid = self._unsaid, None
            raise error

    # Incoming messages.

    def _take_pose(self, stamp: int, pose: Floats, velocity: Floats) -> None:
        """Process a pose (7,) with its velocity (6,) in body axes, and its time in ns by the vehicle's clock."""
        if not is_possible(pose, velocity):
            return
        behind = (self._stamp - stamp) / 1e9  # s
        if behind > self.limits.pose_timeout:
            self._clock_went_back()
        elif behind >= 0.0 and stamp:
            return  # a repeated message, or a message older than the last message, has no newer pose
        else:
            age = time.monotonic() - self._received
            # After a long gap between poses, a jump is possible: the vehicle may have moved.
            if age <= self.limits.lost_after and is_jump(self.pose, pose, max(age, -behind)):
                return
        self._stamp = stamp
        self.pose, self.velocity = pose, velocity
        self._received = time.monotonic()

    def _take_time(self, now: float) -> None:
        """Process the time in s of the vehicle's clock."""
        if now < self._now - self.limits.pose_timeout:
            self._clock_went_back()
        if now != self._now:
            self._ticked = time.monotonic()
        self._now = now

    def _clock_went_back(self) -> None:
        """Disarm: if the clock goes back, the vehicle was probably restarted and may be at another place."""
        self.disarm("the clock went back (was the vehicle restarted?)")

    def steer_to(self, waypoint: Sequence[float], yaw: float = 0.0) -> bool:
        """Set a waypoint (3,) in m, and the yaw of a station in rad; return False if the waypoint is not allowed."""
        limits = self.limits
        if self.steering.once and self.armed:
            self._report("waypoint ignored: the manoeuvre goes on")
            return False
        if not np.all(np.isfinite(waypoint)):
            self._report("waypoint ignored: not finite")
            return False
        if not limits.within(waypoint[2]):
            self._report(f"waypoint ignored: z = {waypoint[2]:g} m, must be within {limits.depths}")
            return False
        if why := self._refusal(np.array(waypoint, dtype=np.float64)):
            self._report(f"waypoint ignored: it {why}")
            return False
        self.steering.end("another waypoint")
        self.steering.waypoint, self.steering.yaw = np.array(waypoint, dtype=np.float64), yaw
        return True

    def _refusal(self, point: Floats) -> str:
        """Return why the filter does not let the vehicle go to `point` (3,); '' if the filter allows it or there is no filter."""
        return "" if self.steering.filter is None else self.steering.filter.refusal(point)

    def arm(self) -> str:
        """Arm the pilot, so that the controller may steer; return why the pilot stays disarmed, or ''.

        Raises:
            Unsupervised: the supervisor has ended or does not answer.
        """
        if self.armed:
            return ""
        what, age = self._oldest()
        if age > self.limits.pose_timeout:
            return f"{what} " + ("never came" if math.isinf(age) else f"is {age:.2g} s old")
        if not self.limits.within(self.pose[2]):
            return self._depth()
        if self.steering.once and (why := self._refusal(self.pose[:3])):
            return f"the vehicle {why}"
        if not self.guard.wait_until_ready():
            return "its supervisor is not ready"
        self.guard.hold()
        if obstacle := self._take_over():
            self.guard.release()
            return obstacle
        if self.steering.once and not self.steer_to(self.pose[:3].tolist()):
            self._rest_and_release()
            return self._refusal(self.pose[:3]) or self._depth()
        self.armed, self._owes_rest = True, False
        self._set_state("armed")
        return ""

    def disarm(self, reason: str) -> None:
        """Command zero thrust, then send no commands until the pilot is armed again.

        Raises:
            RunError: the logbook cannot be written.
        """
        was = self.armed
        self.armed = False
        self.finished = self.finished or (was and self.steering.once)
        try:
            if was or self._owes_rest:
                self._rest_and_release()
        finally:
            self.steering.end(reason)
            self._set_state(f"disarmed: {reason}")
        self._settle()

    def _ages(self) -> dict[str, float]:
        """Return the age in s of each kind of message that the pilot needs continuously, by the name of the kind."""
        now = time.monotonic()
        clock = {"the vehicle's clock": now - self._ticked} if self._sim_time else {}
        return {self.source: now - self._received, **clock}

    def _oldest(self) -> tuple[str, float]:
        return max(self._ages().items(), key=lambda item: item[1])

    @property
    def age(self) -> float:
        """Return the largest age in s of the kinds of messages that the pilot needs continuously (`_ages`)."""
        return self._oldest()[1]

    def _set_state(self, state: str) -> None:
        if state != self.state:
            self.state = state
            self._report(state)

    # Steering.

    def step(self) -> None:
        """Make one step of the controller if it may steer.

        Raises:
            RunError: the controller failed or returned an invalid action, and the pilot was disarmed; or the logbook cannot be
                written.
        """
        if not self.may_steer():
            return
        outcome = self.steering.advance(self.pose)
        if outcome and self.steering.once:
            self.disarm("the manoeuvre is over")
            return
        if outcome:
            self.steering.waypoint = None
            self.steering.end(outcome)
            self._set_state(f"waypoint {'reached' if outcome == 'success' else 'given up: ' + outcome}")
        self._settle()
        if self.steering.waypoint is None:
            self._command(self.physical.neutral)
            return
        self._act(self.steering.waypoint)

    def may_steer(self) -> bool:
        """Return whether the controller may steer; if an armed pilot may not, command zero thrust or disarm."""
        if not self.armed:
            return False
        what, age = self._oldest()
        if age > self.limits.lost_after:
            self.disarm(f"{what} is {age:.1f} s old")
        elif age > self.limits.pose_timeout:
            self._hold(f"holding: {what} is {age:.1f} s old")
        elif not self.limits.within(self.pose[2]):
            self.steering.advance(self.pose)
            self.disarm(self._depth())
        elif (distance := self.steering.distance(self.pose)) > self.limits.reach:
            self.steering.advance(self.pose)
            self.disarm(f"{distance:.1f} m from where it was armed, more than {self.limits.reach:g} m")
        else:
            return True
        return False

    def _hold(self, state: str) -> None:
        self.steering.skip_record()
        self._command(self.physical.neutral)
        if not self.state.startswith("holding"):
            self._set_state(state)

    def _depth(self) -> str:
        return f"z = {self.pose[2]:.2f} m is not within {self.limits.depths}"

    def _act(self, waypoint: Floats) -> None:
        try:
            action = self.steering.act(self.pose, self.velocity)
        except Exception as error:
            raise self._failed(error) from error
        if self.steering.action_time > self.period:
            self._slow += 1
            if self._slow in (1, 10, 100):
                self._report(f"the controller takes longer than its step of {self.period:g} s")
        self._command(self.physical.of_action(action))
        filtered = self.steering.filter is not None and self.steering.filter.changed > 0
        if filtered and not self._filtered:
            self._report("the filter changes commands")
        self._filtered = filtered
        x, y, z = waypoint
        self._set_state(
            "flying the manoeuvre" if self.steering.once else f"steering to ({x:.1f}, {y:.1f}, {z:.1f})"
        )

    def _failed(self, error: Exception) -> AuvbenchError:
        """Disarm, and return the error that ends the command."""
        reason = " ".join(str(error).split()) or type(error).__name__
        with contextlib.suppress(Exception):  # e.g. an error of the logbook; the first error is reported
            self.disarm(f"the controller failed: {reason}")
        return error if isinstance(error, AuvbenchError) else RunError(f"the controller failed: {reason}")

    def run(self, go_on: Callable[[], bool]) -> None:
        """Handle messages and steer while `go_on()` is True; always end with zero thrust.

        Raises:
            AuvbenchError: the controller failed, or the logbook cannot be written.
        """
        try:
            while go_on():
                self.spin_once()
        finally:
            self.close("the pilot was ended")

    def spin_once(self) -> None:
        """Handle messages for a moment, check the pose, and steer if a step is due.

        Raises:
            AuvbenchError: see `run`.
            Exception: an exception of `say`.
        """
        self._spin_once()
        self._settle()

    def _spin_once(self) -> None:
        period = self.period
        now = self._now if self._sim_time else time.monotonic()
        if self._sim_time and now < self._due - 2 * period:
            self._due = now  # the vehicle restarted, and so did its clock
        if now >= self._due:
            self._receive(0.0)  # also receive poses if each step takes longer than its period
            self.step()
            self._due = self._due + period if now - self._due < period else now + period
            return
        # In simulated time, this machine's time until the next step is unknown, so wait only for `TURN`.
        self._receive(TURN if self._sim_time else min(self._due - now, TURN))
        self.may_steer()

    def close(self, reason: str) -> None:
        """Command zero thrust, wait until the command arrives, and close the connection to the vehicle."""
        if self._closed:
            return
        self._closed = True
        was = self.armed
        try:
            self.disarm(reason)
        finally:
            self._leave(was)
