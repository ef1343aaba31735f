"""Faults of a pilot in flight, many times over: the vehicle must end at rest.

    python -m tests.soak.pilot --trials 500 --seed 1

Each trial is a pilot in a process of its own, a vehicle, and one fault: a signal at a random instant; a signal, an error or a
hang at one of the pilot's calls of the operating system; an exception in a callback; a full disk or a record folder that was
replaced, at one of the pilot's endings; a supervisor that is killed or halted. Over MAVLink the stand-in for ArduSub is the
vehicle, which has no failsafe of its own; one trial in twenty is over ROS 2. Prints a line of JSON: there must be no `armed`
trial, in which the vehicle was armed, or commanded to push, `WITHIN` s after the pilot's end.
"""

from __future__ import annotations

import argparse
import collections
import contextlib
import dataclasses
import json
import multiprocessing
import os
import random
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from auvbench.integrations.mavlink.pilot import Pilot as MavlinkPilot
from auvbench.pilot import loop
from auvbench.pilot.mission import Logbook
from auvbench.pilot.steering import Limits, Steering
from auvbench.runs import interruption
from auvbench.tasks.observation_spec import observation_spec
from auvbench.vehicles.sheet import load
from tests import configs
from tests.mavlink_vehicle import ArduSub, free_port
from tests.soak import pilot_faults
from tests.soak.pilot_faults import Fault

NEUTRAL = (0, 0, 500, 0, 0, 0)
FLIGHT = 0.6
"""s"""
WITHIN = 20.0
"""s until the vehicle must be at rest; it is after one, but the machine may be busy"""
SETTLED = 0.6
"""s in which late commands would arrive, and in which a supervisor tells what it did"""
ROS = 20
"""one trial of so many is over ROS 2"""
LIMITS = Limits(
    depth_low=-60.0,
    depth_high=-1.0,
    goal_radius=1.0,
    max_steps=10_000,
    pose_timeout=0.3,
    lost_after=0.8,
    patience=0.3,
)


class Ahead:
    """Half thrust ahead."""

    def reset(self, episodes: Any) -> None:
        pass

    def act(self, observation: Any) -> Any:
        return np.array([[0.5, 0.5, 0.5, 0.5, 0.0, 0.0]])


@dataclasses.dataclass
class Outcome:
    """What a trial came to."""

    network: str
    fault: str
    struck: bool = False
    """the fault came before the pilot had ended"""
    flown: bool = False
    """the vehicle was armed and pushed"""
    fired: bool = False
    """the supervisor brought it to rest"""
    armed: bool = False
    output: str = ""


@cache
def warm() -> Any:
    """Return the physics of this process, and import and compile what the pilots need."""
    return ArduSub(free_port()).physics, observation_spec(
        configs.training("algo=pid").task, load("bluerov2").actuators
    )


def fly(open_pilot: Callable[[Steering], loop.Pilot], fault: Fault, folder: Path) -> None:
    """Be the pilot: open, arm, steer for a moment, end; the fault comes on the way."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    output = os.open(folder / "output", os.O_WRONLY | os.O_CREAT)
    os.dup2(output, 1)
    os.dup2(output, 2)
    sys.stdout, sys.stderr = os.fdopen(1, "w", closefd=False), os.fdopen(2, "w", closefd=False)
    steering = Steering(Ahead(), load("bluerov2"), 20.0, warm()[1], LIMITS)
    pilot = open_pilot(steering)
    with interruption.deferred() as request:
        try:
            steering.logbook = Logbook(folder / "missions", {"frequency_hz": 20.0})
            pilot.steer_to([1e4, 0.0, -20.0])
            while pilot.age > LIMITS.pose_timeout:
                pilot.spin_once()
            fault.install(pilot, folder)
            fault.phase("arm")
            if why := pilot.arm():
                raise RuntimeError(why)
            (folder / "armed").touch()
            fault.phase("flight")
            end = time.monotonic() + FLIGHT
            pilot.run(lambda: request.signal is None and fault.goes_on(time.monotonic() < end))
        finally:
            pilot.close("the pilot was ended")


def forked(work: Callable[[], None]) -> int:
    """Run `work` in a forked process; return its number."""
    number = os.fork()
    if number == 0:
        status = 1
        try:
            work()
            status = 0
        except BaseException:
            sys.setprofile(None)
            traceback.print_exc()
        finally:
            for stream in (sys.stdout, sys.stderr):
                with contextlib.suppress(OSError, ValueError):
                    stream.flush()
            os._exit(status)
    return number


@contextlib.contextmanager
def over_mavlink(fault: Fault, folder: Path) -> Iterator[tuple[int, Callable[[], bool], Callable[[], bool]]]:
    """Start pilot and vehicle; yield the pilot's process, whether the vehicle flew, and whether it is at rest."""
    port = free_port()
    physics = warm()[0]
    physics.reset()
    vehicle = ArduSub(port, physics=physics, period=0.05)
    number = forked(lambda: fly(lambda s: MavlinkPilot(f"udp:127.0.0.1:{port}", s, say=print), fault, folder))
    try:
        with vehicle:
            yield (
                number,
                lambda: any(sticks != NEUTRAL for sticks in vehicle.sticks),
                lambda: not vehicle.armed and vehicle.sticks[-1:] in ([], [NEUTRAL]),
            )
    finally:
        end(number)


def end(number: int) -> None:
    """Kill a process, unless it has been waited for."""
    with contextlib.suppress(ProcessLookupError, ChildProcessError):
        os.kill(number, signal.SIGKILL)
        os.waitpid(number, 0)


def wait(condition: Callable[[], bool], seconds: float) -> bool:
    limit = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > limit:
            return False
        time.sleep(0.005)
    return True


def trial(plan: tuple[int, int, bool]) -> Outcome:
    """Make trial number `plan[1]` of the seed `plan[0]`; `plan[2]`: over ROS 2."""
    seed, i, ros = plan
    rng = random.Random(f"{seed} {i}")
    fault = pilot_faults.draw(rng)
    outcome = Outcome("ros2" if ros else "mavlink", fault.name)
    folder = Path(tempfile.mkdtemp(prefix="auvbench-soak-"))
    if ros:
        from tests.soak.pilot_ros import over_ros as start
    else:
        start = over_mavlink
    try:
        with start(fault, folder) as (number, flown, rests):
            over: list[int] = []

            def ended() -> bool:
                """Whether the pilot ended or was halted."""
                if not over and os.waitpid(number, os.WNOHANG | os.WUNTRACED)[0]:
                    over.append(1)
                return bool(over) or (folder / "hangs").exists()

            if fault.instant is not None:
                wait(lambda: (folder / "armed").exists() or ended(), 60.0)
                wait(ended, fault.instant)
                if not ended():
                    fault.strike(number, folder)
            wait(ended, 60.0)
            outcome.armed = not (ended() and wait(rests, WITHIN))
            outcome.fired = wait(lambda: b" sent\n" in (folder / "output").read_bytes(), SETTLED)
            outcome.armed |= not rests()
            outcome.flown, outcome.struck = flown(), (folder / "struck").exists()
            outcome.output = (folder / "output").read_text(errors="replace")
    except Exception:
        outcome.armed, outcome.output = True, traceback.format_exc()
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return outcome


def campaign(trials: int, seed: int, jobs: int, every: int = ROS) -> dict[str, Any]:
    """Make trials, `jobs` at a time; return their counts."""
    warm()
    counts: dict[str, Any] = {"trials": 0, "struck": 0, "flown": 0, "by the supervisor": 0, "ros2": 0}
    kinds: collections.Counter[str] = collections.Counter()
    armed = []
    began = time.monotonic()
    plans = [(seed, i, bool(every) and i % every == every - 1) for i in range(trials)]
    with multiprocessing.get_context("fork").Pool(jobs) as pool:
        for outcome in pool.imap_unordered(trial, plans):
            counts["trials"] += 1
            counts["struck"] += outcome.struck
            counts["flown"] += outcome.flown
            counts["by the supervisor"] += outcome.fired
            counts["ros2"] += outcome.network == "ros2"
            kinds[outcome.fault] += 1
            if outcome.armed:
                armed.append(dataclasses.asdict(outcome))
    seconds = round(time.monotonic() - began, 1)
    return {**counts, "seconds": seconds, "kinds": dict(sorted(kinds.items())), "armed": armed}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=500)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--jobs", type=int, default=2 * interruption.cores(), help="trials at a time: they mostly wait"
    )
    given = parser.parse_args()
    counts = campaign(given.trials, given.seed, given.jobs)
    print(json.dumps(counts))
    return int(len(counts["armed"]) > 0.001 * given.trials)


if __name__ == "__main__":
    sys.exit(main())
