"""The search for the fewest steps in which a vehicle gets from where it is into the goal."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from auvbench.config import schema
from auvbench.errors import TrainingError
from auvbench.evaluation.bounds.guesses import straight
from auvbench.evaluation.bounds.transcription import Plan, Programs
from auvbench.evaluation.bounds.trial import Commands, Scenario, Trial, actions, kept
from auvbench.vehicles.symbolic import symbolic

Floats = NDArray[np.float64]

ATTEMPTS = 5
"""numbers of steps that are tried for one plan"""
REFINED = 1
"""plans that are refined, of those that the coarse grid finds: more gained nothing in 20 scenarios"""
LEAST_GAIN = 0.7
"""of a step, as a share of the way that the last one went: where less than this is left over, no step is to be saved"""
COARSE = 2
"""steps for which the first search holds a thrust; the second may change it at each"""
VERSION = 2
"""of the search: what an earlier one left half done is begun anew"""


@dataclass(frozen=True, slots=True)
class Found:
    """The fewest steps found so far, and the commands that take the vehicle into the goal in them."""

    steps: int
    commands: Commands
    """(steps, n_u), tried out in the simulator"""
    start: str
    """what the search began from"""
    solved: int = 0
    """programmes that IPOPT solved"""
    failed: int = 0
    """programmes that it did not"""


class Search:
    """Of one vehicle in one condition.

    Args:
        config: of the condition: vehicle, task and frequency.

    Raises:
        ConfigError: the symbolic equations do not cover the vehicle.
        MissingExtraError: CasADi is not installed.
    """

    def __init__(self, config: schema.TrainConfig) -> None:
        self.trial = Trial(config)
        self.vehicle = self.trial.vehicle
        self.frequency = config.step.frequency
        task = config.task
        self.radius = task.goal_radius
        self.programs = Programs(
            symbolic(self.vehicle, by_thrust=True),
            (task.depth_low, task.depth_high),
            task.start[2],
            task.goal_radius,
        )

    def first(self, scenario: Scenario, driven: Commands) -> Found:
        """From commands (T, n_u) that somebody drove there with; thrusts are held for `COARSE` steps.

        From the straight way where that finds nothing better than they do.

        Raises:
            TrainingError: the simulation left the finite numbers.
        """
        known = self._driven(scenario, driven)
        found = None
        if known is not None:
            found = self._improve(scenario, known, [("pid", self.plan_of(scenario, driven))], COARSE)
            if found.steps < known.steps:
                return found
        # Nobody drove there, or the way that was driven leads to no better one.
        way = ("straight", straight(self.programs, scenario.target))
        other = self._improve(scenario, known, [way], COARSE)
        return (
            other
            if found is None
            else replace(other, solved=other.solved + found.solved, failed=other.failed + found.failed)
        )

    def again(self, scenario: Scenario, known: Found, others: Sequence[tuple[Scenario, Commands]]) -> Found:
        """From what was found for it and for other scenarios, and from the straight way."""
        plans = [(f"neighbour {place}", self.plan_of(*other)) for place, other in enumerate(others, start=1)]
        own = ("itself", self.plan_of(scenario, known.commands))
        way = ("straight", straight(self.programs, scenario.target))
        return self._improve(scenario, known, [own, way, *plans], 1)

    def plan_of(self, scenario: Scenario, commands: Commands) -> Plan:
        """What commands (T, n_u) do in a scenario, seen from its start."""
        outcome = self.trial.run(scenario, commands)
        n = len(outcome.pose) - 1
        X = np.zeros((self.programs.model.n_x, n + 1))
        c, s = np.cos(scenario.yaw), np.sin(scenario.yaw)
        east, north = (outcome.pose[:, :2] - scenario.pose[:2]).T
        X[:3] = c * east + s * north, c * north - s * east, outcome.pose[:, 2]
        # The quaternion of a turn by -yaw about z, times the vehicle's.
        c, s = np.cos(0.5 * scenario.yaw), np.sin(0.5 * scenario.yaw)
        w, x, y, z = outcome.pose[:, 3:].T
        X[3:7] = c * w + s * z, c * x + s * y, c * y - s * x, c * z - s * w
        X[7:13] = outcome.velocity.T
        thrust = self.vehicle.force(actions(commands[:n])).T
        lagging = [j for j, unit in enumerate(self.vehicle.units) if unit.lag.order > 0]
        X[13:, 0] = self.programs.model.rest
        X[13:, 1:] = thrust[lagging]
        return Plan(X, self.programs.shares(thrust), n / self.frequency)

    def _driven(self, scenario: Scenario, commands: Commands) -> Found | None:
        outcome = self.trial.run(scenario, commands)
        return Found(outcome.steps, commands[: outcome.steps], "pid") if outcome.arrived else None

    def _improve(
        self, scenario: Scenario, known: Found | None, guesses: Iterable[tuple[str, Plan]], hold: int
    ) -> Found:
        """The best that grows from guesses: all are solved on the coarse grid, the quickest then step by step."""
        plans, failed = [], 0
        for start, guess in guesses:
            plan, solved = self.programs.shortest(guess, scenario.target)
            failed += not solved
            if solved:
                plans.append((plan.T, start, plan))
        plans.sort(key=lambda entry: entry[0])  # stable: equally quick ones stay in their order
        for _, start, plan in plans[:REFINED]:
            if known is not None and plan.T * self.frequency > known.steps + 1:
                break
            found = self._refine(scenario, plan, start, known, hold)
            known = found if known is None or (found is not None and found.steps < known.steps) else known
        if known is None:
            raise TrainingError(
                f"no way to the waypoint at {np.round(scenario.waypoint, 2).tolist()} was found, nor did PID get there"
            )
        return replace(known, solved=len(plans), failed=failed)

    def _refine(
        self, scenario: Scenario, plan: Plan, start: str, known: Found | None, hold: int
    ) -> Found | None:
        """The fewest steps in which a plan's neighbourhood reaches the goal in the simulator; None: none was found."""
        steps = max(1, math.ceil(plan.T * self.frequency))
        most = math.inf if known is None else known.steps - 1
        too_few, best = 0, None
        guess = plan
        for _ in range(ATTEMPTS):
            steps = int(min(max(steps, too_few + 1), most))
            if steps <= too_few or steps < 1:
                break
            guess, shares = self.programs.closest(guess, scenario.target, steps, 1.0 / self.frequency, hold)
            thrusts = self.programs.thrusts(shares).T
            commands = kept(self.vehicle.action(thrusts))
            outcome = self.trial.run(scenario, commands)
            # How many steps early or late it is, at the speed that it ends with.
            pace = max(float(np.linalg.norm(outcome.velocity[-1, :3])), 0.1) / self.frequency
            distance = float(np.linalg.norm(outcome.pose[-1, :3] - scenario.waypoint))
            if outcome.arrived:
                best = Found(outcome.steps, commands[: outcome.steps], start)
                most = outcome.steps - 1
                spare = (self.radius - distance) / (LEAST_GAIN * pace)
                if spare < 1.0:
                    break
                steps = outcome.steps - int(spare)
            else:
                too_few = steps
                steps += max(1, int((distance - self.radius) / pace))
        return best
