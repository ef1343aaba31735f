"""Recommend the manoeuvre whose log would reduce the uncertainty of a vehicle's parameters most."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from auvbench.identification import manoeuvres
from auvbench.identification.fit import Fit, information
from auvbench.identification.inputs import has_voltage
from auvbench.identification.log import LogError
from auvbench.identification.parameters import with_values
from auvbench.vehicles import signals
from auvbench.vehicles.inspect import AXES

FloatArray = NDArray[np.float64]

SECONDS = 30.0
"""Duration in s of a candidate manoeuvre; the recommended manoeuvre is twice as long."""
AMPLITUDES = (0.15, 0.3)
"""Amplitudes of candidates, as fractions of the largest force along the axis."""


@dataclass(frozen=True, slots=True)
class Advice:
    """A manoeuvre and its expected gain of information."""

    axis: str
    amplitude: float
    gain: float
    """Expected decrease of the mean logarithm of the parameters' standard deviations."""

    @property
    def text(self) -> str:
        """Return the recommendation as a sentence."""
        return (
            f"Apply a telegraph signal in {self.axis} for a minute without a controller: the thrusters push back and forth with"
            f" {100 * self.amplitude:.0f} % and {40 * self.amplitude:.0f} % of their largest force along this axis, and"
            f" each level lasts {signals.SHORT:g} to {signals.LONG:g} s"
            f" (auvbench pilot excite --axis {self.axis} --amplitude {self.amplitude:g})."
        )


def advise(result: Fit) -> list[Advice]:
    """Return candidate manoeuvres, the most informative first: telegraph signals along each axis on which the thrusters can push.

    Each candidate is simulated with the fitted vehicle, and with the sensors and the lasting errors of the logs. The candidate's Fisher
    information is doubled, because the recommended manoeuvre is twice as long, and added to the inverse of the fit's covariance. A
    vehicle without thrusters, or with actuators other than thrusters, has no candidates.
    """
    vehicle = with_values(result.vehicle, result.numbers)
    if not vehicle.thrusters or vehicle.others:
        return []
    noise = {name: max(spread, manoeuvres.NOISE[name]) for name, spread in result.sigma.items()}
    present = np.linalg.inv(result.covariance)
    before = float(np.linalg.slogdet(present)[1])
    parameters = tuple(
        estimate.parameter
        for estimate in result.estimates
        if estimate.parameter.name != "voltage" or has_voltage(vehicle)
    )
    lasting = next((log.lasting for log in result.logs if log.lasting is not None), None)
    widened = 1.0 if lasting is None else lasting.factor**2
    found = []
    for axis in (name for name in AXES if name in vehicle.controllable):
        for amplitude in AMPLITUDES:
            generator = np.random.default_rng(0)
            command = signals.telegraph(vehicle, [axis], SECONDS, amplitude, generator)
            try:
                log = manoeuvres.fly(vehicle, command, generator, noise=noise, every=5, name=axis)
            except LogError:  # The simulated vehicle turned over, or was impossibly fast.
                continue
            log = replace(log, lasting=lasting)
            added = information([log], result.vehicle, parameters, result.x, noise) / widened
            after = float(np.linalg.slogdet(present + 2.0 * added)[1])
            found.append(Advice(axis, amplitude, 0.5 * (after - before) / len(parameters)))
    return sorted(found, key=lambda advice: -advice.gain)
