"""Sample, simulate and weigh plans for `mppi.py`.

A plan has a command for each of `NODES` intervals of the horizon. A sample is the plan plus correlated noise. The simulator itself
(`simulators.fossen`) simulates the samples as a batch of vehicles, so the model has the simulator's equations, thruster curves and lags.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from auvbench.agents.classical.avoiding import NEARNESS, Avoidance, price
from auvbench.config.algorithms.mppi import MPPI
from auvbench.dynamics.actuation import interpolated
from auvbench.dynamics.compiled import compiled
from auvbench.dynamics.lanes import quaternion, vector
from auvbench.dynamics.layout import POSE, VELOCITY, record
from auvbench.dynamics.random import normal4
from auvbench.dynamics.vectors import dot, rotation_matrix, subtract
from auvbench.simulators.fossen import FossenSimulator
from auvbench.vehicles.inspect import shortest_time_constant
from auvbench.vehicles.vehicle_model import VehicleModel

Floats = NDArray[np.float64]

NODES = 24
"""Number of commands of a plan"""
SAMPLES = 0x81
"""Random stream of the noise, in addition to the streams in dynamics/random.py; `random.py` uses 0x80"""
LONGEST_SUBSTEP = 0.1
"""Longest substep of the model in s; with it, RK4 is accurate to a centimetre over the horizon"""
STABLE = 2.0
"""Longest substep as a multiple of the vehicle's shortest time constant; RK4 is stable up to 2.78"""
POINTS = 513
"""Number of points in each table that maps thrusts to commands"""
SERVED = 0.99
"""Smallest share of a wrench along a single axis that the thrusters must be able to give, so that plans get noise along this axis"""
DEPTH_PRICE = 1e3
"""cost per m beyond the depth limits"""
YAW_WEIGHT = 1.0
"""Weight of the squared yaw error in m2/rad2, if the task prescribes a yaw"""
TILT_WEIGHT = 5.0
"""Weight of the squared sine of the tilt in m2 (the cost of roll and pitch), if the task prescribes a yaw"""

PRICES = record(
    position=(),  # weight of the distance in m, or of its square if the distance is below 1 m
    spin=(),  # s2 m, weight of squared roll and pitch rates
    turn=(),  # s2 m, weight of the squared yaw rate
    effort=(),  # weight of the squared thrust; the thrust is a share of its range
    change=(),  # weight of the squared change of thrust; the thrust is a share of its range
    yaw=(),  # m2, weight of the squared yaw error
    tilt=(),  # m2, weight of the squared sine of the tilt
    depth=(),  # 1/m, weight of the distance beyond the depth limits
)
"""Weights of the terms of a cost"""
AIM = record(
    position=(3,),  # m
    course=(2,),  # cosine and sine of the yaw
    low=(),  # m, lower depth limit
    high=(),  # m, upper depth limit
)
"""Target of a vehicle at a node"""


@compiled("dynamics")
def draw(
    seed: int,
    episode: int,
    step: int,
    iteration: int,
    plan: Floats,  # (nodes, n_u) N
    slope: Floats,  # (m, nodes) derivatives of u' Sigma^-1 (v - u) with respect to the w_k of the noise along each axis
    mix: Floats,  # (n_u, m) N, standard deviation of each thrust due to the noise along each axis
    keep: float,
    low: Floats,  # (n_u,) N
    high: Floats,  # (n_u,) N
    table: Floats,  # (n_u, points) commands at equally spaced thrusts from the least to the largest
    thrusts: Floats,  # (nodes, n, n_u) output: thrusts of the samples, N
    commands: Floats,  # (nodes, n, n_u) output: commands of the samples
    control: Floats,  # (n,) output: u' Sigma^-1 (v - u)
) -> None:
    """Write n samples of a plan: first the plan itself, then pairs of the plan plus noise and the plan minus the same noise.

    The noise along an axis is e_k = keep e_(k-1) + sqrt(1 - keep^2) w_k with standard normal w. In `control`, u is the plan, v a sample,
    and Sigma the covariance of the noise.
    """
    nodes, n, n_u = commands.shape
    m, points = mix.shape[1], table.shape[1]
    fresh = math.sqrt(1.0 - keep * keep)
    w, e, per_newton = np.zeros((m, 4)), np.zeros(m), np.zeros(n_u)
    for a in range(n_u):
        per_newton[a] = (points - 1) / (high[a] - low[a])
    for first in range(-1, n, 2):
        # In the first pair the noise is 0, so only the pair's second sample, the plan itself, is stored.
        second = first + 1
        total = 0.0
        e[:] = 0.0
        for k in range(nodes):
            if first > 0:
                if k % 4 == 0:
                    for j in range(m):
                        channel = (first * m + j) * nodes + k
                        w[j, 0], w[j, 1], w[j, 2], w[j, 3] = normal4(
                            seed, SAMPLES, channel, step, episode, iteration
                        )
                for j in range(m):
                    new = w[j, k % 4]
                    e[j] = new if k == 0 else keep * e[j] + fresh * new
                    total += slope[j, k] * new
            for a in range(n_u):
                noise = 0.0
                for j in range(m):
                    noise += mix[a, j] * e[j]
                for sample in range(max(first, 0), min(second + 1, n)):
                    u = min(max(plan[k, a] + (noise if sample == first else -noise), low[a]), high[a])
                    thrusts[k, sample, a] = u
                    commands[k, sample, a] = interpolated(table, a, points, (u - low[a]) * per_newton[a])
        if first > 0:
            control[first] = total
        if second < n:
            control[second] = -total


@compiled("dynamics")
def charge(
    pose: Floats,  # (n, 7)
    velocity: Floats,  # (n, 6)
    force: Floats,  # (n, n_u) N, forces of the last command
    shares: Floats,  # (n_u,) 1/N, reciprocals of the thrusters' ranges
    before: Floats,  # (n, n_u) forces of the previous node as shares of their ranges; replaced by the forces of this node
    # Records are passed as floats, because numba compares the types of records again in each call.
    aims: Floats,  # record of type AIM
    weights: Floats,  # record of type PRICES
    cost: Floats,  # (n,) costs, increased in place
) -> None:
    """Add the cost of the states and forces at a node."""
    aim, prices = aims.view(AIM)[0], weights.view(PRICES)[0]
    poses, velocities = pose.view(POSE)[:, 0], velocity.view(VELOCITY)[:, 0]
    target = vector(aim.position)
    for i in range(cost.shape[0]):
        position = vector(poses[i].position)
        away = subtract(position, target)
        distance = math.sqrt(dot(away, away))
        # Beyond 1 m, the cost is the distance, not its square, so that far and near waypoints have the same pull.
        total = prices.position * distance * min(distance, 1.0)
        p, q, r = vector(velocities[i].angular)
        total += prices.spin * (p * p + q * q) + prices.turn * (r * r)
        z = position[2]
        total += prices.depth * (max(aim.low - z, 0.0) + max(z - aim.high, 0.0))
        if prices.yaw > 0.0:
            R = rotation_matrix(quaternion(poses[i].attitude))
            c, s = aim.course[0], aim.course[1]
            off = math.atan2(R[1][0] * c - R[0][0] * s, R[0][0] * c + R[1][0] * s)
            total += prices.yaw * (off * off) + prices.tilt * (R[0][2] * R[0][2] + R[1][2] * R[1][2])
        for a in range(force.shape[1]):
            share = force[i, a] * shares[a]
            step = share - before[i, a]
            total += prices.effort * (share * share) + prices.change * (step * step)
            before[i, a] = share
        cost[i] += total


def weights(cost: Floats, control: Floats, temperature: float, control_cost: float) -> Floats | None:
    """Return the weights (n,) of samples, exp(-(S - min S) / lambda - control_cost u' Sigma^-1 (v - u)), with sum 1.

    Williams et al. 2018, eq. 29 and algorithm 2, where gamma = control_cost lambda. Lambda is `temperature` times the distance from the
    least to the median cost, so that the same temperature suits costs of any size. Samples without a finite cost have weight 0.

    Args:
        cost: (n,) S.
        control: (n,) u' Sigma^-1 (v - u).
        temperature: lambda divided by the distance from the least to the median cost.
        control_cost: gamma / lambda.

    Returns:
        None if no sample has a finite cost.
    """
    finite = np.isfinite(cost)
    if not finite.any():
        return None
    least = cost[finite].min()
    scale = max(temperature * (np.median(cost[finite]) - least), np.finfo(np.float64).tiny)
    # If most samples have the least cost, `scale` is tiny, and the exponent of another sample may overflow.
    with np.errstate(over="ignore"):
        exponent = np.where(finite, -(cost - least) / scale - control_cost * control, -np.inf)
    weight = np.exp(exponent - exponent.max())
    return np.asarray(weight / weight.sum())


def axes(allocation: Floats, shares: Floats) -> Floats:
    """Return thrusts (n_u, 6) in N: column j gives a wrench along axis j only, scaled so that one thruster uses its whole range. The column
    is 0 if the thrusters cannot act on axis j without acting on other axes.

    Args:
        allocation: (6, n_u) wrench per newton of each thruster.
        shares: (n_u,) 1/N, reciprocals of the thrusters' ranges.
    """
    inverse = np.linalg.pinv(allocation, rcond=1e-6)
    served = np.diag(allocation @ inverse) > SERVED
    largest = np.abs(inverse * shares[:, None]).max(axis=0)
    return np.where(served, inverse / np.maximum(largest, 1e-12), 0.0)


class Sampler:
    """Improve plans of one vehicle by simulated samples."""

    def __init__(
        self, vehicle: VehicleModel, algo: MPPI, turns: bool, avoidance: Avoidance | None = None
    ) -> None:
        self.algo, self.avoidance = algo, avoidance
        self.solids: Floats | None = None
        """(k, size) solids that samples avoid, see `Avoidance.solids`; None or (0, size): open water"""
        nearness = np.zeros(1, NEARNESS)
        nearness["clearance"], nearness["weight"] = algo.clearance, algo.clearance_weight
        nearness["contact"] = algo.contact_weight
        self.nearness = nearness.view(np.float64)
        self.interval = algo.horizon / NODES
        step = min(LONGEST_SUBSTEP, STABLE * shortest_time_constant(vehicle))
        self.model = FossenSimulator(vehicle, algo.samples, max_step=step)
        self.low, self.high = (vehicle.force_limits * algo.effort).T.copy()
        self.table = np.ascontiguousarray(vehicle.action(np.linspace(self.low, self.high, POINTS)).T)
        """(n_u, POINTS) commands at equally spaced thrusts"""
        self.shares = 1.0 / np.maximum(np.abs(self.low), np.abs(self.high))
        self.mix = axes(vehicle.allocation, self.shares) * np.repeat([algo.noise, algo.turn_noise], 3)
        self.mix = np.ascontiguousarray(self.mix[:, np.abs(self.mix).max(axis=0) > 0.0])
        self.unmix = np.linalg.pinv(self.mix)
        self.keep = math.exp(-self.interval / algo.correlation) if algo.correlation > 0.0 else 0.0
        prices = np.zeros(2, PRICES)
        prices["position"] = 1.0, algo.terminal_weight
        prices["spin"], prices["turn"] = algo.spin_weight, 0.0 if turns else algo.spin_weight
        prices["effort"], prices["change"] = algo.effort_weight, algo.change_weight
        prices["yaw"], prices["tilt"] = (YAW_WEIGHT, TILT_WEIGHT) if turns else (0.0, 0.0)
        prices["depth"] = DEPTH_PRICE
        self.prices = prices.view(np.float64).reshape(2, -1)
        """(2, size) weights of the cost: row 0 for all nodes before the last node, row 1 for the last node"""
        self.thrusts, self.commands = np.zeros((2, NODES, algo.samples, len(vehicle.units)))
        self.cost, self.control = np.zeros(algo.samples), np.zeros(algo.samples)
        self.before = np.zeros(self.model.command_force.shape)

    def improve(
        self, plan: Floats, state: Floats, actuators: Floats, current: Floats, applied: Floats, aims: Floats,
        key: tuple[int, int, int, int],
    ) -> bool:  # fmt: skip
        """Replace a plan (NODES, n_u) of thrusts in N by the weighted mean of samples about it.

        Args:
            plan: changed in place.
            state: (13,) pose and velocity at the start.
            actuators: (n_actuator_states,) states of the actuators at the start.
            current: (3,) m/s, world axes.
            applied: (n_u,) N, force of the last step.
            aims: (NODES, 7) records of AIM.
            key: seed, episode, step and iteration of the draws.

        Returns:
            Whether any sample has a finite cost. If False, the plan is unchanged.
        """
        algo = self.algo
        self.draw(plan, key)
        self.roll_out(state, actuators, current, applied, aims)
        weight = weights(self.cost, self.control, algo.temperature, algo.control_cost)
        if weight is None:
            return False
        plan[:] = np.einsum("i,kia->ka", weight, self.thrusts)
        return True

    def draw(self, plan: Floats, key: tuple[int, int, int, int]) -> None:
        """Write `thrusts`, `commands` and `control` of samples about a plan; see `improve` for the arguments."""
        shape = self.unmix @ plan.T  # (m, NODES) plan in standard deviations of the noise along each axis
        slope = shape.copy()
        slope[:, 1:] = (shape[:, 1:] - self.keep * shape[:, :-1]) / math.sqrt(1.0 - self.keep * self.keep)
        draw(
            *key, plan, slope, self.mix, self.keep, self.low, self.high, self.table, self.thrusts, self.commands, self.control
        )  # fmt: skip

    def roll_out(
        self, state: Floats, actuators: Floats, current: Floats, applied: Floats, aims: Floats
    ) -> None:
        """Simulate `commands` from one state, and add up `cost`; see `improve` for the arguments."""
        model = self.model
        model.pose[:], model.velocity[:], model.actuators[:] = state[:7], state[7:], actuators
        model.set_current(current)
        self.before[:] = applied * self.shares
        self.cost[:] = 0.0
        for k in range(NODES):
            model.step(self.commands[k], self.interval)
            charge(
                model.pose,
                model.velocity,
                model.command_force,
                self.shares,
                self.before,
                aims[k],
                self.prices[int(k == NODES - 1)],
                self.cost,
            )
            if self.avoidance is not None and self.solids is not None and len(self.solids):
                price(model.pose, self.solids, self.avoidance.hull, self.nearness, self.cost)
