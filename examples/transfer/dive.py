"""Write the log of a simulated dive as `auvbench identify` reads it: a person pushes the vehicle to and fro along four axes.

    python dive.py bluerov2_viktornfa 1 dive.csv

The sensors are usual ones: position within 1 cm, attitude 0.005 rad, velocity 1 cm/s, rates 0.005 rad/s (standard deviations).
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas as pd

from auvbench.identification import manoeuvres
from auvbench.identification.log import CHANNELS
from auvbench.vehicles import sheet, signals

AXES = ("surge", "sway", "heave", "yaw")
SECONDS, AMPLITUDE = 120.0, 0.12
"""Duration, and share of the largest force along an axis."""
UNITS = {
    **dict.fromkeys(("x", "y", "z"), "m"),
    **dict.fromkeys(("roll", "pitch", "yaw"), "rad"),
    **dict.fromkeys(("u", "v", "w"), "mps"),
    **dict.fromkeys(("p", "q", "r"), "radps"),
}


def main(name: str, seed: int, path: Path) -> None:
    """Fly the vehicle `name` and write `path`; the manoeuvre and the noise are a function of `seed`."""
    generator = np.random.default_rng([2026, seed])
    vehicle = sheet.load(name)
    command = signals.telegraph(vehicle, AXES, SECONDS, AMPLITUDE, generator)
    log = manoeuvres.fly(vehicle, command, generator)
    columns = {"t_s": log.time}
    columns |= {f"{actuator}_cmd": log.inputs[:, k] for k, actuator in enumerate(log.actuators)}
    columns |= {f"{name}_{unit}": log.measured[:, CHANNELS.index(name)] for name, unit in UNITS.items()}
    pd.DataFrame(columns).to_csv(path, index=False, float_format="%.6g")


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), Path(sys.argv[3]))
