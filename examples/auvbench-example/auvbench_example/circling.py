"""A task: circle a pole with the bow, which has the camera, towards the pole."""

import math
from dataclasses import dataclass

from auvbench.plugin import ERRORS, TaskConfig, TaskSpec, column, number
from auvbench.tasks.base import TrackingTask
from auvbench.tasks.rows import (
    COLLISION,
    GOES_ON,
    OUT_OF_BOUNDS,
    SUCCESS,
    TIMEOUT,
    add_errors,
    drawn,
    leaves_water,
    put,
    row,
    start_in_ball,
    triple,
    wrap,
    yaw,
)


@dataclass(kw_only=True)
class CirclingConfig(TaskConfig):
    """Types and ranges of the keys of conf/task/circling.yaml."""

    centre: list[float]
    radius: float = number(0.0, 1e3, open_low=True)  # m
    speed: float = number(0.0, 10.0)  # m/s
    thickness: float = number(0.0, 1e3)  # m
    start_radius: float = number(0.0, 1e3)  # m
    tolerance: float = number(0.0, 1e3, open_low=True)  # m
    field_of_view: float = number(0.0, math.pi, open_low=True)  # rad
    share: float = number(0.0, 1.0)


SPEC = TaskSpec(
    name="circling",
    title="circling a pole",
    factory="auvbench_example.circling:CirclingTask",
    primary="mean_in_view",
    blocks=ERRORS,
    outcomes=("success", "collision", "timeout", "out_of_bounds"),
    rewards=("view", "tracking"),
    schema=CirclingConfig,
    metrics=(
        column(
            "in_view",
            "",
            "share in view",
            "share of the time limit with the pole in view",
            "higher",
            high=1.0,
            counts_failures=True,
        ),
        column("closest_m", "m", "closest", "least distance to the axis of the pole", "higher"),
    ),
)


@row
def follow(e, time, p):
    """Write the reference at a time in s: a point on the circle, the yaw towards the pole, and the velocity."""
    x, y, z = triple(p.centre)
    rate = e.turn * (p.speed / p.radius)
    angle = e.angle + rate * time
    c, s, speed = math.cos(angle), math.sin(angle), rate * p.radius
    put(e.reference, (x + p.radius * c, y + p.radius * s, z))
    put(e.reference_velocity, (-speed * s, speed * c, 0.0))
    e.reference_yaw = wrap(angle + math.pi)


@row
def draw(e, p, stream):
    """Draw a point on the circle, the direction of travel and the start near the point; return the yaw at the start."""
    place, way, heading, _ = drawn(e, stream, 0)
    u, v, w, _ = drawn(e, stream, 1)
    e.angle = 2.0 * math.pi * place
    e.turn = 1.0 if way < 0.5 else -1.0
    e.closest = p.radius + p.bounds
    follow(e, 0.0, p)
    start_in_ball(e, p.start_radius, p, u, v, w)
    return wrap(2.0 * math.pi * heading)


@row
def refer(e, v, p):
    """Move the reference to the present time."""
    follow(e, e.steps * p.duration, p)


@row
def step(e, v, p):
    """Return how the episode ends, or GOES_ON."""
    (x, y, _), (pole_x, pole_y, _) = v.position, triple(p.centre)
    dx, dy = pole_x - x, pole_y - y
    away = math.sqrt(dx * dx + dy * dy)
    off = abs(wrap(math.atan2(dy, dx) - yaw(v)))  # angle between the pole and the bow
    if off < p.field_of_view and e.distance < p.tolerance:
        e.seen += 1.0
    e.closest = min(e.closest, away)
    add_errors(e)
    if leaves_water(v, p) or away < p.thickness:
        return COLLISION
    if e.distance > p.bounds:
        return OUT_OF_BOUNDS
    if e.steps >= p.max_steps:
        return SUCCESS if e.seen >= p.share * p.max_steps else TIMEOUT
    return GOES_ON


class CirclingTask(TrackingTask):
    """The circling task for N episodes."""

    draw = staticmethod(draw)
    refer = staticmethod(refer)
    step = staticmethod(step)
    fields = (
        ("angle", "f8"),  # rad, point on the circle where the episode begins
        ("turn", "f8"),  # direction of travel: 1 counter-clockwise, -1 clockwise
        ("seen", "f8"),  # steps with the pole in view
        ("closest", "f8"),  # m, smallest distance to the pole's axis
    )
    success_ends = False  # an episode continues after it meets the condition of success

    def own_metrics(self, i):
        """Return the task's columns of the record of environment i when its episode has ended."""
        e, p = self.episodes[i], self.parameters[0]
        in_view = e.seen / p.max_steps  # after an early end the pole counts as out of view
        return {**self.errors(i, p.bounds), "in_view": in_view, "closest_m": e.closest}
