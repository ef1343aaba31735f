"""Estimate the state for model-based controllers, by a steady-state Kalman filter over the vehicle's
equations.

The observation has the noisy position error and yaw error and the previous action. The filter predicts with
the sheet's equations and the commanded forces, and corrects with the two readings. So it estimates what no
learner observes: roll, pitch, velocities, and a current that is constant in the world (without it,
predictions would be wrong while the water moves). If the task observes velocities or gravity, these are
additional readings. Positions are relative to the reference, or to the goal if the task observes it: a dock
does not move, but the reference of docking does. The gain is that of the linearisation about rest (Kalman
1960; the discrete algebraic Riccati equation by `scipy.linalg.solve_discrete_are`), turned by the yaw.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.agents.classical.cascade import wrap
from auvbench.config import schema
from auvbench.dynamics import frames
from auvbench.observation import BODY
from auvbench.registry import TASKS
from auvbench.tasks.observation import observation_spec
from auvbench.vehicles.symbolic import RIGID, SymbolicModel, require, symbolic

Floats = NDArray[np.float64]

# Standard deviation of accelerations that the model lacks, and drift of the current's estimate.
FORCE_NOISE = 0.15  # m/s2 and rad/s2, over one second
CURRENT_DRIFT = 0.05  # m/s, over one second
# Speed at which quadratic damping is linearised for the gain: without any damping a current would be
# unobservable.
TYPICAL_SPEED = 0.5  # m/s
TYPICAL_RATE = 0.3  # rad/s
# Smallest assumed noise of a reading, even if the configuration has no noise.
SMALLEST_NOISE = 0.01  # m, rad, m/s, rad/s
# Beyond this no state is plausible: the equations have diverged from the vehicle, and the filter restarts.
LARGEST_STATE = 1e4  # m, m/s, rad/s

# Blocks of true values that the filter reads, with their indices in (position, attitude, velocity).
MEASURED = {"gravity": (3, 4), "velocity": (6, 7, 8), "angular_velocity": (9, 10, 11)}
READ = (*MEASURED, "velocity_error", "goal_error", "preview")


class Observer:
    """Estimated states of N vehicles, each row independent."""

    def __init__(self, model: SymbolicModel, config: schema.TrainConfig) -> None:
        self.model = model
        self.vehicle = model.vehicle
        self.dt = 1.0 / config.step.frequency
        spec = observation_spec(config.task, self.vehicle.actuators)
        self._columns = spec["yaw_error"], spec["position_error"], spec["previous_action"]
        # In world axes, a reading in body axes would have to be turned by a yaw that is itself an estimate.
        body_frame = spec.blocks["position_error"].axes == BODY
        self._read = {name: spec[name] for name in READ if body_frame and name in spec.blocks}
        measured = [index for name, indices in MEASURED.items() if name in self._read for index in indices]
        self._preview = config.task.preview if "preview" in self._read else None
        # The reference of a path moves with the vehicle; the reference of a trajectory in time does not.
        self._with_vehicle = TASKS[config.task.name].path
        self.body_frame = body_frame
        substeps = max(1, int(np.ceil(self.dt / min(0.1, model.longest_step) - 1e-9)))
        self._step = model.step(self.dt, substeps)
        self.gain = kalman_gain(
            model,
            self.dt,
            _deviation(config.noise.position, config),
            _deviation(config.noise.yaw, config),
            measured,
        )
        self.reset(0)

    def reset(self, n: int) -> None:
        """Forget everything: rows at rest, level, in still water."""
        self.first: NDArray[np.bool_] = np.ones(n, dtype=np.bool_)
        """(n,) whether the row has had no reading yet"""
        self.state: Floats = np.zeros((n, self.model.n_x))
        """(n, n_x) model states; the reference, or the goal, is the origin of the world axes"""
        self.state[:, 3] = 1.0
        self.state[:, RIGID:] = self.model.rest
        self.current: Floats = np.zeros((n, 3))
        """(n, 3) estimated current in m/s, world axes"""
        self.target: Floats = np.zeros((n, 3))
        """(n, 3) velocity of the reference in m/s, in the axes of the state, if the task observes it"""
        self.ahead: list[Floats] = [np.zeros((1, 3))] * n
        """n arrays (1 + points, 3) in m: positions of the reference now and at the times of the preview, in
        the axes of the state
        """
        self.yaw_target: Floats = np.zeros(n)
        """(n,) yaw of the reference in rad, in the axes of the state"""

    def update(self, observation: Floats, rows: NDArray[np.intp]) -> None:
        """Process observations (n, n_obs); read only `rows` (k,)."""
        for i in rows:
            self._update_row(int(i), observation[i])
            self.first[i] = False

    def memory(self) -> dict[str, NDArray[Any]]:
        """Return the arrays that the observer carries from reading to reading, by name, with a row for each
        vehicle.
        """
        return {name: getattr(self, name) for name in ("first", "state", "current", "target")}

    def _update_row(self, i: int, observation: Floats) -> None:
        (yaw_error,), error, previous = (observation[columns] for columns in self._columns)
        x = self.state[i]
        if not self.first[i]:
            x[:] = self._step(x, self.vehicle.force(previous), self.current[i]).full()[:, 0]
            x[:3] -= self._moved(i)
            if not np.abs(x[:RIGID]).max() < LARGEST_STATE:  # also true for NaN
                self._begin(i)
        predicted = float(frames.yaw(x[3:7]))
        if self.body_frame:
            # The readings do not contain the yaw in the world: its value only names the axes.
            yaw, position = predicted, -turned(error, predicted)
        else:
            yaw, position = float(wrap(np.arctan2(error[1], error[0]) - yaw_error)), -error
        reference = np.zeros(3)
        if "goal_error" in self._read:
            goal = -turned(observation[self._read["goal_error"]], predicted)
            reference, position = goal - position, goal
        self.yaw_target[i] = yaw + yaw_error
        if self.first[i]:
            x[:3] = position
            x[3:7] = np.cos(yaw / 2.0), 0.0, 0.0, np.sin(yaw / 2.0)
        else:
            self._correct(i, observation, position, yaw, predicted)
        if {"velocity", "velocity_error"} <= self._read.keys():
            missing = turned(observation[self._read["velocity_error"]], yaw)
            self.target[i] = missing + to_world(x[3:7], observation[self._read["velocity"]])
        self.ahead[i] = reference[None]
        if self._preview is not None:
            points = observation[self._read["preview"]].reshape(-1, 3)
            self.ahead[i] = np.stack([reference, *(position + turned(point, yaw) for point in points)])

    def _begin(self, i: int) -> None:
        """Reset row i: at rest, level, in still water."""
        self.first[i] = True
        self.state[i] = 0.0
        self.state[i, 3] = 1.0
        self.state[i, RIGID:] = self.model.rest
        self.current[i] = self.target[i] = 0.0

    def _correct(self, i: int, observation: Floats, position: Floats, yaw: float, predicted: float) -> None:
        """Correct the prediction of row i with the readings."""
        x = self.state[i]
        # In level axes that turn with the vehicle, the linearisation does not depend on yaw.
        innovation = [*turned(position - x[:3], -predicted), float(wrap(np.asarray(yaw - predicted)))]
        if "gravity" in self._read:
            down = -to_world(x[3:7] * [1.0, -1.0, -1.0, -1.0], np.array([0.0, 0.0, 1.0]))
            # Rotation from the predicted to the measured direction, to first order.
            innovation += list(np.cross(observation[self._read["gravity"]], down)[:2])
        for name, own in (("velocity", slice(7, 10)), ("angular_velocity", slice(10, 13))):
            if name in self._read:
                innovation += list(observation[self._read[name]] - x[own])
        correction = self.gain @ np.array(innovation)
        x[:3] += turned(correction[:3], predicted)
        x[3:7] = _rotated(x[3:7], correction[3:6])
        x[7:13] += correction[6:12]
        self.current[i] += turned(correction[12:15], predicted)

    def _moved(self, i: int) -> Floats:
        """Return the displacement (3,) in m of row i's reference in one step."""
        way = self.target[i]
        if self._with_vehicle:
            along = way / max(float(np.linalg.norm(way)), 1e-6)
            x = self.state[i]
            way = along * float(along @ to_world(x[3:7], x[7:10]))
        return np.asarray(way * self.dt)


def kalman_gain(
    model: SymbolicModel,
    dt: float,
    position_noise: float,
    yaw_noise: float,
    measured: Sequence[int] = (),
) -> Floats:
    """Return the steady gain (15, 4 + m) from readings (x, y, z, yaw, more) to (position, attitude, velocity,
    current).

    Args:
        measured: m indices among the 15 that are read without noise.
    """
    from scipy.linalg import expm, solve_discrete_are

    vehicle = model.vehicle
    damping = vehicle.linear_damping + vehicle.quadratic_damping * np.repeat([TYPICAL_SPEED, TYPICAL_RATE], 3)
    about = replace(vehicle, linear_damping=damping, quadratic_damping=np.zeros(6))
    A, _, E = linearised(symbolic(about), np.zeros(6), np.zeros(model.n_u))
    n = A.shape[0]
    full = np.zeros((n + 3, n + 3))
    full[:n, :n] = A
    full[:n, n:] = E
    F = expm(full * dt)
    read = [0, 1, 2, 5, *measured]
    C = np.zeros((len(read), n + 3))
    C[np.arange(len(read)), read] = 1.0
    Q = np.zeros(n + 3)
    Q[:6] = (1e-3**2) * dt
    Q[6:12] = FORCE_NOISE**2 * dt
    Q[12:] = CURRENT_DRIFT**2 * dt
    R = np.diag([position_noise**2] * 3 + [yaw_noise**2] + [SMALLEST_NOISE**2] * len(measured))
    P = solve_discrete_are(F.T, C.T, np.diag(Q), R)
    return np.asarray(P @ C.T @ np.linalg.inv(C @ P @ C.T + R))


def linearised(model: SymbolicModel, velocity: Floats, thrust: Floats) -> tuple[Floats, Floats, Floats]:
    """Return Jacobians about level attitude, body velocity (6,) and thrust (n_u,), without the lags.

    Returns:
        A (12, 12), B (12, n_u) and E (12, 3) of e' = A e + B f + E c, where e is (position, small rotation,
            velocity), f the thrusts in N and c the current in m/s.
        velocity), f the thrusts in N and c the current in m/s.
    """
    ca = require()
    x, f, c = ca.SX.sym("x", RIGID), ca.SX.sym("f", model.n_u), ca.SX.sym("c", 3)
    rate = model.rigid(x, f, c)
    jacobians = ca.Function("J", [x, f, c], [ca.jacobian(rate, v) for v in (x, f, c)])
    point = np.concatenate([np.zeros(3), [1.0, 0.0, 0.0, 0.0], velocity])
    J = [j.full() for j in jacobians(point, thrust, np.zeros(3))]
    # A small rotation theta is the quaternion (1, theta / 2).
    into = np.zeros((RIGID, 12))
    into[:3, :3] = np.eye(3)
    into[4:7, 3:6] = 0.5 * np.eye(3)
    into[7:, 6:] = np.eye(6)
    back = np.zeros((12, RIGID))
    back[:3, :3] = np.eye(3)
    back[3:6, 4:7] = 2.0 * np.eye(3)
    back[6:, 7:] = np.eye(6)
    return back @ J[0] @ into, back @ J[1], back @ J[2]


def to_world(q: Floats, vector: Floats) -> Floats:
    """Return a vector (3,) turned from body to world axes by a quaternion (w, x, y, z)."""
    twice = 2.0 * np.cross(q[1:], vector)
    return np.asarray(vector + q[0] * twice + np.cross(q[1:], twice))


def turned(vector: Floats, angle: float) -> Floats:
    """Return a vector (3,) turned by an angle about z."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1], vector[2]])


def _rotated(q: Floats, rotation: Floats) -> Floats:
    """Return a quaternion (4,) after a small rotation (3,) in body axes."""
    w, x, y, z = q
    a, b, c = 0.5 * rotation
    result = np.array(
        [
            w - x * a - y * b - z * c,
            x + w * a + y * c - z * b,
            y + w * b + z * a - x * c,
            z + w * c + x * b - y * a,
        ]
    )
    return np.asarray(result / np.linalg.norm(result))


def _deviation(span: schema.Range, config: schema.TrainConfig) -> float:
    """Return the standard deviation of uniform noise with magnitudes in [low, high] and random sign."""
    low, high = span.low * config.noise.scale, span.high * config.noise.scale
    return max(float(np.sqrt((low * low + low * high + high * high) / 3.0)), SMALLEST_NOISE)
