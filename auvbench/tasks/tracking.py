"""Target tracking: follow a moving target to which the vehicle measures only acoustic ranges (docs/moving-targets.md).

The target is a point on a curve of `trajectory_tracking`. The true reference, for rewards and metrics, circles round the true target;
the reference that agents observe circles in the same way round the estimated position of the target. Ranges from a circling vehicle
determine the target's position in all directions (Masmitja et al., "Dynamic robotic tracking of underwater targets using reinforcement
learning", Science Robotics 8, 2023).

The estimator is a second-order extended Kalman filter with a target of nearly constant velocity (Bar-Shalom, Li and Kirubarajan,
"Estimation with applications to tracking and navigation", 2001, sections 6.2 and 10.3).
"""

from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np

from auvbench.blocks import PINGS
from auvbench.config.ranges import SOUND
from auvbench.config.tasks.tracking import PRIOR_SDS, TargetTracking
from auvbench.dynamics.compiled import borrowed, compiled
from auvbench.dynamics.random import MESSAGE, SENSOR, normal4, uniform4
from auvbench.dynamics.vectors import add
from auvbench.tasks import fingerprint, records, trajectory_tracking
from auvbench.tasks.base import Floats, Integers, Task
from auvbench.tasks.formation import SOON
from auvbench.tasks.records import Record
from auvbench.tasks.rows import (
    COLLISION,
    GOES_ON,
    OUT_OF_BOUNDS,
    SUCCESS,
    Vector,
    Vehicle,
    add_errors,
    between,
    drawn,
    leaves_water,
    noise,
    put,
    row,
    start_in_ball,
    triple,
    wrap,
)
from auvbench.tasks.trajectory_tracking import (
    SMOOTH,
    TrajectoryTrackingTask,
    X,
    Y,
    Z,
    follow,
    place,
)

draw_curve_and_start = trajectory_tracking.draw

STATES = 4
"""Number of states of the estimator: horizontal position (m) and horizontal velocity (m/s) of the target"""


@row
def circle(e: Record, time: float, p: Record, target: Vector, velocity: Vector) -> None:
    """Set the reference to a point that circles round a target with a position (m) and a velocity (m/s); its yaw points to the target."""
    (x, y, z), (vx, vy, vz) = target, velocity
    angle = e.angle + p.orbit_speed / p.orbit * time
    c, s = math.cos(angle), math.sin(angle)
    put(e.reference, (x + p.orbit * c, y + p.orbit * s, z))
    put(e.reference_velocity, (vx - p.orbit_speed * s, vy + p.orbit_speed * c, vz))
    e.reference_yaw = wrap(angle + math.pi)


@row
def move(e: Record, p: Record) -> None:
    """Move the target and the true reference to the present time."""
    time = e.steps * p.duration
    follow(e, time)
    put(e.target, triple(e.reference))
    circle(e, time, p, triple(e.reference), triple(e.reference_velocity))


@row
def prior_errors(e: Record, p: Record, stream: int) -> tuple[float, float]:
    """Return the east and north errors in m of the vehicle's first estimate of the target's position.

    The errors are normal. Their vector is shortened to PRIOR_SDS standard deviations, so that no episode starts in a collision.
    """
    _, east, north, _ = normal4(e.seed, MESSAGE | stream, 0, 0, e.episode, e.environment)
    size = p.prior * min(1.0, PRIOR_SDS / max(math.hypot(east, north), 1e-9))
    return size * east, size * north


@row
def draw(e: Record, p: Record, stream: int) -> float:
    """Draw the curve and the speed of the target, the start of the circle and of the vehicle; return the yaw at the start."""
    draw_curve_and_start(e, p, stream)
    turned, u, v, w = drawn(e, stream, 0)
    _, _, _, bearing = drawn(e, stream, 1)
    e.angle = 2.0 * math.pi * bearing
    # A start on the circle round the true target would reveal the target's position.
    (x, y, z), (east, north) = triple(e.reference), prior_errors(e, p, stream)
    circle(e, 0.0, p, (x + east, y + north, z), triple(e.reference_velocity))
    start_in_ball(e, p.start_radius, p, u, v, w)
    move(e, p)
    return wrap(e.reference_yaw + p.start_yaw * (2.0 * turned - 1.0))


@row
def refer(e: Record, v: Vehicle, p: Record) -> None:
    """Move the target and the true reference to the present time."""
    move(e, p)


@row
def step(e: Record, v: Vehicle, p: Record) -> int:
    """Return the outcome of an agent step, or GOES_ON."""
    add_errors(e)
    away = between(v.position, triple(e.target))
    e.farthest = max(e.farthest, away)
    if leaves_water(v, p) or away < p.clearance:
        return COLLISION
    if away > p.bounds:
        return OUT_OF_BOUNDS
    if e.steps >= p.max_steps:
        return SUCCESS
    return GOES_ON


@row
def begin_estimate(b: Record, p: Record, target: Vector, east: float, north: float) -> None:
    """Begin the estimate of a target that is at `target` (m); `east` and `north` are the results of `prior_errors` (m)."""
    x, y, z = target
    b.estimate[0], b.estimate[1] = x + east, y + north
    b.depth = z
    for axis in range(2):
        b.covariance[axis, axis] = p.prior * p.prior
        b.covariance[axis + 2, axis + 2] = 0.5 * p.speed_high * p.speed_high


@row
def predict(b: Record, dt: float, q: float) -> None:
    """Predict an estimate `dt` s ahead: x' = F x, P' = F P F^T + Q, with an acceleration of spectral density q in m^2/s^3."""
    P = b.covariance
    for axis in range(2):
        b.estimate[axis] += b.estimate[axis + 2] * dt
    for axis in range(2):
        for j in range(STATES):
            P[axis, j] += dt * P[axis + 2, j]
    for axis in range(2):
        for i in range(STATES):
            P[i, axis] += dt * P[i, axis + 2]
    for axis in range(2):
        P[axis, axis] += q * dt * dt * dt / 3.0
        P[axis, axis + 2] += 0.5 * q * dt * dt
        P[axis + 2, axis] += 0.5 * q * dt * dt
        P[axis + 2, axis + 2] += q * dt


@row
def gain(b: Record, i: int, ux: float, uy: float, late: float) -> float:
    """Return row i of P H^T for a range along (ux, uy) to the target's position `late` s ago."""
    P = b.covariance
    return float(ux * (P[i, 0] - late * P[i, 2]) + uy * (P[i, 1] - late * P[i, 3]))


@row
def correct(b: Record, here: Vector, distance: float, late: float, variance: float) -> None:
    """Correct an estimate by a range.

    Args:
        b: believed episode with the estimate.
        here: position of the vehicle, which hears the ping now, m.
        distance: range to the target's position at the time of sending, m.
        late: time since sending, s.
        variance: variance of the range, m^2.
    """
    x, y, z = here
    P = b.covariance
    dx, dy = b.estimate[0] - late * b.estimate[2] - x, b.estimate[1] - late * b.estimate[3] - y
    dz = b.depth - z
    h = max(math.sqrt(dx * dx + dy * dy + dz * dz), 1e-3)
    ux, uy = dx / h, dy / h
    g0, g1 = gain(b, 0, ux, uy, late), gain(b, 1, ux, uy, late)
    g2, g3 = gain(b, 2, ux, uy, late), gain(b, 3, ux, uy, late)
    # Second-order terms: half the traces of M and M M, with M the Hessian of the range times the position's covariance.
    xx = P[0, 0] - 2.0 * late * P[0, 2] + late * late * P[2, 2]
    yy = P[1, 1] - 2.0 * late * P[1, 3] + late * late * P[3, 3]
    xy = P[0, 1] - late * (P[0, 3] + P[1, 2]) + late * late * P[2, 3]
    a, o, d = (1.0 - ux * ux) / h, -ux * uy / h, (1.0 - uy * uy) / h
    m00, m01, m10, m11 = a * xx + o * xy, a * xy + o * yy, o * xx + d * xy, o * xy + d * yy
    bent = 0.5 * (m00 + m11)
    spread = 0.5 * (m00 * m00 + 2.0 * m01 * m10 + m11 * m11)
    s = ux * (g0 - late * g2) + uy * (g1 - late * g3) + spread + variance
    wrong = (distance - h - bent) / s
    gains = (g0, g1, g2, g3)
    for i in range(STATES):
        b.estimate[i] += gains[i] * wrong
    for i in range(STATES):
        for j in range(STATES):
            P[i, j] -= gains[i] * gains[j] / s


@row
def remember(b: Record, k: int, here: Vector, distance: float, sent: float) -> None:
    """Store ping k, which the vehicle heard at `here` (m), with its range in m and its sending time in s."""
    x, y, z = here
    b.pings[k, 0], b.pings[k, 1], b.pings[k, 2] = x, y, b.depth - z
    b.pings[k, 3], b.pings[k, 4] = distance, sent


@row
def stay_within(b: Record, here: Vector, most: float) -> None:
    """Keep the estimated target within `most` m, horizontally, of `here`, because a farther target would have ended the episode."""
    x, y, _ = here
    dx, dy = b.estimate[0] - x, b.estimate[1] - y
    away = math.sqrt(dx * dx + dy * dy)
    if away > most:
        b.estimate[0], b.estimate[1] = x + dx * (most / away), y + dy * (most / away)


@row
def measured_place(e: Record, p: Record, pose: Floats, offset: Floats, stream: int) -> Vector:
    """Return the position in m that the observation shows: measured position plus the errors of its reading plus noise."""
    here = add(triple(pose), triple(offset))
    if p.position_noise_high > 0.0:
        ux, uy, uz, _ = uniform4(e.seed, SENSOR | stream, 0, e.steps, e.episode, e.environment)
        low, high, both = p.position_noise_low, p.position_noise_high, p.both_signs > 0
        here = add(here, (noise(ux, low, high, both), noise(uy, low, high, both), noise(uz, low, high, both)))
    return here


@row
def hear(
    e: Record,
    b: Record,
    p: Record,
    here: Vector,
    source: Vector,
    way: float,
    sent: float,
    now: float,
    stream: int,
) -> None:
    """Store the ping that arrives at `here` (m) and correct the estimate, unless the ping is lost.

    The target sent the ping from `source` (m), `way` m away, at the time `sent` in s. The first ping of an episode is never lost, and
    begins the estimate.
    """
    error, _, _, _ = normal4(e.seed, MESSAGE | stream, 0, b.next_ping, e.episode, e.environment)
    chance, _, _, _ = uniform4(e.seed, MESSAGE | stream, 1, b.next_ping, e.episode, e.environment)
    distance = max(way + p.range_noise * error, 0.0)
    begins = e.steps == 0
    if begins:
        east, north = prior_errors(e, p, stream)
        begin_estimate(b, p, source, east, north)
        for k in range(len(b.pings)):
            remember(b, k, here, distance, now)
    elif chance >= p.message_loss:
        for k in range(len(b.pings) - 1, 0, -1):
            for j in range(5):
                b.pings[k, j] = b.pings[k - 1, j]
        _, _, b.depth = source
        remember(b, 0, here, distance, sent)
    if begins or chance >= p.message_loss:
        # The variance of the range includes the noise of the vehicle's position reading, but not the reading's bias and drift.
        variance = p.range_noise * p.range_noise + p.position_noise_high * p.position_noise_high
        correct(b, here, distance, now - sent, variance)
    b.next_ping += 1


@compiled("dynamics", ".")
def listen(
    rows: Integers, pose: Floats, offset: Floats, true: Any, believed: Any, parameters: Any, stream: int
) -> None:
    """Let vehicles hear the target, update their estimates of the target's position and move their believed references.

    The target sends ping k at k `ping_interval`. The ping arrives after the transmission time and the travel time of the sound. Clocks are
    synchronous, so that the travel time gives the range. At the start of an episode, a ping arrives at once.

    Args:
        rows: environments (k,).
        pose: (n, 7) measured poses.
        offset: (n, 4) errors of the readings.
        true: (n,) episodes with the true positions.
        believed: (n,) episodes as the vehicles believe them to be.
        parameters: (1,) parameters of the task.
        stream: flag of the random streams.
    """
    p = parameters[0]
    pose, offset = borrowed(pose), borrowed(offset)
    for n in range(rows.shape[0]):
        i = rows[n]
        e, b = true[i], believed[i]
        here = measured_place(e, p, pose[i], offset[i], stream)
        now = e.steps * p.duration
        b.steps = e.steps
        begins = e.steps == 0
        if not begins:
            predict(b, p.duration, p.agility)
        sent = b.next_ping * p.ping_interval
        phase = e.rate * sent
        source = (place(e, phase, X), place(e, phase, Y), place(e, phase, Z))
        way = between(triple(e.position), source)
        if begins or sent + p.transmission + way / p.sound_speed <= now + SOON:
            hear(e, b, p, here, source, way, sent, now, stream)
        stay_within(b, here, p.bounds)
        guess = (b.estimate[0], b.estimate[1], b.depth)
        circle(b, now, p, guess, (b.estimate[2], b.estimate[3], 0.0))
        if not begins:
            error = between(guess, triple(e.target))
            b.miss_squared_sum += error * error


class TargetTrackingTask(TrajectoryTrackingTask):
    """N episodes of target tracking."""

    draw = staticmethod(draw)
    refer = staticmethod(refer)
    step = staticmethod(step)
    hidden = True
    fields = (
        *TrajectoryTrackingTask.fields,
        ("angle", "f8"),  # rad, angle at which the circle round the target begins
        ("target", "f8", (3,)),  # m, true position of the target
        ("farthest", "f8"),  # m, largest distance to the target so far
        ("estimate", "f8", (STATES,)),  # m and m/s, estimated horizontal position and velocity of the target
        ("covariance", "f8", (STATES, STATES)),
        ("depth", "f8"),  # m, z of the target in the last ping
        # x, y (m), height of the target (m), range (m), time (s); the newest first
        ("pings", "f8", (PINGS, 5)),
        ("next_ping", "i8"),  # number of the next ping
        ("miss_squared_sum", "f8"),  # m^2, sum of the squared errors of the target's estimated position
    )
    transient = ("farthest", "estimate", "covariance", "depth", "pings", "miss_squared_sum")
    taken = ("_true", "_told", "_own")
    reference_columns: ClassVar[tuple[str, ...]] = (
        *fingerprint.COLUMNS,
        "position_error_rms_m",
        "yaw_error_rms_rad",
        "target_error_rms_m",
        "target_distance_max_m",
    )
    reference_blocks: ClassVar[tuple[str, ...]] = (*fingerprint.BLOCKS, "target", "pings")

    def _take(self, *, interpreted: bool) -> None:
        super()._take(interpreted=interpreted)
        self._true, self._told, self._own = map(
            records.plain, (self.episodes, self.believed, self.parameters)
        )

    def own_parameters(self, task: Any) -> dict[str, Any]:
        assert isinstance(task, TargetTracking)
        return {
            **super().own_parameters(task),
            "kinds": float(SMOOTH),
            "agility": task.agility,
            "transmission": task.transmission,
            "sound_speed": SOUND,
        }

    def begin_belief(self, indices: Integers) -> None:
        """Do nothing, because `observe` begins the believed episodes."""

    def move_belief(self, start: int, stop: int, *motion: Floats) -> None:
        """Do nothing, because `observe` moves the references of the believed episodes."""

    def observe(
        self,
        pose: Floats,
        velocity: Floats,
        indices: Integers | None = None,
        seats: Floats | None = None,
    ) -> Any:
        rows = self._all if indices is None else indices
        begun = rows[self.episodes.steps[rows] == 0]
        if len(begun):
            super().begin_belief(begun)
        listen(rows, pose, self.offset, self._true, self._told, self._own, self.stream)
        return super().observe(pose, velocity, indices, seats)

    def misplaced(self, i: int) -> str:
        p, e = self.parameters[0], self.episodes[i]
        away = float(np.linalg.norm(e.target - e.start))
        if away > p.bounds:
            return f"is {away:g} m from the target; must be at most task.bounds={p.bounds:g} m"
        if away < p.clearance:
            return f"is {away:g} m from the target; must be at least task.clearance={p.clearance:g} m"
        return Task.misplaced(self, i)

    def own_metrics(self, i: int) -> dict[str, float]:
        e, bounds = self.episodes[i], self.limits["bounds"]
        squared = float(self.believed[i].miss_squared_sum) / max(float(e.steps), 1.0)
        return {
            **self.errors(i, bounds),
            "target_error_rms_m": math.sqrt(squared),
            "target_distance_max_m": float(e.farthest),
        }
