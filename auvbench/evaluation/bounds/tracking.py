"""Follow a plan in the simulator with feedback, so that the errors of the plan do not grow.

Without control, the Munk moment turns a fast vehicle away from its direction of motion. The commands of a plan
without feedback therefore lead metres away from the plan within ten seconds. The regulator is a time-varying
LQR (Anderson and Moore 1990, Optimal Control: Linear Quadratic Methods, section 2.4): the motion is linearised
along the plan, and the gains follow from the discrete Riccati equation, backwards from the plan's end.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from auvbench.evaluation.bounds.command_replay import Outcome, Scenario, Trial, actions, stored
from auvbench.evaluation.bounds.files import Commands
from auvbench.vehicles.symbolic import SymbolicModel, require

Floats = NDArray[np.float64]

WEIGHTS = (1.0,) * 3 + (4.0,) * 4 + (0.5,) * 6
"""weights of errors in position (m), quaternion and velocity (m/s, rad/s)"""
EFFORT = 0.05
"""weight of the thrust's deviation from the planned thrust; the deviation is divided by half the thrust's range"""
STEP = 0.01
"""largest integration step of the equations of motion in the linearisation, s"""


class Tracker:
    """Regulator along plans of one vehicle; it assumes that the states of lagging actuators are as planned."""

    def __init__(
        self, model: SymbolicModel, middle: Floats, half: Floats, trial: Trial, duration: float
    ) -> None:
        """Prepare the linearisation of steps of `duration` s.

        Thrusts (n_u,) in N are `middle` plus shares times `half`.
        """
        ca = require()
        self.model, self.trial = model, trial
        self.middle, self.half = middle, half
        x, share = ca.SX.sym("x", model.n_x), ca.SX.sym("share", model.n_u)
        step = model.step(duration, math.ceil(duration / STEP))
        end = step(x, ca.DM(middle) + ca.DM(half) * share, ca.DM.zeros(3))
        self._linear = ca.Function("linear", [x, share], [ca.jacobian(end, x), ca.jacobian(end, share)])
        self._weight = np.diag([*WEIGHTS, *np.zeros(model.n_x - len(WEIGHTS))])

    def fly(self, scenario: Scenario, X: Floats, shares: Floats) -> tuple[Commands, Outcome]:
        """Follow planned states X (n_x, steps + 1) with planned shares (n_u, steps) of thrusts.

        Returns:
            Commands (T, n_u) and their outcome.
        """
        gains = self._gains(X, shares)
        flown: list[Commands] = []

        def action(step: int, pose: Floats, velocity: Floats) -> Floats:
            planned = X[:, step]
            state = np.concatenate([scenario.relative(pose), velocity, planned[13:]])
            if state[3:7] @ planned[3:7] < 0.0:
                state[3:7] *= -1.0  # the opposite quaternion is the same attitude
            share = np.clip(shares[:, step] - gains[step] @ (state - planned), -1.0, 1.0)
            flown.append(stored(self.trial.vehicle.action((self.middle + self.half * share)[None])[0]))
            return actions(flown[-1])

        outcome = self.trial.fly(scenario, shares.shape[1], action)
        return np.array(flown), outcome

    def _gains(self, X: Floats, shares: Floats) -> list[Floats]:
        effort = EFFORT * np.eye(self.model.n_u)
        gains = []
        P = self._weight
        for k in reversed(range(shares.shape[1])):
            A, B = (np.asarray(matrix) for matrix in self._linear(X[:, k], shares[:, k]))
            gain = np.linalg.solve(effort + B.T @ P @ B, B.T @ P @ A)
            gains.append(gain)
            P = self._weight + A.T @ P @ (A - B @ gain)
            P = 0.5 * (P + P.T)
        return gains[::-1]
