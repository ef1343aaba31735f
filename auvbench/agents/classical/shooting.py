"""Solve the optimal control problem of `mpc.py` by multiple shooting: plans, their linearisation, and the
quadratic programme.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from auvbench.agents.classical.avoiding import Avoidance
from auvbench.agents.classical.cascade import wrap
from auvbench.config.algorithms.mpc import MPC
from auvbench.vehicles.symbolic import RIGID, Direct, SymbolicModel, require

Floats = NDArray[np.float64]

# Numbers of horizon nodes that share one thrust: short blocks first.
BLOCKS = (1, 1, 1, 1, 2, 2, 4, 4)
# Cost per m beyond the depth limits.
DEPTH_PRICE = 1e3
# Longest substep of the prediction, s; the integration is of second order.
LONGEST_SUBSTEP = 0.125
# Largest gap between the nodes of a plan and the states that its thrusts lead to (m, m/s, rad/s); beyond it
# the linearisation is not valid, and the plan is simulated again.
LARGEST_GAP = 2.0
# Weight of the squared yaw error in m2/rad2, if the task prescribes a yaw.
YAW_WEIGHT = 1.0
# Weight of the squared sine of the tilt in m2 (the cost of roll and pitch), if the task prescribes a yaw.
TILT_WEIGHT = 5.0


class Plan:
    """Plan of one vehicle: states X (n_x, N + 1) at the nodes, and thrusts U (n_u, N) in newtons between the nodes."""

    def __init__(self, X: Floats, U: Floats) -> None:
        self.X = X
        self.U = U
        self.depth: Floats = np.array([-np.inf, np.inf])
        """allowed range of z, in m above the waypoint"""
        self.applied: Floats = np.zeros(U.shape[0])
        """(n_u,) thrust in N that acts while the plan is computed"""
        self.reference: Floats = np.zeros((U.shape[1], 3))
        """(N, 3) future positions of the reference at the nodes, m"""
        self.yaw: float | None = None
        """desired yaw in rad; None if the task prescribes no yaw"""
        self.solids: Floats | None = None
        """(k, size) solids near the vehicle, see `Avoidance.solids`; None or (0, size): open water"""

    def advance(self, share: float) -> None:
        """Advance the plan in time by a share of an interval."""
        self.applied[:] = self.U[:, 0]
        share = min(share, 1.0)
        self.X[:, :-1] += share * (self.X[:, 1:] - self.X[:, :-1])
        self.U[:, :-1] += share * (self.U[:, 1:] - self.U[:, :-1])


class Program:
    """Optimal control problem. Each call of `improve` linearises the problem about a plan and solves it once."""

    def __init__(self, model: SymbolicModel, algo: MPC, avoidance: Avoidance | None = None) -> None:
        ca = require()
        self.model = model
        self.avoidance = avoidance
        self.clearance, self.clearance_weight = algo.clearance, algo.clearance_weight
        self.N = sum(BLOCKS)
        self.interval = algo.horizon / self.N
        self.substeps = max(1, int(np.ceil(self.interval / LONGEST_SUBSTEP - 1e-9)))
        x, u, c = ca.SX.sym("x", model.n_x), ca.SX.sym("u", model.n_u), ca.SX.sym("c", 3)
        rate = model.derivative(x, u, c)
        slopes = ca.jacobian(rate, ca.vertcat(x, u))
        rates = ca.Function("rates", [x, u, c], [ca.densify(rate), ca.densify(slopes)], {"cse": True})
        self._rate = Direct(rates)
        self._rates = Direct(rates.map(self.N))
        self.limits = model.input_limits * algo.effort
        # The variables of the quadratic programme are thrusts, as shares of each thruster's range.
        self.scale = np.abs(self.limits).max(axis=1)
        self.position_weight = np.ones(self.N + 1)
        self.position_weight[-1] = np.sqrt(algo.terminal_weight)
        self.effort_weight = algo.effort_weight
        self.change_weight = algo.change_weight
        self.damping = algo.damping
        self.spin_weight = algo.spin_weight
        self._blocks = np.repeat(np.arange(len(BLOCKS)), BLOCKS)
        """(N,) block of each node"""
        self._first = np.concatenate(([0], np.cumsum(BLOCKS)[:-1]))
        """first node of each block"""
        n = len(BLOCKS) * model.n_u + 1  # one slack for the depth
        rows = 2 * self.N
        self._solver = ca.conic(
            "mpc",
            "daqp",
            {"h": ca.Sparsity.dense(n, n), "a": ca.Sparsity.dense(rows, n)},
            {"error_on_fail": False},
        )

    def rest(self) -> Plan:
        """Return a plan without thrust."""
        X = np.zeros((self.model.n_x, self.N + 1))
        X[3] = 1.0
        X[13:] = self.model.rest[:, None]
        return Plan(X, np.zeros((self.model.n_u, self.N)))

    def simulate(self, plan: Plan, state: Floats, current: Floats) -> None:
        """Compute the plan's states at the nodes by simulating its thrusts from a state (n_x,)."""
        plan.X[:, 0] = state
        for k in range(self.N):
            x = plan.X[:, k : k + 1]
            for _ in range(self.substeps):
                x, _ = self._substep(self._rate, x, plan.U[:, k : k + 1], current[:, None])
            plan.X[:, k + 1] = x[:, 0]

    def improve(self, plan: Plan, state: Floats, current: Floats) -> bool:
        """Improve a plan by one iteration from an estimated state (n_x,).

        Return False if the solver failed. The thrusts are then unchanged, and the next call computes the states at the nodes anew.
        """
        solved = self._iterate(plan, state, current)
        if not solved:
            plan.X[:] = np.nan
        return solved

    def _iterate(self, plan: Plan, state: Floats, current: Floats) -> bool:
        n_u, n_x, N = self.model.n_u, self.model.n_x, self.N
        ends, A, B = self._linearise(plan, current)
        gap = np.abs(ends - plan.X[:, 1:])[:RIGID].max()
        if not gap <= LARGEST_GAP:  # also true for NaN
            self.simulate(plan, state, current)
            ends, A, B = self._linearise(plan, current)
        n = len(BLOCKS) * n_u
        # Condensing: the deviation of each node's state as an affine function of the blocks' changes.
        S = np.zeros((N + 1, n_x, n))
        d = np.zeros((N + 1, n_x))
        d[0] = state - plan.X[:, 0]
        for k in range(N):
            S[k + 1] = A[k] @ S[k]
            block = self._blocks[k] * n_u
            S[k + 1, :, block : block + n_u] += B[k] * self.scale
            d[k + 1] = A[k] @ d[k] + ends[:, k] - plan.X[:, k + 1]
        if not np.all(np.isfinite(S)) or not np.all(np.isfinite(d)):
            return False
        H, g = self._cost(plan, S, d)
        low, high = self._bounds(plan)
        z = plan.X[2, 1:] + d[1:, 2]
        G = np.zeros((2 * N, n + 1))
        G[:N, :n] = G[N:, :n] = S[1:, 2]
        G[:N, n], G[N:, n] = -1.0, 1.0
        upper = np.concatenate([plan.depth[1] - z, np.full(N, np.inf)])
        lower = np.concatenate([np.full(N, -np.inf), plan.depth[0] - z])
        answer = self._solver(h=H, g=g, a=G, lba=lower, uba=upper, lbx=low, ubx=high)
        change = answer["x"].full()[:n, 0]
        if not self._solver.stats()["success"] or not np.all(np.isfinite(change)):
            return False
        plan.U += self.scale[:, None] * change.reshape(len(BLOCKS), n_u)[self._blocks].T
        np.clip(plan.U, self.limits[:, :1], self.limits[:, 1:], out=plan.U)
        plan.X += (S @ change + d).T
        plan.X[3:7] /= np.linalg.norm(plan.X[3:7], axis=0)
        return True

    def _linearise(self, plan: Plan, current: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the end state of each interval (n_x, N), and its derivatives A (N, n_x, n_x) and B (N, n_x, n_u)."""
        n_x = self.model.n_x
        c = np.repeat(current[:, None], self.N, axis=1)
        x, slope = plan.X[:, :-1], None
        for _ in range(self.substeps):
            x, step = self._substep(self._rates, x, plan.U, c)
            if slope is None:
                slope = step
            else:
                slope, inputs = step[:, :, :n_x] @ slope, step[:, :, n_x:]
                slope[:, :, n_x:] += inputs
        assert slope is not None
        return x, slope[:, :, :n_x], slope[:, :, n_x:]

    def _substep(self, rates: Direct, x: Floats, u: Floats, c: Floats) -> tuple[Floats, Floats]:
        """Return states (n_x, m) after one linearly implicit midpoint step, and their derivatives (m, n_x, n_x + n_u).

        The step is x + h (1 - h/2 J)^-1 f(x): second-order, and stable however fast the roll of a light
        vehicle is damped (Hairer and Wanner 1996, section IV.7). The derivatives take J as constant.
        """
        n_x = self.model.n_x
        h = self.interval / self.substeps
        rate, slopes = rates(x, u, c)
        J = slopes.reshape(n_x, x.shape[1], -1).transpose(1, 0, 2)
        implicit = np.eye(n_x) - 0.5 * h * J[:, :, :n_x]
        right = np.concatenate([rate.T[:, :, None], J], axis=2)
        solved = h * np.linalg.solve(implicit, right)
        end = x + solved[:, :, 0].T
        end[3:7] /= np.linalg.norm(end[3:7], axis=0)
        slope = solved[:, :, 1:]
        slope[:, :, :n_x] += np.eye(n_x)
        return end, slope

    def _cost(self, plan: Plan, S: Floats, d: Floats) -> tuple[Floats, Floats]:
        """Return the cost's Hessian (n + 1, n + 1) and gradient (n + 1,) with respect to the blocks' changes and the slack."""
        n_u, n = self.model.n_u, S.shape[2]
        # Beyond 1 m, the cost is the distance, not its square, so that far and near waypoints have the same pull.
        # Iterative reweighting makes this cost quadratic.
        ahead = plan.reference.T
        distance = np.linalg.norm(plan.X[:3, 1:] - ahead, axis=0)
        w = (self.position_weight[1:] / np.sqrt(np.maximum(distance, 1.0)))[:, None]
        J = (w[:, :, None] * S[1:, :3]).reshape(-1, n)
        r = (w * (plan.X[:3, 1:].T - ahead.T + d[1:, :3])).ravel()
        H = np.zeros((n + 1, n + 1))
        g = np.zeros(n + 1)
        # Roll and pitch rates have a cost, so that a plan does not tumble through attitudes at which the filter would
        # diverge. If the task prescribes no yaw, the yaw rate also has a cost, so that a light vehicle does not spin.
        spun = slice(10, 13 if plan.yaw is None else 12)
        spin = np.sqrt(self.spin_weight) * S[1:, spun].reshape(-1, n)
        rates = np.sqrt(self.spin_weight) * (plan.X[spun, 1:].T + d[1:, spun]).ravel()
        H[:n, :n] = J.T @ J + spin.T @ spin
        g[:n] = J.T @ r + spin.T @ rates
        if plan.yaw is not None:
            for weight, value, slope in _attitude(plan, S, d):
                H[:n, :n] += weight * slope.T @ slope
                g[:n] += weight * slope.T @ value
        if plan.solids is not None and len(plan.solids):
            value, slope = self._nearness(plan, plan.solids, S, d)
            H[:n, :n] += self.clearance_weight * slope.T @ slope
            g[:n] += self.clearance_weight * slope.T @ value
        # Costs of the thrust and of its change between blocks. The variables are additions to the plan's present thrusts.
        U = plan.U[:, self._first] / self.scale[:, None]
        applied = plan.applied / self.scale
        for b, length in enumerate(BLOCKS):
            own = slice(b * n_u, (b + 1) * n_u)
            weight = self.effort_weight * length
            H[own, own] += weight * np.eye(n_u)
            g[own] += weight * U[:, b]
            weight = self.change_weight
            before = applied if b == 0 else U[:, b - 1]
            step = weight * (U[:, b] - before)
            H[own, own] += weight * np.eye(n_u)
            g[own] += step
            if b > 0:
                last = slice((b - 1) * n_u, b * n_u)
                H[last, last] += weight * np.eye(n_u)
                H[own, last] -= weight * np.eye(n_u)
                H[last, own] -= weight * np.eye(n_u)
                g[last] -= step
        H[range(n), range(n)] += self.damping
        H[n, n] = DEPTH_PRICE
        g[n] = DEPTH_PRICE
        return H, g

    def _nearness(self, plan: Plan, solids: Floats, S: Floats, d: Floats) -> tuple[Floats, Floats]:
        """Return the missing clearances (m,) in m of the hull's spheres that are too near to solids, and the derivatives (m, n) of these
        clearances with respect to the blocks' changes.
        """
        assert self.avoidance is not None
        room, away = self.avoidance.clearances(solids, plan.X[:7, 1:].T, self.clearance)
        missing = self.clearance - room - np.einsum("jkc,kc->jk", away, d[1:, :3])
        slopes = -np.einsum("jkc,kcn->jkn", away, S[1:, :3])
        return missing[missing > 0.0], slopes[missing > 0.0]

    def _bounds(self, plan: Plan) -> tuple[Floats, Floats]:
        """Return the bounds of the changes (n + 1,): thrusts stay within their limits, the slack is not negative."""
        U = plan.U[:, self._first].T
        low = np.concatenate([((self.limits[:, 0] - U) / self.scale).ravel(), [0.0]])
        high = np.concatenate([((self.limits[:, 1] - U) / self.scale).ravel(), [np.inf]])
        return low, high


def _attitude(plan: Plan, S: Floats, d: Floats) -> Iterator[tuple[float, Floats, Floats]]:
    """Yield weight, values (N,) and slopes (N, n) of the costs of yaw and tilt, if the task prescribes a yaw."""
    w, x, y, z = plan.X[3:7, 1:]
    yaw = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y**2 + z**2))

    def along(*parts: Floats | float) -> tuple[Floats, Floats]:
        """Linearise a function of the nodes' attitudes: return its change (N,) due to the deviations `d`, and its slopes (N, n).

        `parts` are the function's partial derivatives with respect to w, x, y and z.
        """
        own = np.stack(np.broadcast_arrays(*parts, w)[:4])
        return np.einsum("ck,kc->k", own, d[1:, 3:7]), np.einsum("ck,kcn->kn", own, S[1:, 3:7])

    # The yaw of a level quaternion turns by 2 (w dz - z dw).
    drift, slope = along(-2.0 * z, 0.0, 0.0, 2.0 * w)
    yield YAW_WEIGHT, wrap(yaw - (plan.yaw or 0.0)) + drift, slope
    # x and y of the body's vertical in world axes.
    drift, slope = along(2.0 * y, 2.0 * z, 2.0 * w, 2.0 * x)
    yield TILT_WEIGHT, 2.0 * (x * z + w * y) + drift, slope
    drift, slope = along(-2.0 * x, -2.0 * w, 2.0 * z, 2.0 * y)
    yield TILT_WEIGHT, 2.0 * (y * z - w * x) + drift, slope
