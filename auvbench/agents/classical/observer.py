"""Estimate the state for model-based controllers, by an extended Kalman filter over the vehicle's equations.

The observation has the noisy position error and yaw error and the previous action. The filter predicts with
the sheet's equations and the commanded forces, and corrects with the two readings. So it estimates
what the observation need not contain: roll, pitch, velocities, and a current that is constant in the world
(without this estimate, predictions would be wrong in a current). If the task observes velocities or gravity, these are
additional readings. Positions are relative to the reference, or to the goal if the task observes the goal: a dock
does not move, but the reference of docking does. The filter is an error-state Kalman filter (Sola 2017, "Quaternion
kinematics for the error-state Kalman filter", section 5; covariance in Joseph's form). It linearises about the
estimated state, because drag grows with speed: with the gain of a vehicle at rest, the estimate of the current would
grow without bound at 1 m/s.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.agents.classical.cascade import wrap
from auvbench.config import schema
from auvbench.dynamics import frames
from auvbench.observation import BODY
from auvbench.registry import TASKS
from auvbench.tasks.observation_spec import observation_spec
from auvbench.vehicles.symbolic import RIGID, Direct, SymbolicModel, require

Floats = NDArray[np.float64]

# Standard deviations of the process noise: accelerations that the model lacks, drift of the current, drift of the pose.
FORCE_NOISE = 0.15  # m/s2 and rad/s2, over one second
CURRENT_DRIFT = 0.05  # m/s, over one second
POSE_DRIFT = 1e-3  # m and rad, over one second
# Standard deviations of the initial estimate: a vehicle at rest, level, in still water.
FIRST = {"tilt": 0.1, "velocity": 0.3, "current": 0.3}  # rad, m/s and rad/s, m/s
ERRORS = 15
"""Number of errors that the filter estimates: position (world), rotation (body), velocity (body) and current (world)."""
# Smallest assumed noise of a reading, even if the configuration has no noise.
SMALLEST_NOISE = 0.01  # m, rad, m/s, rad/s
# Largest plausible state. A larger state means that the filter has diverged; it then restarts.
LARGEST_STATE = 1e4  # m, m/s, rad/s

# Observation blocks without noise that the filter reads, each with the filter errors that it measures (see ERRORS).
MEASURED = {"gravity": slice(3, 5), "velocity": slice(6, 9), "angular_velocity": slice(9, 12)}
READ = (*MEASURED, "velocity_error", "goal_error", "preview")


class Observer:
    """Estimated states of N vehicles, each row independent."""

    def __init__(self, model: SymbolicModel, config: schema.TrainConfig) -> None:
        self.model = model
        self.vehicle = model.vehicle
        self.dt = 1.0 / config.step.frequency
        spec = observation_spec(config.task, self.vehicle.actuators)
        self._columns = spec["yaw_error"], spec["position_error"], spec["previous_action"]
        # Blocks in body axes are read only with `body_frame`: only an estimate of the yaw could turn them to world axes.
        body_frame = spec.blocks["position_error"].axes == BODY
        self._read = {name: spec[name] for name in READ if body_frame and name in spec.blocks}
        self._preview = config.task.preview if "preview" in self._read else None
        # On a path, the reference advances with the vehicle; on a trajectory, it advances with time.
        self._with_vehicle = TASKS[config.task.name].path
        self.body_frame = body_frame
        substeps = max(1, int(np.ceil(self.dt / min(0.1, model.longest_step) - 1e-9)))
        self._predict = prediction(model, self.dt, substeps)
        self._noise = _deviation(config.noise.position, config), _deviation(config.noise.yaw, config)
        drift = np.repeat([POSE_DRIFT, FORCE_NOISE, CURRENT_DRIFT], [6, 6, 3])
        self._drift = np.diag(drift**2 * self.dt)
        self.reset(0)

    def reset(self, n: int) -> None:
        """Reset the estimates of n rows to a vehicle at rest, level, in still water."""
        self.first: NDArray[np.bool_] = np.ones(n, dtype=np.bool_)
        """(n,) whether the row has had no reading yet"""
        self.state: Floats = np.zeros((n, self.model.n_x))
        """(n, n_x) model states; the reference, or the goal, is the origin of the world axes"""
        self.state[:, 3] = 1.0
        self.state[:, RIGID:] = self.model.rest
        self.current: Floats = np.zeros((n, 3))
        """(n, 3) estimated current in m/s, world axes"""
        self.covariance: Floats = np.zeros((n, ERRORS, ERRORS))
        """(n, 15, 15) covariance of the estimate's errors"""
        self.target: Floats = np.zeros((n, 3))
        """(n, 3) velocity of the reference in m/s, in the axes of the state; 0 if the task does not observe this velocity"""
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

    def reference(self, i: int, interval: float, count: int) -> Floats:
        """Return the positions (count, 3) in m of row i's reference at multiples of `interval` s. After the preview's last point, the
        reference is assumed to move straight on.
        """
        times = interval * np.arange(1, count + 1)
        points, velocity = self.ahead[i], self.target[i]
        apart = 0.0 if self._preview is None else self._preview.interval
        known = apart * np.arange(len(points))
        if len(points) > 1:
            velocity = (points[-1] - points[-2]) / apart
        seen = np.stack([np.interp(times, known, axis) for axis in points.T], axis=1)
        return seen + np.outer(np.maximum(times - known[-1], 0.0), velocity)

    def memory(self) -> dict[str, NDArray[Any]]:
        """Return the arrays that the observer carries from reading to reading, by name, with a row for each
        vehicle.
        """
        return {name: getattr(self, name) for name in ("first", "state", "current", "covariance", "target")}

    def _update_row(self, i: int, observation: Floats) -> None:
        (yaw_error,), error, previous = (observation[columns] for columns in self._columns)
        x = self.state[i]
        if not self.first[i]:
            force = self.vehicle.force(previous)
            after, F = self._predict(x[:, None], force[:, None], self.current[i, :, None])
            self.covariance[i] = F @ self.covariance[i] @ F.T + self._drift
            x[:] = after[:, 0]
            x[:3] -= self._moved(i)
            if not np.abs(x[:RIGID]).max() < LARGEST_STATE:  # also true for NaN
                self._begin(i)
        predicted = float(frames.yaw(x[3:7]))
        if self.body_frame:
            # The readings do not contain the yaw in the world, so the predicted yaw defines the axes.
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
            self._begin_covariance(i)
        self._correct(i, observation, position, yaw)
        if {"velocity", "velocity_error"} <= self._read.keys():
            missing = turned(observation[self._read["velocity_error"]], yaw)
            self.target[i] = missing + to_world(x[3:7], observation[self._read["velocity"]])
        self.ahead[i] = reference[None]
        if self._preview is not None:
            points = observation[self._read["preview"]].reshape(-1, 3)
            self.ahead[i] = np.stack([reference, *(position + turned(point, yaw) for point in points)])

    def _begin(self, i: int) -> None:
        """Reset the estimate of row i to a vehicle at rest, level, in still water."""
        self.first[i] = True
        self.state[i] = 0.0
        self.state[i, 3] = 1.0
        self.state[i, RIGID:] = self.model.rest
        self.current[i] = self.target[i] = 0.0

    def _begin_covariance(self, i: int) -> None:
        """Set the covariance of row i after its first reading of position and yaw."""
        position, yaw = self._noise
        # In the body frame, the first yaw defines the axes, so the yaw has no error.
        turn = 0.0 if self.body_frame else yaw
        spread = (
            [position] * 3 + [FIRST["tilt"]] * 2 + [turn] + [FIRST["velocity"]] * 6 + [FIRST["current"]] * 3
        )
        self.covariance[i] = np.diag(np.square(spread))

    def _correct(self, i: int, observation: Floats, position: Floats, yaw: float) -> None:
        """Correct the prediction of row i with the readings."""
        x = self.state[i]
        R = frames.rotation(x[3:7])
        innovation, H, noise = self._poses(x, R, position, yaw)
        for name, errors in MEASURED.items():
            if name not in self._read:
                continue
            reading = observation[self._read[name]]
            if name == "gravity":
                # Rotation from the predicted to the measured direction of gravity, to first order.
                off = np.cross(reading, -R[2])[:2]
            else:
                off = reading - x[errors.start + 1 : errors.stop + 1]  # quaternion: 4 numbers, error: 3
            innovation = np.concatenate([innovation, off])
            H = np.concatenate([H, np.eye(ERRORS)[errors]])
        N = np.diag(np.full(len(H), SMALLEST_NOISE**2))
        N[: len(noise), : len(noise)] = noise
        P = self.covariance[i]
        K = np.linalg.solve(H @ P @ H.T + N, H @ P).T
        correction = K @ innovation
        rest = np.eye(ERRORS) - K @ H
        P[:] = rest @ P @ rest.T + K @ N @ K.T
        x[:3] += correction[:3]
        x[3:7] = _rotated(x[3:7], correction[3:6])
        x[7:13] += correction[6:12]
        self.current[i] += correction[12:]

    def _poses(self, x: Floats, R: Floats, position: Floats, yaw: float) -> tuple[Floats, Floats, Floats]:
        """Return innovation (m,), Jacobian (m, 15) and noise covariance (m, m) of the readings of position and yaw.
        m is 3 in the body frame, whose readings do not contain the yaw, else 4.
        """
        far, turn = self._noise
        # Derivative of the yaw with respect to a small rotation in body axes, bounded for a vehicle that points up or down.
        turning = R[2] * [0.0, 1.0, 1.0] / max(R[2, 1] ** 2 + R[2, 2] ** 2, 0.01)
        missing = position - x[:3]
        H = np.eye(3, ERRORS)
        N = far**2 * np.eye(3)
        if self.body_frame:
            # The reading is turned by the true yaw and its noise, and turned back by the predicted yaw.
            across = np.array([-position[1], position[0], 0.0])
            H[:, 3:6] = -np.outer(across, turning)
            return missing, H, N + turn**2 * np.outer(across, across)
        own = np.zeros((1, ERRORS))
        own[0, 3:6] = turning
        N = np.diag([*np.diag(N), turn**2])
        off = float(wrap(np.asarray(yaw - float(frames.yaw(x[3:7])))))
        return np.append(missing, off), np.concatenate([H, own]), N

    def _moved(self, i: int) -> Floats:
        """Return the displacement (3,) in m of row i's reference in one step."""
        way = self.target[i]
        if self._with_vehicle:
            along = way / max(float(np.linalg.norm(way)), 1e-6)
            x = self.state[i]
            way = along * float(along @ to_world(x[3:7], x[7:10]))
        return np.asarray(way * self.dt)


def prediction(model: SymbolicModel, duration: float, substeps: int) -> Direct:
    """Return the function (state, input, current) -> (state after `duration` s, Jacobian (15, 15) of the
    errors after the step with respect to the errors before it).
    """
    ca = require()
    x, u, c = ca.SX.sym("x", model.n_x), ca.SX.sym("u", model.n_u), ca.SX.sym("c", 3)
    error = ca.SX.sym("e", ERRORS)
    step = model.step(duration, substeps)
    moved = ca.vertcat(
        x[:3] + error[:3],
        _product(ca, x[3:7], ca.vertcat(1.0, 0.5 * error[3:6])),
        x[7:13] + error[6:12],
        x[RIGID:],
    )
    after, off = step(x, u, c), step(moved, u, c + error[12:])
    back = ca.vertcat(after[3], -after[4:7])
    turn = 2.0 * _product(ca, back, off[3:7])[1:]
    errors = ca.vertcat(off[:3] - after[:3], turn, off[7:13] - after[7:13], error[12:])
    slope = ca.substitute(ca.jacobian(errors, error), error, ca.SX.zeros(ERRORS))
    outputs = [ca.densify(after), ca.densify(slope)]
    return Direct(ca.Function("prediction", [x, u, c], outputs, {"cse": True}))


def _product(ca: Any, p: Any, q: Any) -> Any:
    """Return the product (4,) of two quaternions (w, x, y, z), CasADi expressions."""
    vector = p[0] * q[1:] + q[0] * p[1:] + ca.cross(p[1:], q[1:])
    return ca.vertcat(p[0] * q[0] - ca.dot(p[1:], q[1:]), vector)


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
    """Return the standard deviation of uniform noise with magnitudes in [low, high] and random sign; at least `SMALLEST_NOISE`."""
    low, high = span.low * config.noise.scale, span.high * config.noise.scale
    return max(float(np.sqrt((low * low + low * high + high * high) / 3.0)), SMALLEST_NOISE)
