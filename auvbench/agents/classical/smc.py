"""Control by adaptive integral sliding modes of velocity and heading.

After X. Wang, Z. Sha and F. Zhang, "Adaptive integral sliding mode control for attitude tracking of
underwater robots with large range pitch variations in confined space", arXiv:2405.00269 (2024). Their law controls
the attitude of an ROV; here it controls velocity and heading. It has an integral sliding surface, the model's
wrench as equivalent control, and a switching gain that grows while the state is off the surface. A saturation
within a boundary layer replaces the sign function (Slotine and Li 1991, section 7.2). The gain decays inside
the layer, so that noise does not raise it permanently.

    s = e + lambda * integral of e,   tau = M (lambda e + k sat(s / phi)) + D(v) v,   k' = gamma (|s| - phi) , k >= k_0

Guidance, allocation and limits are in `cascade.py`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from auvbench.agents.base import Integers
from auvbench.agents.classical.cascade import YAW, Cascade
from auvbench.config import schema
from auvbench.config.algorithms.smc import SMC
from auvbench.vehicles.vehicle_model import VehicleModel

Floats = NDArray[np.float64]


class SMCController(Cascade):
    """Adaptive integral sliding-mode controller."""

    carried = ("integral", "switching")

    def __init__(self, config: schema.TrainConfig, vehicle: VehicleModel) -> None:
        gains = config.algo
        assert isinstance(gains, SMC)
        self.gains = gains
        super().__init__(config, vehicle)

    def reset(self, episodes: Integers) -> None:
        super().reset(episodes)
        n = len(episodes)
        self.integral: Floats = np.zeros((n, 4))
        self.switching: Floats = np.full((n, 4), self.gains.switching_gain)
        self._errors: Floats = np.zeros((n, 4))

    def law(self, wanted: Floats, velocity: Floats) -> Floats:
        g, now = self.gains, self.estimate
        # The heading error becomes a commanded yaw rate, so the fourth error is an error of the yaw rate.
        turn = g.heading_bandwidth * now.yaw_error + now.turning - now.yaw_rate
        self._errors = np.column_stack([wanted - velocity, turn])
        surface = self._errors + g.surface * self.integral
        push = g.surface * self._errors + self.switching * np.clip(surface / g.boundary_layer, -1.0, 1.0)
        self._off = np.abs(surface) - g.boundary_layer
        wrench = np.zeros((len(wanted), 6))
        wrench[:, :3] = self.mass[:3] * push[:, :3] + self._drag(wanted)
        # yaw acceleration per error of the yaw rate within the boundary layer, 1/s
        slope = g.surface + g.switching_gain / g.boundary_layer
        wrench[:, YAW] = self.turning_mass(slope) * push[:, 3]
        return wrench

    def after(self, miss: Floats, scale: Floats) -> None:
        g, still = self.gains, (scale >= 1.0)[:, None]
        # No wind-up while the thrusters are saturated.
        self.integral += np.where(still, self.dt * self._errors, 0.0)
        grown = np.clip(self.switching + self.dt * g.adaptation * self._off, g.switching_gain, g.largest_gain)
        self.switching = np.where(still, grown, self.switching)
