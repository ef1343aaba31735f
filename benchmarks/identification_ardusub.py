"""Measure how often 95 % intervals of `auvbench identify` contain the truth, on logs of ArduSub's SITL.

`python -m benchmarks.identification_ardusub 1 2 3` flies dives 1 to 3 and fits a sheet to each `.BIN`. A dive is a function of its
number but for ArduSub's own timing: a vehicle that is drawn from the prior around `bluerov2_2026`, on auvbench's physics in lock-step
with ArduSub's SITL (`AUVBENCH_ARDUSUB`), flies the manoeuvre of `auvbench pilot excite`, a minute per axis. Sticks are sent at 20 Hz
with some jitter. A vehicle that turns over is left out. `--folder` keeps the logs, and takes those that it has; `--factor 1` leaves out
the factor on the standard deviations.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
from collections import deque
from dataclasses import replace
from pathlib import Path

import numpy as np

from auvbench.identification import gate, parameters
from auvbench.identification.fit import fit
from auvbench.integrations.ardusub import sitl
from auvbench.integrations.ardusub.frames import LONGEST, VOLTAGE, motors_of
from auvbench.integrations.ardusub.radio import MANUAL
from auvbench.integrations.ardusub.sensors import Sensors
from auvbench.integrations.mavlink import dataflash
from auvbench.integrations.mavlink.mixer import NEUTRAL, Mixer
from auvbench.simulators.fossen import FossenSimulator
from auvbench.statistics.intervals import wilson
from auvbench.vehicles import sheet, signals
from auvbench.vehicles.physical import PhysicalCommands
from benchmarks.identification import AXES, LARGEST, VEHICLE, Case

SECONDS = 60.0
"""Time for each axis, s."""
PERIOD, JITTER = 0.05, 0.005
"""Time between two positions of the sticks, and its largest deviation, s."""
GAIN = 0.5
"""Joystick gain."""
AMPLITUDES = (0.12, 0.2)
DEPTH = 25.0
"""Depth in m at the start."""
UPRIGHT = 0.025
"""Smallest height of the centre of buoyancy in m from dive 10 on, because half of the vehicles before turned over."""


def drawn(number: int, generator: np.random.Generator) -> dict[str, float]:
    """Return the true numbers of a dive: those of the prior, with a delay in every second dive."""
    chosen = parameters.choose(sheet.load(VEHICLE), (), False)
    x = np.clip(generator.standard_normal(len(chosen)), -LARGEST, LARGEST)
    truth = parameters.values_of(chosen, x)
    truth["delay"] = 0.0 if number % 2 else round(400.0 * truth["delay"]) / 400.0
    if number >= 10:
        truth["center_of_buoyancy.z"] = max(truth["center_of_buoyancy.z"], UPRIGHT)
    truth["net_buoyancy"] = abs(truth["net_buoyancy"])
    return truth


def fly(number: int, file: Path) -> dict[str, float]:
    """Fly a dive, and write its log to `file`; return the true numbers, or none if the vehicle turns over."""
    generator = np.random.default_rng([4711, number])
    base = sheet.load(VEHICLE)
    truth = drawn(number, generator)
    amplitude = float(generator.uniform(*AMPLITUDES))
    vehicle = parameters.with_values(base, truth)
    motors, physical = motors_of(vehicle), PhysicalCommands(vehicle)
    assert motors.frame is not None
    simulator = FossenSimulator(physical.model, 1)
    pulses = np.repeat(np.arange(LONGEST + 1)[:, None], len(motors.order), axis=1)
    commands = physical(motors.forces(pulses, "t200", VOLTAGE))
    sensors, mixer = Sensors(simulator), Mixer(motors_of(base))
    seed = 0 if number < 3 else number  # 0 is that of the pilot
    lift = float(base.weight - base.buoyancy)
    manoeuvre = signals.telegraph(
        base, AXES, len(AXES) * SECONDS, amplitude, np.random.default_rng(seed), lift=lift
    )
    forces = base.force(manoeuvre)
    simulator.reset(np.arange(1), np.array([[0, 0, -DEPTH, 0.5**0.5, 0, 0, 0.5**0.5]]), np.zeros((1, 6)))
    named = {
        "FRAME_CONFIG": motors.frame.config,
        "LOG_BACKEND_TYPE": 1,
        "LOG_BITMASK": 180222,  # sub.parm of ArduPilot's SITL
        "JS_GAIN_DEFAULT": GAIN,
    }
    pilot = sitl.Sitl(sitl.find()[0], named)
    try:
        pilot.settle(sensors.reset(), MANUAL)
        duration = pilot.packet.duration
        late = deque([pilot.packet.pwm], maxlen=1 + round(truth["delay"] / duration))
        row = np.zeros((1, len(vehicle.units)))
        begun, due, seen, step = pilot.time, generator.uniform(0.05, 0.15), 0.0, -20
        while step < len(AXES) * SECONDS / PERIOD + 20:
            now = pilot.time - begun
            if now >= due:
                due += PERIOD + generator.uniform(-JITTER, JITTER)
                sticks, at = NEUTRAL, int(step * PERIOD / signals.INTERVAL + 1e-9)
                if 0 <= at < len(forces):
                    sticks = mixer.sticks(mixer.axes(forces[at], mixer.limits(GAIN)), GAIN)
                pilot.radio.sticks(sticks.x, sticks.y, sticks.z, sticks.r, sticks.s, sticks.t)
                step += 1
            if now - seen >= sitl.ASKED:
                seen = now
                pilot.radio.show_presence()
                pilot.radio.listen()
            late.append(pilot.packet.pwm)
            for channel, a in enumerate(motors.order):
                row[0, a] = commands[min(late[0][channel], LONGEST), a]
            simulator.step(row, duration)
            if 2.0 * float(np.sum(simulator.pose[0, 4:6] ** 2)) > 1.0:
                return {}
            pilot.exchange(sensors.read(duration), duration)
        pilot.radio.disarm()
        for _ in range(round(3.0 / duration)):  # until the log is on the disk
            simulator.step(0.0 * row, duration)
            pilot.exchange(sensors.read(duration), duration)
        shutil.copy(max((pilot.folder / "logs").glob("*.BIN")), file)
    finally:
        pilot.close()
    return truth


def fitted(file: Path, truth: dict[str, float], factor: float | None) -> tuple[list[Case], list[float]]:
    """Return the cases of a log, as `auvbench identify` fits it, and the relative errors of what is identified.

    Args:
        file: log.
        truth: true numbers.
        factor: on the standard deviations; None: that of `auvbench identify`.
    """
    vehicle = sheet.load(VEHICLE)
    logs = dataflash.read(file)
    if factor is not None:
        logs = [
            log if log.lasting is None else replace(log, lasting=replace(log.lasting, factor=factor))
            for log in logs
        ]
    chosen = parameters.choose(vehicle, (), False)
    kept = gate.reasons(gate.judge(logs, vehicle), [parameter.name for parameter in chosen])
    cases, errors = [], []
    for estimate in fit(logs, vehicle, chosen, kept=kept).estimates:
        true = truth[estimate.parameter.name]
        bias = 2.0 * (estimate.value - true) / (estimate.high - estimate.low)
        cases.append(
            Case(estimate.parameter.name, not estimate.kept, estimate.low <= true <= estimate.high, bias)
        )
        if not estimate.kept and true:
            errors.append(abs(estimate.value / true - 1.0))
    return cases, errors


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.identification_ardusub", description=__doc__)
    parser.add_argument("numbers", nargs="+", type=int, metavar="NUMBER", help="number of a dive")
    parser.add_argument("--folder", type=Path, help="folder for the logs")
    parser.add_argument(
        "--factor", type=float, help="factor on standard deviations (default: that of auvbench identify)"
    )
    options = parser.parse_args()
    cases: list[Case] = []
    errors: list[float] = []
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.folder or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        for number in options.numbers:
            file, about = folder / f"{number}.BIN", folder / f"{number}.json"
            if not about.exists():
                about.write_text(json.dumps(fly(number, file)))
            if not (truth := json.loads(about.read_text())):
                print(f"dive {number}: the vehicle turned over", flush=True)
                continue
            found, off = fitted(file, truth, options.factor)
            print(f"dive {number}: {_counted([case for case in found if case.identified])}", flush=True)
            cases += found
            errors += off
    identified = [case for case in cases if case.identified]
    covered = sum(case.covered for case in identified)
    low, high = wilson(covered, len(identified))
    print(f"identified: {_counted(identified)}; 95 % interval {float(low):.3f} to {float(high):.3f}")
    print(f"not identified: {_counted([case for case in cases if not case.identified])}")
    print(f"identified numbers are {100.0 * float(np.median(errors)):.1f} % off (median)")
    return 0


def _counted(cases: list[Case]) -> str:
    """Return how many intervals contain the truth, and which do not, with their error over half of the interval's width."""
    missed = ", ".join(f"{case.name} ({case.bias:+.1f})" for case in cases if not case.covered)
    return f"{sum(case.covered for case in cases)} of {len(cases)} covered; missed: {missed or 'none'}"


if __name__ == "__main__":
    sys.exit(main())
