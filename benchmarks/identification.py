"""Measure how often 95 % intervals of `auvbench identify` contain the truth, on simulated logs of drawn vehicles.

`python -m benchmarks.identification` runs the declared study: `LOGS` logs of `SECONDS` s, each of a vehicle that is drawn from the
prior, with sensor noise, and `REPLICATES` bootstrap fits for each. `--logs 10` runs the first ten, `--first 10` starts at number
10; a log is a function of its number. Declared before the first run: the intervals of the identified numbers contain the truth in
90 to 98 % of the cases, pooled, and none less often than in 85 %; a number that is not identified stays within its prior.
"""

from __future__ import annotations

import argparse
import sys
from collections import defaultdict
from dataclasses import dataclass

import numpy as np

from auvbench.identification import manoeuvres, parameters
from auvbench.identification.fit import fit
from auvbench.identification.log import LogError
from auvbench.vehicles import sheet, signals

LOGS, SECONDS, REPLICATES = 100, 120.0, 200
VEHICLE = "bluerov2_2026"
AXES = ("surge", "sway", "heave", "yaw")
AMPLITUDE = 0.12
"""Share of the largest force; more turns some of the drawn vehicles over."""
LARGEST = 1.5
"""Largest draw, in prior standard deviations."""
POOLED, EACH = (0.90, 0.98), 0.85


@dataclass(frozen=True, slots=True)
class Case:
    """One number of one log."""

    name: str
    identified: bool
    covered: bool
    bias: float
    """Error over half of the interval's width, in normalised units."""


def study(number: int, replicates: int = REPLICATES, seconds: float = SECONDS) -> list[Case]:
    """Return the cases of one log; none if the drawn vehicle turns over.

    Args:
        number: number of the log.
        replicates: bootstrap fits.
        seconds: duration of the log.
    """
    generator = np.random.default_rng([2026, number])
    vehicle = sheet.load(VEHICLE)
    chosen = parameters.choose(vehicle, (), False)
    x = np.clip(generator.standard_normal(len(chosen)), -LARGEST, LARGEST)
    truth = parameters.values_of(chosen, x)
    truth["delay"] = signals.INTERVAL * round(abs(truth["delay"]) / signals.INTERVAL)
    command = signals.telegraph(vehicle, AXES, seconds, AMPLITUDE, generator)
    try:
        log = manoeuvres.fly(
            parameters.with_values(vehicle, truth),
            command,
            generator,
            delay=truth["delay"],
            name=f"log {number}",
        )
    except LogError:
        return []
    result = fit([log], vehicle, chosen, replicates=replicates, seed=number)
    cases = []
    for estimate in result.estimates:
        name, true = estimate.parameter.name, truth[estimate.parameter.name]
        width = 0.5 * (estimate.high - estimate.low)
        cases.append(
            Case(
                name,
                not estimate.kept,
                estimate.low <= true <= estimate.high,
                (estimate.value - true) / width,
            )
        )
    return cases


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.identification", description=__doc__)
    parser.add_argument("--logs", type=int, default=LOGS, help="number of logs")
    parser.add_argument("--first", type=int, default=0, help="number of the first log")
    parser.add_argument("--replicates", type=int, default=REPLICATES, help="bootstrap fits for each log")
    options = parser.parse_args()
    cases: list[Case] = []
    used = 0
    for number in range(options.first, options.first + options.logs):
        found = study(number, options.replicates)
        used += bool(found)
        cases += found
        good = sum(case.covered for case in found if case.identified)
        print(
            f"log {number}: {good} of {sum(case.identified for case in found)} covered",
            file=sys.stderr,
            flush=True,
        )
    by_name: dict[str, list[Case]] = defaultdict(list)
    for case in cases:
        by_name[case.name].append(case)
    print(
        f"{used} of {options.logs} logs of {SECONDS:g} s (the other vehicles turned over), {options.replicates} replicates"
    )
    print("number                     identified   covered   mean bias over half the interval")
    rates = []
    for name, own in by_name.items():
        identified = [case for case in own if case.identified]
        if not identified:
            print(f"{name:26s} {0:10d}")
            continue
        rate = float(np.mean([case.covered for case in identified]))
        rates.append(rate)
        bias = float(np.mean([case.bias for case in identified]))
        print(f"{name:26s} {len(identified):10d}   {100 * rate:6.1f}%   {bias:+.2f}")
    pooled = float(np.mean([case.covered for case in cases if case.identified]))
    kept = [case for case in cases if not case.identified]
    print(
        f"pooled coverage {100 * pooled:.1f} % (declared: 90 to 98), least {100 * min(rates):.0f} % (declared: 85)"
    )
    if kept:
        rate = float(np.mean([case.covered for case in kept]))
        print(
            f"{len(kept)} numbers were not identified; their intervals contain the truth in {100 * rate:.1f} %"
        )
    return 0 if POOLED[0] <= pooled <= POOLED[1] and min(rates) >= EACH else 1


if __name__ == "__main__":
    sys.exit(main())
