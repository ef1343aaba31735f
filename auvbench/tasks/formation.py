"""Formation: each vehicle of a team follows its slot beside a leader's reference (docs/teams.md).

The vehicles of a team are consecutive rows of the batch. They share the episode's seed and number. A vehicle's counter `environment`
is the team's counter plus the vehicle's index times `rows.VEHICLE`. Draws for the whole team use the team's counter, and draws for one
vehicle use the vehicle's counter.

Vehicles act on each other only through collisions and messages. `meet` judges a team before the loop over its vehicles, so that
all vehicles end together; `exchange` passes messages before the vehicles observe.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from auvbench import metrics
from auvbench.config.ranges import SOUND
from auvbench.config.tasks.formation import MOST, Formation
from auvbench.dynamics.compiled import borrowed, compiled
from auvbench.dynamics.random import SENSOR, uniform4
from auvbench.dynamics.vectors import add, product, rotation_matrix
from auvbench.errors import ConfigError
from auvbench.metrics import Totals
from auvbench.record import Record as Row
from auvbench.tasks import fingerprint, records, trajectory_tracking
from auvbench.tasks.base import Floats, Integers
from auvbench.tasks.records import Record
from auvbench.tasks.rows import (
    COLLISION,
    GOES_ON,
    OUT_OF_BOUNDS,
    SUCCESS,
    VEHICLE,
    Vehicle,
    add_errors,
    between,
    drawn,
    misses,
    noise,
    put,
    quaternion,
    row,
    start_in_ball,
    team_of,
    triple,
    wrap,
)
from auvbench.tasks.trajectory_tracking import (
    CURVES,
    SINES,
    SMOOTH,
    TrajectoryTrackingTask,
    X,
    Y,
    Z,
    follow,
    place,
    slope,
)

SOON = 1e-9
"""Tolerance for times that rounding puts on the wrong side of a step, s"""
AVERAGED = (
    *("reward", "initial_distance", "distance", "deviation", "deviation_squared", "command_norm"),
    *("energy", "path", "change"),
)
"""Totals of a team that are means over its vehicles"""
draw_curve_and_start = trajectory_tracking.draw


@row
def bend(e: Record, s: float, axis: int) -> float:
    """Return the second derivative of the leader's curve with respect to s."""
    a = 0.0
    for j in range(SINES):
        w = e.frequency[axis, j]
        a -= e.amplitude[axis, j] * w * w * math.sin(w * s + e.phase[axis, j])
    return float(a)


@row
def lead(e: Record, time: float) -> tuple[float, float, float]:
    """Set the reference to the leader's reference at `time` s; return cosine, sine and rate of change (rad/s) of the leader's course."""
    follow(e, time)
    vx, vy, _ = triple(e.reference_velocity)
    s, squared = e.rate * time, max(vx * vx + vy * vy, 1e-12)
    level = math.sqrt(squared)
    turning = e.rate * e.rate * (vx * bend(e, s, Y) - vy * bend(e, s, X)) / squared
    return vx / level, vy / level, turning


@row
def take_slot(e: Record, c: float, s: float, turning: float) -> None:
    """Move the leader's reference to the vehicle's slot, which turns with the leader's course."""
    (forward, port, up), (x, y, z), (vx, vy, vz) = (
        triple(e.slot),
        triple(e.reference),
        triple(e.reference_velocity),
    )
    away_x, away_y = c * forward - s * port, s * forward + c * port
    put(e.reference, (x + away_x, y + away_y, z + up))
    put(e.reference_velocity, (vx - turning * away_y, vy + turning * away_x, vz))


@row
def ahead(e: Record, s: float) -> tuple[float, float, float, float, float]:
    """Return the leader's position (m) at the curve's parameter s, and the cosine and sine of the leader's course."""
    vx, vy = slope(e, s, X), slope(e, s, Y)
    level = math.sqrt(max(vx * vx + vy * vy, 1e-12))
    return place(e, s, X), place(e, s, Y), place(e, s, Z), vx / level, vy / level


@row
def put_ahead(e: Record, at: tuple[float, float, float, float, float], point: Floats) -> None:
    """Write the position (3,) in m of the vehicle's slot; `at` is the leader's position and course from `ahead`."""
    (x, y, z, c, s), (forward, port, up) = at, triple(e.slot)
    put(point, (x + (c * forward - s * port), y + (s * forward + c * port), z + up))


@row
def preview_row(e: Record, p: Record, points: Floats) -> None:
    """Write the future positions of the slot, unless `meet` has written them for this step."""
    if e.met == e.steps:
        return
    for k in range(points.shape[0]):
        s = e.rate * (e.steps * p.duration + (k + 1) * p.preview_interval)
        put_ahead(e, ahead(e, s), points[k])


@row
def draw(e: Record, p: Record, stream: int) -> float:
    """Draw the team's curve and the vehicle's start near its slot; return the yaw at the start."""
    own = e.environment
    e.environment = team_of(own)
    draw_curve_and_start(e, p, stream)
    e.environment = own
    e.vehicle = own // VEHICLE
    put(e.slot, triple(p.slots[e.vehicle]))
    c, s, turning = lead(e, 0.0)
    take_slot(e, c, s, turning)
    turned, u, v, w = drawn(e, stream, 0)
    start_in_ball(e, p.start_radius, p, u, v, w)
    e.met = -1
    e.separation = math.inf
    return wrap(e.reference_yaw + p.start_yaw * (2.0 * turned - 1.0))


@row
def refer(e: Record, v: Vehicle, p: Record) -> None:
    """Move the reference to the present time, unless `meet` has moved it."""
    if e.met != e.steps:
        c, s, turning = lead(e, e.steps * p.duration)
        take_slot(e, c, s, turning)


@row
def step(e: Record, v: Vehicle, p: Record) -> int:
    """Return the outcome of the team's agent step, or GOES_ON."""
    add_errors(e)
    return int(e.ends)


@compiled("dynamics", ".")
def meet(first: int, stop: int, pose: Floats, episodes: Any, preview: Floats, parameters: Any) -> None:
    """Update references, previews, separations and outcomes of the teams in rows first .. stop - 1.

    Call this function before the loop over the vehicles, in which `e.steps` increases.
    """
    p = parameters[0]
    n, pose, preview = p.vehicles, borrowed(pose), borrowed(preview)
    for start in range(first, stop, n):
        leader = episodes[start]
        now = leader.steps + 1
        c, s, turning = lead(leader, now * p.duration)
        for i in range(start + 1, start + n):
            put(episodes[i].reference, triple(leader.reference))
            put(episodes[i].reference_velocity, triple(leader.reference_velocity))
            episodes[i].reference_yaw = leader.reference_yaw
        for k in range(preview.shape[1]):
            at = ahead(leader, leader.rate * (now * p.duration + (k + 1) * p.preview_interval))
            for i in range(start, start + n):
                put_ahead(episodes[i], at, preview[i, k])
        ends = SUCCESS if now >= p.max_steps else GOES_ON
        for i in range(start, start + n):
            e = episodes[i]
            take_slot(e, c, s, turning)
            e.met = now
            (x, y, z), (to_x, to_y, to_z) = triple(pose[i]), triple(e.reference)
            _, qx, qy, _ = quaternion(pose[i])
            tipped = 1.0 - 2.0 * (qx**2 + qy**2) < p.most_tilt
            put(e.error, (x - to_x, y - to_y, z - to_z))
            if z < p.depth_low or z > p.depth_high:
                ends = COLLISION
            elif ends != COLLISION and (tipped or between(triple(e.error), (0.0, 0.0, 0.0)) > p.bounds):
                ends = OUT_OF_BOUNDS
        for i in range(start, start + n):
            a = episodes[i]
            for j in range(i + 1, start + n):
                b = episodes[j]
                off = between(triple(a.error), triple(b.error))
                a.edges[j - start] += off * off
                apart = between(triple(pose[i]), triple(pose[j]))
                leader.separation = min(leader.separation, apart)
                if apart < 2.0 * p.radius:
                    leader.collided = 1
                    ends = COLLISION
        for i in range(start, start + n):
            episodes[i].ends = ends


@row
def say(e: Record, p: Record, pose: Floats, velocity: Floats, offset: Floats, stream: int) -> None:
    """Write the vehicle's message: its measured position (m) and velocity (m/s), world axes, with the same errors as its observation."""
    x, y, z = add(triple(pose), triple(offset))
    if p.position_noise_high > 0.0:
        a, b, c, _ = uniform4(e.seed, SENSOR | stream, 0, e.steps, e.episode, e.environment)
        low, high, both = p.position_noise_low, p.position_noise_high, p.both_signs > 0
        x, y, z = x + noise(a, low, high, both), y + noise(b, low, high, both), z + noise(c, low, high, both)
    put(e.said, (x, y, z))
    put(e.said[3:], product(rotation_matrix(quaternion(pose)), triple(velocity)))


@row
def hear(e: Record, other: Record, j: int, time: float) -> None:
    """Store the message that vehicle j sent at a time in s."""
    for k in range(6):
        e.heard[j, k] = other.said[k]
    e.heard_at[j] = time


@compiled("dynamics", ".")
def exchange(
    firsts: Integers,
    pose: Floats,
    velocity: Floats,
    offset: Floats,
    true: Any,
    episodes: Any,
    parameters: Any,
    stream: int,
) -> None:
    """Pass the messages of the present step within teams.

    The vehicles of a team take turns: each vehicle sends a message every `vehicles` turns. The message contains the vehicle's readings at
    the last step before the turn begins. The message arrives after the transmission time and the travel time of the sound. At the start of
    an episode, each vehicle knows the readings of all other vehicles.

    Args:
        firsts: rows of the first vehicle of each team.
        pose: (n, 7) measured poses.
        velocity: (n, 6) measured velocities.
        offset: (n, 4) errors of the readings.
        true: (n,) episodes with the true positions.
        episodes: (n,) episodes as the vehicles believe them to be.
        parameters: (1,) parameters of the task.
        stream: flag of the random streams.
    """
    p = parameters[0]
    n = p.vehicles
    pose, velocity, offset = borrowed(pose), borrowed(velocity), borrowed(offset)
    for k in range(firsts.shape[0]):
        start = firsts[k]
        now = episodes[start].steps * p.duration
        begins = episodes[start].steps == 0
        for i in range(start, start + n):
            e = episodes[i]
            for j in range(n):
                other = episodes[start + j]
                if start + j == i or begins or p.ideal > 0 or other.said_at <= e.heard_at[j]:
                    continue
                way = between(triple(true[i].position), triple(true[start + j].position))
                if other.said_at + p.transmission + way / p.sound_speed > now + SOON:
                    continue
                turn = math.floor(other.said_at / p.turn_time + 0.5)
                if not misses(e, p, j, turn, stream):
                    hear(e, other, j, other.said_at)
        next_turn = math.ceil((now - SOON) / p.turn_time)
        for i in range(start, start + n):
            e = episodes[i]
            if begins:
                e.said_at = -1.0
            turn = next_turn + (i - start - next_turn) % n
            speaks = turn * p.turn_time < now + p.duration - SOON
            if begins or p.ideal > 0 or speaks:
                say(e, p, pose[i], velocity[i], offset[i], stream)
            if speaks:
                e.said_at = turn * p.turn_time
        for i in range(start, start + n):
            e = episodes[i]
            for j in range(n):
                if start + j == i:
                    continue
                if begins or p.ideal > 0:
                    hear(e, episodes[start + j], j, now)
                e.age_sum += now - e.heard_at[j]


class FormationTask(TrajectoryTrackingTask):
    """N vehicles, in teams of `task.vehicles`."""

    draw = staticmethod(draw)
    refer = staticmethod(refer)
    step = staticmethod(step)
    preview_row = staticmethod(preview_row)
    fields = (
        *TrajectoryTrackingTask.fields,
        ("vehicle", "i8"),  # index in the team
        ("slot", "f8", (3,)),  # m, axes of the leader's reference
        ("met", "i8"),  # number of the last step that `meet` has judged
        ("ends", "i8"),  # outcome of the team
        ("error", "f8", (3,)),  # m, position minus reference
        (
            "edges",
            "f8",
            (MOST,),
        ),  # m^2, for each later vehicle of the team: sum of squared errors of the position relative to that vehicle
        ("separation", "f8"),  # m, smallest distance between two vehicles so far; in the first row of a team
        ("collided", "i8"),  # 1: two vehicles collided; in the first row of a team
        ("said", "f8", (6,)),  # m and m/s, world axes: position and velocity in the vehicle's last message
        ("said_at", "f8"),  # s, time at which the sending of the last message began; -1: never
        ("heard", "f8", (MOST, 6)),  # last message that arrived from each vehicle
        ("heard_at", "f8", (MOST,)),  # s, sending time of each message in `heard`
        ("age_sum", "f8"),  # s, sum of the ages of the messages over steps and vehicles
    )
    transient = ("ends", "error", "said", "said_at", "heard", "heard_at", "age_sum", "separation")
    taken = ("_true", "_told", "_own")
    reference_columns = (
        *fingerprint.COLUMNS,
        "position_error_rms_m",
        "yaw_error_rms_rad",
        "formation_error_rms_m",
        "worst_edge_rms_m",
        "separation_min_m",
        "vehicles_collided",
        "message_age_s",
    )
    reference_blocks = (*fingerprint.BLOCKS, "slot", "messages")

    def _take(self, *, interpreted: bool) -> None:
        super()._take(interpreted=interpreted)
        believed = self.episodes if self.believed is None else self.believed
        self._true, self._told, self._own = map(records.plain, (self.episodes, believed, self.parameters))

    def own_parameters(self, task: Any) -> dict[str, Any]:
        assert isinstance(task, Formation)
        slots = np.zeros((MOST, 3))
        slots[: task.vehicles] = task.places
        return {
            **records.of_schema(replace(task, slots=[])),
            "slots": slots,
            "curve": CURVES.index(task.curve),
            "kinds": float(SMOOTH),
            "most_tilt": math.cos(task.tilt),
            "ideal": task.messages == "ideal",
            "transmission": task.transmission,
            "sound_speed": SOUND,
            "turn_time": task.turn_time,
        }

    def reset(self, indices: Integers) -> Floats:
        whole = indices.reshape(-1, self.team) if len(indices) % self.team == 0 else np.empty((0, self.team))
        if not len(whole) or (whole != whole[:, :1] // self.team * self.team + np.arange(self.team)).any():
            raise ConfigError(
                f"task.vehicles={self.team}: the vehicles of a team begin together; reset whole teams"
            )
        return super().reset(indices)

    def step_rows(self, start: int, stop: int, *motion: Floats) -> int:
        meet(start, stop, motion[0], self._true, self.preview, self._own)
        return super().step_rows(start, stop, *motion)

    def observe(
        self,
        pose: Floats,
        velocity: Floats,
        indices: Integers | None = None,
        seats: Floats | None = None,
    ) -> Any:
        if self.team > 1:
            firsts = (self._all if indices is None else indices)[:: self.team]
            exchange(firsts, pose, velocity, self.offset, self._true, self._told, self._own, self.stream)
        return super().observe(pose, velocity, indices, seats)

    def records(self, indices: Integers) -> list[Row]:
        """Return a record for each vehicle whose episode just ended: the record of the vehicle's team."""
        firsts = indices[:: self.team].tolist()
        return [record for first in firsts for record in [self._counted(self.measured(first))] * self.team]

    def own_metrics(self, i: int) -> dict[str, float]:
        return self.errors(i, self.limits["bounds"])

    def _totals(self, i: int) -> Totals:
        """Return the totals of a team: means over its vehicles, the smallest depth margin, start and goal of its first vehicle."""
        first = i - i % self.team
        each = [super(FormationTask, self)._totals(k) for k in range(first, first + self.team)]
        means: dict[str, Any] = {
            name: float(np.mean([getattr(totals, name) for totals in each])) for name in AVERAGED
        }
        own = {
            name: value
            if name in metrics.POINTS or isinstance(value, str)
            else float(np.mean([totals.own[name] for totals in each]))
            for name, value in each[0].own.items()
        }
        least = min(totals.depth_margin for totals in each)
        return each[0]._replace(**means, depth_margin=least, own={**own, **self._of_team(first)})

    def _of_team(self, first: int) -> dict[str, float]:
        """Return the columns that only a team has."""
        n, e = self.team, self.episodes[first : first + self.team]
        steps = max(float(e.steps[0]), 1.0)
        pairs = [e.edges[i, j] / steps for i in range(n) for j in range(i + 1, n)]
        told = self._told[first : first + n]["age_sum"]
        return {
            "formation_error_rms_m": math.sqrt(np.mean(pairs)) if pairs else 0.0,
            "worst_edge_rms_m": math.sqrt(max(pairs)) if pairs else 0.0,
            "separation_min_m": float(e.separation[0]) if pairs else 0.0,
            "vehicles_collided": float(e.collided[0]),
            "message_age_s": float(np.sum(told)) / (n * (n - 1) * steps) if pairs else 0.0,
        }
