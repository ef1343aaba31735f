"""Search for the smallest number of steps in which a vehicle reaches the goal.

The search solves two nonlinear programmes with IPOPT. Both have the constraints

    x_(k+1) - x_k = h f((x_k + x_(k+1)) / 2, u_k),   u_min <= u_k <= u_max,   z_low <= z_k <= z_high

The first constraint is the implicit midpoint rule (Betts 2010, Practical Methods for Optimal Control, section
4), which keeps the norm of the quaternion (Hairer, Lubich and Wanner 2006, section II.1.3).

* The free programme (`Programs.shortest`) minimizes the duration T of N equal intervals.
* The fixed programme (`Programs.closest`) has a given number of agent steps, and holds each thrust for whole
  steps, as agents do. It minimizes the final distance to the goal.

The result is the smallest number of steps for which a plan of the fixed programme ends inside the goal in the
simulator.

All coordinates are in the frame of the vehicle's start: x along the heading at the start, z as in the world. Still
water is the same everywhere, so the horizontal position of the start has no effect.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.config import schema
from auvbench.errors import TrainingError
from auvbench.evaluation.bounds.command_replay import Outcome, Scenario, Trial
from auvbench.evaluation.bounds.files import Solution
from auvbench.evaluation.bounds.tracking import Tracker
from auvbench.vehicles.symbolic import SymbolicModel, require, symbolic

Floats = NDArray[np.float64]

ATTEMPTS = 5
"""largest number of step counts to try for one plan"""
SPEED = 1.0
"""Speed along the straight line from which a search may start, m/s; only the order of magnitude matters"""
LEAST_GAIN = 0.7
"""If a plan ends inside the goal, a shorter plan is tried only if the distance from the plan's end to the goal's edge is at
least this share of the distance per step
"""
HOLD = 2
"""number of steps for which a plan holds a thrust"""
VERSION = 4
"""version of the search; finished searches of an older version are not used"""
INTERVALS = 40
"""number of intervals of the free programme"""
SIZES = (24, 48, 72, 96, 128, 192, 256, 384)
"""numbers of intervals of the fixed programmes; shorter plans are padded, and longer plans hold thrusts for more steps"""
ROOM = 0.02
"""distance in m that a plan keeps from the depth limits and the goal's edge, as a reserve for motion between its
grid points
"""
ITERATIONS = 100
"""largest number of IPOPT iterations; unlike a time limit, it gives the same result on a busy machine"""
LONGEST = 1000.0
"""longest duration of a plan, s"""

_IPOPT: dict[str, Any] = {
    "print_level": 0,
    "sb": "yes",
    # By default IPOPT reads ipopt.opt in the working directory, which may name libraries to load.
    "option_file_name": "",
    "linear_solver": "mumps",
    # These values make MUMPS a fifth faster than its defaults.
    "mumps_pivot_order": 0,
    "mumps_scaling": 0,
    "mumps_permuting_scaling": 0,
    # A low accuracy suffices, because the solution is simulated afterwards.
    "tol": 1e-3,
    "acceptable_tol": 1e-2,
    "acceptable_iter": 4,
    "max_iter": ITERATIONS,
}


@dataclass(frozen=True, slots=True)
class Plan:
    """A trajectory on a grid of N intervals."""

    X: Floats
    """States (n_x, N + 1) at the nodes, in the frame of the start"""
    U: Floats
    """Thrusts (n_u, N) in the intervals, as shares from -1 to 1 of their ranges"""
    T: float
    """Duration, s"""

    def on(self, n: int, duration: float | None = None) -> Plan:
        """Return the plan on a grid of n equal intervals, with the duration `duration` in s if given."""
        N = self.U.shape[1]
        at = np.linspace(0.0, N, n + 1)
        X = _interpolated(self.X, np.arange(N + 1), at)
        middle = np.minimum((0.5 * (at[1:] + at[:-1])).astype(int), N - 1)
        return Plan(X, self.U[:, middle], self.T if duration is None else duration)


def _interpolated(X: Floats, nodes: NDArray[Any], at: NDArray[Any]) -> Floats:
    """Interpolate states (n_x, nodes) at the places `at` between the nodes, and normalise the quaternions."""
    states = np.array([np.interp(at, nodes, row) for row in X])
    states[3:7] /= np.linalg.norm(states[3:7], axis=0)
    return states


class Programs:
    """Nonlinear programmes of one vehicle, built when first needed."""

    def __init__(
        self, model: SymbolicModel, depth: tuple[float, float], start_depth: float, radius: float
    ) -> None:
        self.model = model
        self.radius = radius
        low, high = model.input_limits.T
        self.middle, self.half = 0.5 * (high + low), 0.5 * (high - low)
        self.start = np.concatenate([[0.0, 0.0, start_depth, 1.0], np.zeros(9), model.rest])
        self.depth = (min(depth[0] + ROOM, start_depth), max(depth[1] - ROOM, start_depth))
        self._free: Any = None
        self._fixed: dict[int, Any] = {}

    @property
    def coasting(self) -> Floats:
        """Return the shares (n_u,) that give zero thrust."""
        return np.asarray(np.clip(-self.middle / self.half, -1.0, 1.0))

    def thrusts(self, U: Floats) -> Floats:
        """Return thrusts (n_u, N) in N from shares."""
        return np.asarray(self.middle[:, None] + self.half[:, None] * U)

    def shares(self, thrust: Floats) -> Floats:
        """Return shares (n_u, N) from thrusts in N."""
        return np.asarray(np.clip((thrust - self.middle[:, None]) / self.half[:, None], -1.0, 1.0))

    def shortest(self, guess: Plan, waypoint: Floats) -> tuple[Plan, bool]:
        """Return the quickest plan to a waypoint (3,), and whether IPOPT reports success; the search starts from `guess`."""
        if self._free is None:
            self._free = self._build(INTERVALS, free=True)
        guess = guess.on(INTERVALS)
        low, high = self._bounds(INTERVALS)
        n = self.model.n_x * INTERVALS
        solution = self._free(
            x0=np.concatenate([guess.X.T.ravel(), guess.U.T.ravel(), [guess.T]]),
            p=waypoint,
            lbx=np.append(low, 0.01),
            ubx=np.append(high, LONGEST),
            lbg=np.zeros(n + 1),
            ubg=np.append(np.zeros(n), max(self.radius - ROOM, 0.5 * self.radius) ** 2),
        )
        w = solution["x"].full()[:, 0]
        return self._plan(w[:-1], INTERVALS, w[-1]), bool(self._free.stats()["success"])

    def closest(self, guess: Plan, waypoint: Floats, steps: int, duration: float) -> tuple[Plan, Floats]:
        """Return the plan that ends closest to a waypoint (3,) after `steps` steps of `duration` s.

        The plan holds each thrust for `HOLD` steps, or for more steps if the largest of `SIZES` is too small.

        Returns:
            Plan with one interval for each held thrust, and the shares (n_u, steps) of the thrusts in each step.
        """
        hold = max(HOLD, -(-steps // SIZES[-1]))
        n = -(-steps // hold)
        size = next(size for size in SIZES if size >= n)
        if size not in self._fixed:
            self._fixed[size] = self._build(size, free=False)
        lengths = np.zeros(size)
        lengths[:n] = hold * duration
        lengths[n - 1] -= (n * hold - steps) * duration
        fitted = guess.on(n)
        X = np.concatenate([fitted.X, np.repeat(fitted.X[:, -1:], size - n, axis=1)], axis=1)
        U = np.concatenate([fitted.U, np.repeat(self.coasting[:, None], size - n, axis=1)], axis=1)
        low, high = self._bounds(size)
        zeros = np.zeros(self.model.n_x * size)
        solution = self._fixed[size](
            x0=np.concatenate([X.T.ravel(), U.T.ravel()]),
            p=np.concatenate([waypoint, lengths]),
            lbx=low,
            ubx=high,
            lbg=zeros,
            ubg=zeros,
        )
        plan = self._plan(solution["x"].full()[:, 0], size, steps * duration)
        found_plan = Plan(np.asarray(plan.X[:, : n + 1]), np.asarray(plan.U[:, :n]), steps * duration)
        return found_plan, np.repeat(found_plan.U, hold, axis=1)[:, :steps]

    def _plan(self, w: Floats, n: int, duration: float) -> Plan:
        split = self.model.n_x * (n + 1)
        X = w[:split].reshape(n + 1, self.model.n_x).T
        return Plan(X, np.clip(w[split:].reshape(n, self.model.n_u).T, -1.0, 1.0), float(duration))

    def _bounds(self, n: int) -> tuple[Floats, Floats]:
        X = np.full((n + 1, self.model.n_x), np.inf)
        low, high = -X, X.copy()
        low[:, 2], high[:, 2] = self.depth
        low[0] = high[0] = self.start
        U = np.ones(self.model.n_u * n)
        return np.concatenate([low.ravel(), -U]), np.concatenate([high.ravel(), U])

    def _build(self, n: int, *, free: bool) -> Any:
        ca = require()
        model = self.model
        X, U = ca.SX.sym("X", model.n_x, n + 1), ca.SX.sym("U", model.n_u, n)
        waypoint, T, lengths = ca.SX.sym("w", 3), ca.SX.sym("T"), ca.SX.sym("h", n)
        still = ca.DM.zeros(3)
        gaps = []
        for k in range(n):
            thrust = ca.DM(self.middle) + ca.DM(self.half) * U[:, k]
            rate = model.derivative(0.5 * (X[:, k] + X[:, k + 1]), thrust, still)
            gaps.append(X[:, k + 1] - X[:, k] - (T / n if free else lengths[k]) * rate)
        away = ca.sumsqr(X[:3, n] - waypoint)
        # This cost is tiny, so that it only decides between plans of equal duration or equal distance to the goal.
        effort = 1e-3 * ca.sumsqr(U) / n
        states = ca.vertcat(ca.vec(X), ca.vec(U))
        if free:
            ipopt = {**_IPOPT, "mu_strategy": "adaptive"}
            program = {
                "x": ca.vertcat(states, T),
                "f": T + effort,
                "g": ca.vertcat(*gaps, away),
                "p": waypoint,
            }
        else:
            # Start the barrier with small values, because the guess is nearly optimal.
            ipopt = {**_IPOPT, "mu_init": 1e-3, "bound_push": 1e-4, "bound_frac": 1e-4}
            program = {
                "x": states,
                "f": away + 0.1 * effort,
                "g": ca.vertcat(*gaps),
                "p": ca.vertcat(waypoint, lengths),
            }
        options = {"print_time": False, "error_on_fail": False, "ipopt": ipopt}
        return ca.nlpsol("free" if free else f"fixed{n}", "ipopt", program, options)


class Search:
    """Search for one vehicle under one condition.

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
            symbolic(self.vehicle),
            (task.depth_low, task.depth_high),
            task.start[2],
            task.goal_radius,
        )
        self.tracker = Tracker(
            self.programs.model, self.programs.middle, self.programs.half, self.trial, 1.0 / self.frequency
        )

    def find(self, scenario: Scenario, starts: Mapping[str, Floats]) -> Solution:
        """Return the quickest solution of a search that starts from actions of controllers, or from a straight line.

        The straight line is used if the search from the controllers finds no solution quicker than the controllers.
        If the search from the straight line finds no quicker solution either, the quickest controller's solution is returned.

        Args:
            scenario: scenario of the search.
            starts: actions (T, n_u) by controller.

        Raises:
            TrainingError: the simulation produced numbers that are not finite, or no trajectory reaches the goal.
        """
        plans = [
            (name, plan) for name in starts if (plan := self.plan_of(scenario, starts[name])) is not None
        ]
        flown = [self._followed(scenario, plan, plan.U, name)[0] for name, plan in plans]
        best = min(filter(None, flown), key=lambda solution: solution.steps, default=None)
        for guesses in (plans, [("straight", self._straight(scenario.target))]):
            better = self._improve(scenario, best, guesses)
            if better is not None:
                return better
        if best is None:
            place = np.round(scenario.waypoint, 2).tolist()
            raise TrainingError(
                f"the search found no way to the waypoint at {place}, and no controller reaches it"
            )
        return best

    def plan_of(self, scenario: Scenario, flown: Floats) -> Plan | None:
        """Simulate the actions `flown` (T, n_u), and return the trajectory as a plan; None if it does not reach the goal."""
        outcome = self.trial.fly(scenario, len(flown), lambda step, pose, velocity: flown[step])
        if not outcome.arrived:
            return None
        n = outcome.steps
        X = np.zeros((self.programs.model.n_x, n + 1))
        X[:7] = scenario.relative(outcome.pose).T
        X[7:13] = outcome.velocity.T
        thrust = self.vehicle.force(flown[:n]).T
        lagging = [j for j, unit in enumerate(self.vehicle.units) if unit.lag.order > 0]
        X[13:, 0] = self.programs.model.rest
        X[13:, 1:] = thrust[lagging]
        return Plan(X, self.programs.shares(thrust), n / self.frequency)

    def _followed(
        self, scenario: Scenario, plan: Plan, shares: Floats, start: str
    ) -> tuple[Solution | None, Outcome]:
        """Follow a plan in the simulator; return the solution (None if the vehicle does not arrive) and the outcome.

        Args:
            scenario: scenario of the plan.
            plan: plan to follow.
            shares: (n_u, steps) shares of the planned thrusts in each step.
            start: name of the search's starting point.
        """
        steps = shares.shape[1]
        # Neighbouring nodes of a plan are `apart` steps apart; the last interval may have fewer steps.
        apart = -(-steps // plan.U.shape[1])
        nodes = np.minimum(apart * np.arange(plan.U.shape[1] + 1), steps)
        X = _interpolated(plan.X, nodes, np.arange(steps + 1))
        commands, outcome = self.tracker.fly(scenario, X, shares)
        return Solution(commands[: outcome.steps], start) if outcome.arrived else None, outcome

    def _straight(self, waypoint: Floats) -> Plan:
        """Return a plan along the straight line to the edge of the goal around a waypoint (3,), without turning or thrust."""
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
        self, scenario: Scenario, best: Solution | None, guesses: Iterable[tuple[str, Plan]]
    ) -> Solution | None:
        """Optimize from each guess and refine the quickest plan; return a solution quicker than `best`, or None."""
        plans = []
        for start, guess in guesses:
            plan, solved = self.programs.shortest(guess, scenario.target)
            if solved:
                plans.append((plan.T, start, plan))
        plans.sort(key=lambda entry: entry[0])  # stable: equally quick plans keep their order
        if not plans or (best is not None and plans[0][0] * self.frequency > best.steps + 1):
            return None
        _, start, plan = plans[0]
        return self._refine(scenario, plan, start, math.inf if best is None else best.steps - 1)

    def _refine(self, scenario: Scenario, plan: Plan, start: str, most: float) -> Solution | None:
        """Return the quickest solution near `plan`, with at most `most` steps; None if no tried plan reaches the goal in the simulator."""
        steps = max(1, math.ceil(plan.T * self.frequency))
        too_few, best = 0, None
        guess = plan
        for _ in range(ATTEMPTS):
            steps = int(min(max(steps, too_few + 1), most))
            if steps <= too_few or steps < 1:
                break
            guess, shares = self.programs.closest(guess, scenario.target, steps, 1.0 / self.frequency)
            arrived, outcome = self._followed(scenario, guess, shares, start)
            # To convert a distance from the goal's edge into steps, divide it by the distance per step at the final speed.
            pace = max(float(np.linalg.norm(outcome.velocity[-1, :3])), 0.1) / self.frequency
            distance = float(np.linalg.norm(outcome.pose[-1, :3] - scenario.waypoint))
            if arrived is not None:
                best = arrived
                most = outcome.steps - 1
                spare = (self.radius - distance) / (LEAST_GAIN * pace)
                if spare < 1.0:
                    break
                steps = outcome.steps - int(spare)
            else:
                too_few = steps
                steps += max(1, int((distance - self.radius) / pace))
        return best
