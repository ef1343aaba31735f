"""Control by active disturbance rejection (ADRC): an observer estimates the acceleration that the model does not
explain, and the controller cancels this acceleration.

After Z. Gao, "Scaling and bandwidth-parameterization based controller tuning", American Control Conference 2003. In
surge, sway, heave and yaw the sheet gives

    v' = (tau - D(v) v) / m + f,   D(v) = D_linear + D_quadratic |v|

where f is the acceleration by everything else: current, waves, payload, wrong drag coefficients. An extended state
observer with bandwidth w_o estimates v and f, and the law is

    tau = m (w_c (v commanded - v estimated) - f estimated) + D(v commanded) v commanded

The observer is the discrete current estimator of R. Miklosovic, A. Radke and Z. Gao, "Discrete implementation and
generalization of the extended state observer", American Control Conference 2006, with both poles at exp(-w_o dt). It
receives the wrench after saturation, so it does not wind up. Guidance, allocation and limits are in `cascade.py`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from auvbench.agents.base import Integers
from auvbench.agents.classical.cascade import CONTROLLED, HEAVE, Cascade
from auvbench.config import schema
from auvbench.config.algorithms.adrc import ADRC
from auvbench.vehicles.vehicle_model import VehicleModel

Floats = NDArray[np.float64]


class ADRCController(Cascade):
    """Active disturbance rejection control of velocity and heading."""

    carried = ("velocity", "rest")

    def __init__(self, config: schema.TrainConfig, vehicle: VehicleModel) -> None:
        gains = config.algo
        assert isinstance(gains, ADRC)
        self.gains = gains
        super().__init__(config, vehicle)
        pole = math.exp(-gains.observer_bandwidth * self.dt)
        self.correction = (1.0 - pole**2, (1.0 - pole) ** 2 / self.dt)
        """gains of the observer: for the velocity (no unit), and for the disturbance (1/s)"""
        self.inertias = self.mass[CONTROLLED]

    def reset(self, episodes: Integers) -> None:
        super().reset(episodes)
        n = len(episodes)
        self.velocity: Floats = np.zeros((n, 4))
        """(n, 4) predicted velocity in surge, sway, heave and yaw, m/s and rad/s"""
        self.rest: Floats = np.zeros((n, 4))
        """(n, 4) estimated acceleration that the sheet does not explain, m/s2 and rad/s2"""
        self._wrench: Floats = np.zeros((n, 4))

    def law(self, wanted: Floats, velocity: Floats) -> Floats:
        g, now = self.gains, self.estimate
        surprise = np.column_stack([velocity, now.yaw_rate]) - self.velocity
        self.velocity = self.velocity + self.correction[0] * surprise
        self.rest = self.rest + self.correction[1] * surprise
        turn = g.heading_bandwidth * now.yaw_error + now.turning
        commanded = np.column_stack([wanted, turn])
        wrench = np.zeros((len(wanted), 6))
        push = self.inertias * (g.bandwidth * (commanded - self.velocity) - self.rest)
        wrench[:, CONTROLLED] = push + self._damping(commanded, CONTROLLED) * commanded
        self._wrench = wrench[:, CONTROLLED]
        return wrench

    def after(self, miss: Floats, scale: Floats) -> None:
        # `_wrench` excludes the force that balances weight and buoyancy, but saturation scales this force, too.
        carried = np.zeros(4)
        carried[HEAVE] = self.lift
        applied = (self._wrench - carried) * scale[:, None] + carried
        # The damping is integrated implicitly, because its time constant may be shorter than a step.
        gained = self.velocity + self.dt * (applied / self.inertias + self.rest)
        self.velocity = gained / (1.0 + self.dt * self._damping(self.velocity, CONTROLLED) / self.inertias)
