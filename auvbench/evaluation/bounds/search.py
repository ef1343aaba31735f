"""The search for the fewest steps in which a vehicle gets from where it is into the goal."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from auvbench.config import schema
from auvbench.errors import TrainingError
from auvbench.evaluation.bounds.command_replay import Commands, Scenario, Trial, actions, kept
from auvbench.evaluation.bounds.files import Found
from auvbench.evaluation.bounds.transcription import INTERVALS, Plan, Programs
from auvbench.vehicles.symbolic import symbolic

Floats = NDArray[np.float64]

ATTEMPTS = 5
"""numbers of steps tried for one plan"""
SPEED = 1.0
"""m/s along a straight line; only the order of magnitude matters"""
LEAST_GAIN = 0.7
"""share of the way of the last step: with less than this to spare, no step can be saved"""
COARSE = 2
"""steps for which the first search holds a thrust; the second one may change it at each step"""
VERSION = 3
"""of the search; a journal of another version is deleted"""


class Search:
    """The search for one vehicle under one condition.

    Args:
        config: of the condition (vehicle, task, frequency).

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

    def first(self, scenario: Scenario, starts: Mapping[str, Commands], known: Found | None = None) -> Found:
        """Search from commands (T, n_u) of controllers, holding each thrust for `COARSE` steps.

        A straight line is the start where that finds nothing better than the commands themselves.

        Args:
            scenario: start and waypoint.
            starts: by controller; those that do not arrive are left out.
            known: an earlier result: the new one is no worse.

        Raises:
            TrainingError: the simulation left the finite numbers.
        """
        arrived = [found for name in starts if (found := self.replay(scenario, starts[name], name))]
        best = min([*([] if known is None else [known]), *arrived], key=lambda f: f.steps, default=None)
        if best is not None:
            plans = [(found.start, self.plan_of(scenario, found.commands)) for found in arrived]
            found = self._improve(scenario, best, plans, COARSE)
            if found.steps < best.steps:
                return found
        return self._improve(scenario, best, [("straight", self._straight(scenario.target))], COARSE)

    def replay(self, scenario: Scenario, commands: Commands, start: str) -> Found | None:
        """Return commands (T, n_u) as a result; None where they do not arrive."""
        outcome = self.trial.run(scenario, commands)
        return Found(commands[: outcome.steps], start) if outcome.arrived else None

    def again(self, scenario: Scenario, known: Found, others: Sequence[tuple[Scenario, Commands]]) -> Found:
        """Search from an earlier result, from those of other scenarios, and from a straight line."""
        plans = [
            ("itself", self.plan_of(scenario, known.commands)),
            ("straight", self._straight(scenario.target)),
        ]
        plans += [(f"neighbour {place}", self.plan_of(*other)) for place, other in enumerate(others, start=1)]
        return self._improve(scenario, known, plans, 1)

    def plan_of(self, scenario: Scenario, commands: Commands) -> Plan:
        """Return what commands (T, n_u) do in a scenario, seen from its start."""
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

    def _straight(self, waypoint: Floats) -> Plan:
        """Return a straight line to the edge of the goal around a waypoint (3,) without turn and thrust."""
        programs = self.programs
        line = waypoint - programs.start[:3]
        distance = float(np.linalg.norm(line))
        way = line * (max(distance - self.radius, 0.1) / max(distance, 1e-9))
        T = 1.0 + float(np.linalg.norm(way)) / SPEED
        X = np.repeat(programs.start[:, None], INTERVALS + 1, axis=1)
        X[:3] += way[:, None] * np.linspace(0.0, 1.0, INTERVALS + 1)
        X[7:10, 1:] = (way / T)[:, None]
        return Plan(X, np.repeat(programs.coasting[:, None], INTERVALS, axis=1), T)

    def _improve(
        self, scenario: Scenario, known: Found | None, guesses: Iterable[tuple[str, Plan]], hold: int
    ) -> Found:
        """Return the best that grows from guesses: the quickest plan of the coarse grid is refined step by step."""
        plans = []
        for start, guess in guesses:
            plan, solved = self.programs.shortest(guess, scenario.target)
            if solved:
                plans.append((plan.T, start, plan))
        plans.sort(key=lambda entry: entry[0])  # stable: equally quick ones stay in their order
        if plans and (known is None or plans[0][0] * self.frequency <= known.steps + 1):
            _, start, plan = plans[0]
            found = self._refine(scenario, plan, start, known, hold)
            known = found if known is None or (found is not None and found.steps < known.steps) else known
        if known is None:
            place = np.round(scenario.waypoint, 2).tolist()
            raise TrainingError(
                f"no way to the waypoint at {place} was found, and no controller arrives there"
            )
        return known

    def _refine(
        self, scenario: Scenario, plan: Plan, start: str, known: Found | None, hold: int
    ) -> Found | None:
        """Return the fewest steps in which the neighbourhood of a plan reaches the goal in the simulator, if it does."""
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
                best = Found(commands[: outcome.steps], start)
                most = outcome.steps - 1
                spare = (self.radius - distance) / (LEAST_GAIN * pace)
                if spare < 1.0:
                    break
                steps = outcome.steps - int(spare)
            else:
                too_few = steps
                steps += max(1, int((distance - self.radius) / pace))
        return best
