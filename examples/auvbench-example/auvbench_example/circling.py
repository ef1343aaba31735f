"""A task: circle a pole and keep the bow, where the camera is, on it."""

import math
from dataclasses import dataclass

from numba import njit

from auvbench.dynamics.compiled import compiled
from auvbench.dynamics.random import SCENARIO, uniform4
from auvbench.plugin import ERRORS, TaskConfig, TaskSpec, column, number
from auvbench.tasks import kernels as k
from auvbench.tasks.base import TrackingTask
from auvbench.tasks.rewards import reward_row


@dataclass(kw_only=True)
class CirclingConfig(TaskConfig):
    """Types and ranges of what conf/task/circling.yaml says."""

    centre: list[float]
    radius: float = number(0.0, 1e3, open_low=True)  # m
    speed: float = number(0.0, 10.0)  # m/s
    thickness: float = number(0.0, 1e3)  # m
    start_radius: float = number(0.0, 1e3)  # m
    tolerance: float = number(0.0, 1e3, open_low=True)  # m
    view: float = number(0.0, math.pi, open_low=True)  # rad
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

ANGLE, TURN, SEEN, CLOSEST = range(k.F_OWN, k.F_OWN + 4)  # columns of F: rad, 1 or -1, steps, m
X, Y, Z, RADIUS, RATE, THICKNESS, START, BOUNDS, TOLERANCE, VIEW, SHARE = range(k.P_OWN, k.P_OWN + 11)


@njit(nogil=True)
def refer(i, time, F, P):
    """Write the reference at a time in s: a point of the circle, the yaw to the pole, the velocity."""
    angle = F[i, ANGLE] + F[i, TURN] * P[RATE] * time
    c, s, speed = math.cos(angle), math.sin(angle), F[i, TURN] * P[RATE] * P[RADIUS]
    F[i, k.F_REFERENCE] = P[X] + P[RADIUS] * c
    F[i, k.F_REFERENCE + 1] = P[Y] + P[RADIUS] * s
    F[i, k.F_REFERENCE + 2] = P[Z]
    F[i, k.F_REFERENCE_YAW] = k.wrap(angle + math.pi)
    F[i, k.F_REFERENCE_VELOCITY] = -speed * s
    F[i, k.F_REFERENCE_VELOCITY + 1] = speed * c
    F[i, k.F_REFERENCE_VELOCITY + 2] = 0.0


@compiled("dynamics", "tasks")
def draw(indices, F, C, P, test, pose):
    """Begin episodes: draw the place on the circle, the way round, and the start near it."""
    for row in range(indices.shape[0]):
        i = indices[row]
        key = C[i, k.C_EPISODE], C[i, k.C_ENVIRONMENT]
        u = uniform4(C[i, k.C_SEED], SCENARIO | test, 0, 0, *key)
        v = uniform4(C[i, k.C_SEED], SCENARIO | test, 1, 0, *key)
        F[i, ANGLE] = 2.0 * math.pi * u[0]
        F[i, TURN] = 1.0 if u[1] < 0.5 else -1.0
        F[i, SEEN], F[i, CLOSEST] = 0.0, P[RADIUS] + P[BOUNDS]
        refer(i, 0.0, F, P)
        k.ball_row(i, v[0], v[1], v[2], P[START], F, P)
        k.begin_row(i, row, k.wrap(2.0 * math.pi * u[2]), F, C, P, pose)


@compiled("dynamics", "tasks")
def advance(start, stop, pose, velocity, action, previous, force, power, F, C, P, reward, hook):
    """Compute rewards, ends and sums after one agent step; return how many episodes ended."""
    ended = 0
    for i in range(start, stop):
        C[i, k.C_STEPS] += 1
        refer(i, C[i, k.C_STEPS] * P[k.P_DURATION], F, P)
        distance = k.distance_row(i, pose, i, F)
        if not math.isfinite(distance):
            return -1 - i
        x, y, yaw = P[X] - pose[i, 0], P[Y] - pose[i, 1], k.yaw_row(i, pose)
        yaw_error = k.wrap(F[i, k.F_REFERENCE_YAW] - yaw)
        off = abs(k.wrap(math.atan2(y, x) - yaw))  # of the pole from the bow
        away = math.sqrt(x * x + y * y)
        if off < P[VIEW] and distance < P[TOLERANCE]:
            F[i, SEEN] += 1.0
        F[i, CLOSEST] = min(F[i, CLOSEST], away)
        k.add_errors_row(i, distance, yaw_error, F)
        outcome = -1
        if k.leaves_water(i, pose, P) or away < P[THICKNESS]:
            outcome = k.COLLISION
        elif distance > P[BOUNDS]:
            outcome = k.OUT_OF_BOUNDS
        elif C[i, k.C_STEPS] >= P[k.P_MAX_STEPS]:
            outcome = k.SUCCESS if F[i, SEEN] >= P[SHARE] * P[k.P_MAX_STEPS] else k.TIMEOUT
        r = reward_row(i, outcome, distance, yaw_error, pose, velocity, action, previous, F, P, hook)
        ended += k.end_row(i, outcome, r, distance, pose, action, previous, force, power, F, C, P, reward)
    return ended


class CirclingTask(TrackingTask):
    """N episodes of the task."""

    draw = staticmethod(draw)
    kernel = staticmethod(advance)
    own_floats = 4
    success_ends = False  # success is a property of the whole episode

    def own_parameters(self, task):
        """Return the entries of P from P_OWN on."""
        self.bounds = task.bounds
        circle = [*task.centre, task.radius, task.speed / task.radius]
        near = [task.thickness, task.start_radius, task.bounds]
        return [*circle, *near, task.tolerance, task.view, task.share]

    def own_metrics(self, i):
        """Return the columns of the record of environment i, whose episode has ended."""
        seen, closest = self.F[i, SEEN : CLOSEST + 1].tolist()
        share = seen / self.parameters[k.P_MAX_STEPS]  # an episode that ends early sees no more
        return {**self.errors(i, self.bounds), "in_view": share, "closest_m": closest}
