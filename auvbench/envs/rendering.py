"""Render an episode while it runs, as a picture or as a line of text.

A picture shows the episode in space, from above, and over time. Everything that does not move is drawn once and kept
as pixels; each picture adds the moving lines. The first picture imports Matplotlib.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from auvbench.config import schema, tasks
from auvbench.dynamics import frames
from auvbench.errors import ConfigError, closest

if TYPE_CHECKING:
    from auvbench.envs.batch import Batch, Transition

Floats = NDArray[np.float64]

SIZE = (10.4, 4.4)
DPI = 80
"""Size in inches, and dots per inch: 832 x 352 pixels, even numbers for video codecs"""
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000", "#882255")
"""Colours from Okabe and Ito (2008) without yellow, which is hard to see on white; the last colour is from Tol's muted scheme"""
PATH = "#0072B2"
SOLID = "#8a6d3b"
"""colour of solids"""

MODES = ("rgb_array", "ansi")
"""modes of rendering, in addition to None"""

LOOK: Any = {
    "font.size": 9,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.7,
    "lines.linewidth": 1.6,
    "figure.autolayout": False,
    "figure.constrained_layout.use": False,
}
"""style of an environment's pictures and of a report's figures"""


@contextmanager
def own_style(style: dict[str, Any]) -> Iterator[None]:
    """Apply a style over Matplotlib's defaults, so that the user's settings have no effect, then restore the caller's
    style.

    Args:
        style: values of rcParams.
    """
    import matplotlib as mpl

    values: Any = {name: value for name, value in mpl.rcParamsDefault.items() if name != "backend"} | style
    with mpl.rc_context(values):
        yield


def speed(frequency: float) -> float | int:
    """Return the pictures per second of a real-time film with one picture per agent step. A whole number is returned as an
    int, as film writers need it.
    """
    return int(frequency) if float(frequency).is_integer() else frequency


@dataclass(slots=True)
class Trail:
    """Trail of an episode so far: T steps, T + 1 positions."""

    waypoint: Floats  # (3,) m, waypoint or other goal of the task
    dock_yaw: float | None = None  # rad, yaw of a vehicle that enters the dock
    outlines: Callable[[Floats, Floats, float], Floats] | None = None
    """Function that returns the segments of the world inside a box at a time (see `Task.outlines`); None in open water"""
    moves: bool = False
    """whether the world's solids move"""
    position: list[Floats] = field(default_factory=list)  # (3,) m
    yaw: list[float] = field(default_factory=list)  # rad
    distance: list[float] = field(default_factory=list)  # m
    command: list[Floats] = field(default_factory=list)  # (n_u,) N

    def add(self, pose: Floats, distance: float, command: Floats | None = None) -> None:
        """Add a pose (7,), its distance to the waypoint, and the forces (n_u,) of the step that led to this pose."""
        self.position.append(pose[:3].copy())
        self.yaw.append(float(frames.yaw(pose[3:])))
        self.distance.append(float(distance))
        if command is not None:
            self.command.append(command.copy())


def panels(
    figure: Any,
    task: tasks.Task,
    waypoint: Floats,
    start: Floats,
    *,
    low: Floats,
    high: Floats,
    end: float,
    farthest: float,
    force: float,
    dock_yaw: float | None = None,
    outlines: Floats | None = None,
) -> tuple[Any, Any, Any, Any]:
    """Return four axes with the fixed parts of a picture: in space, from above, distance over time, commands over time.

    Args:
        task: task whose tolerance and depth limits are drawn.
        waypoint: waypoint (3,) or other goal, m.
        start: start (3,) of the vehicle, m.
        low: lowest corner (3,) of the visible box, m.
        high: highest corner (3,) of the visible box, m.
        end: end of the time axes, s.
        farthest: end of the axis of distances, m.
        force: end of the axis of commands, N.
        dock_yaw: yaw of a vehicle that enters the dock at the waypoint, rad.
        outlines: segments (k, 2, 3) of solids, m.
    """
    from matplotlib.patches import Circle

    # The layout engine ignores the labels of the 3-D axes. The narrow second column keeps these labels off the third column.
    grid = figure.add_gridspec(2, 4, width_ratios=[1.5, 0.15, 1.2, 1.2])
    space: Any = figure.add_subplot(grid[:, 0], projection="3d")
    above, time, command = (figure.add_subplot(place) for place in (grid[:, 2], grid[0, 3], grid[1, 3]))
    radius = tolerance(task)
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 19), np.linspace(0, np.pi, 10))
    ball = (np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v))
    space.plot_wireframe(
        *(radius * b + c for b, c in zip(ball, waypoint, strict=True)),
        color="#9a9a9a",
        linewidth=0.4,
    )
    points = [low, high, waypoint - radius, waypoint + radius]
    if dock_yaw is not None and hasattr(task, "cone"):
        cone = _cone(waypoint, dock_yaw, task)
        space.plot(*cone.T, color="#9a9a9a", linewidth=0.6)
        above.plot(*cone[:, :2].T, color="#9a9a9a", linewidth=0.6)
        points += [cone.min(0), cone.max(0)]
    corners = np.vstack(points)
    middle = (corners.max(0) + corners.min(0)) / 2
    half = max(float(np.ptp(corners, axis=0).max()) / 2, 2.0) * 1.05
    limits = np.stack([middle - half, middle + half], axis=1).tolist()
    space.set(
        xlim=limits[0],
        ylim=limits[1],
        zlim=limits[2],
        xlabel="x (m)",
        ylabel="y (m)",
        zlabel="z (m)",
        box_aspect=(1, 1, 1),
    )
    if outlines is not None and len(outlines):
        from auvbench.worlds.outlines import clipped

        inside = clipped(outlines, middle - half, middle + half)
        # NaN after each segment is a gap, so that a single line can show all segments.
        lines = np.concatenate([inside, np.full((len(inside), 1, 3), np.nan)], axis=1).reshape(-1, 3)
        space.plot(*lines.T, color=SOLID, linewidth=0.6)
        above.plot(*lines[:, :2].T, color=SOLID, linewidth=0.6)
    xs, ys = np.meshgrid(limits[0], limits[1])
    for depth in (task.depth_low, task.depth_high):
        if limits[2][0] <= depth <= limits[2][1]:
            space.plot_surface(xs, ys, np.full_like(xs, depth), color="#D55E00", alpha=0.12)
    x, y = (float(value) for value in waypoint[:2])
    above.add_patch(Circle((x, y), radius, fill=False, color="#9a9a9a"))
    above.plot(start[0], start[1], "k+", markersize=9)
    above.set(xlabel="x (m)", ylabel="y (m)", xlim=limits[0], ylim=limits[1], title="from above")
    above.set_aspect("equal")
    time.axhline(radius, color="#9a9a9a", linewidth=0.8)
    time.set(ylabel="distance (m)", xlim=(0, end), ylim=(0, farthest), title="over time")
    command.set(ylabel="command (N)", xlabel="time (s)", xlim=(0, end), ylim=(-force, force))
    return space, above, time, command


def _cone(dock: Floats, yaw: float, task: Any) -> Floats:
    """Return a line (36, 3) in m along the sides and the rim of the cone through which a dock may be entered."""
    out, side = np.array([-np.cos(yaw), -np.sin(yaw), 0.0]), np.array([np.sin(yaw), -np.cos(yaw), 0.0])
    turn = np.linspace(0.0, 2.0 * np.pi, 13)[:, None]
    wide = np.tan(task.cone) * (np.cos(turn) * side + np.sin(turn) * np.array([0.0, 0.0, 1.0]))
    rim = dock + task.standoff * (out + wide)
    return np.stack([np.broadcast_to(dock, rim[1:].shape), rim[:-1], rim[1:]], axis=1).reshape(-1, 3)


def tolerance(task: tasks.Task) -> float:
    """Return the distance in m from the goal that counts as success; 0 for a task without such a distance."""
    return float(getattr(task, "goal_radius", getattr(task, "tolerance", 0.0)))


class Scene:
    """Draw one episode after each of its steps.

    Args:
        force: largest force of an actuator, N.
    """

    def __init__(self, config: schema.TrainConfig, force: float, trail: Trail) -> None:
        self._task = config.task
        self._duration = 1.0 / config.step.frequency
        self._force = 1.05 * force or 1.0
        self._trail = trail
        self._low = self._high = trail.position[0]
        self._end = 10.0
        self._farthest = 0.0
        self._canvas: Any = None

    def frame(self, heading: str) -> NDArray[np.uint8]:
        """Return the picture (352, 832, 3) of the present trail."""
        trail, position = self._trail, np.asarray(self._trail.position)
        clock = self._duration * np.arange(len(position))
        inside = ((position >= self._low) & (position <= self._high)).all() and clock[-1] <= self._end
        if (
            trail.moves
            or not inside
            or max(trail.distance) > self._farthest
            or len(self._commands) != self._count()
        ):
            self._prepare(position)
        above = self._axes[1]
        arm = 0.05 * (above.get_xlim()[1] - above.get_xlim()[0])
        tip = position[-1] + arm * np.array([np.cos(trail.yaw[-1]), np.sin(trail.yaw[-1]), 0.0])
        nose = np.stack([position[-1], tip]).T
        self._space.set_data_3d(*position.T)
        self._above.set_data(*position[:, :2].T)
        self._time.set_data(clock, trail.distance)
        self._noses[0].set_data_3d(*nose)
        self._noses[1].set_data(*nose[:2])
        for line, forces in zip(self._commands, np.asarray(trail.command).T, strict=True):
            line.set_data(clock, np.append(forces, forces[-1]))
        self._text.set_text(heading)
        canvas = self._canvas
        canvas.restore_region(self._background)
        for line in (self._space, self._above, self._time, *self._commands, *self._noses):
            line.axes.draw_artist(line)
        self._text.draw(canvas.get_renderer())
        return np.array(np.asarray(canvas.buffer_rgba())[..., :3])

    def _count(self) -> int:
        return len(self._trail.command[0]) if self._trail.command else 0

    def _prepare(self, position: Floats) -> None:
        """Draw axes that contain the trail and leave space for its continuation; keep them as pixels."""
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
        from matplotlib.layout_engine import ConstrainedLayoutEngine

        trail = self._trail
        now = (len(position) - 1) * self._duration
        points = np.vstack([position, trail.waypoint[None]])
        room = max(3.0, 0.25 * float(np.ptp(points, axis=0).max()))
        self._low, self._high = points.min(0) - room, points.max(0) + room
        while self._end < now:
            self._end *= 2.0
        self._farthest = 1.25 * max(*trail.distance, tolerance(self._task))
        with own_style(LOOK):
            figure = Figure(figsize=SIZE, dpi=DPI, layout=ConstrainedLayoutEngine(wspace=0.12))
            self._canvas = FigureCanvasAgg(figure)  # typed Any: Matplotlib's stubs are incomplete
            self._axes = panels(
                figure,
                self._task,
                trail.waypoint,
                position[0],
                low=self._low,
                high=self._high,
                end=self._end,
                farthest=self._farthest,
                force=self._force,
                dock_yaw=trail.dock_yaw,
                outlines=trail.outlines and trail.outlines(self._low - room, self._high + room, now),
            )
            figure.suptitle(" ", fontsize=10)
            self._canvas.draw()
            figure.set_layout_engine("none")
            space, above, time, command = self._axes
            (self._space,) = space.plot([], [], [], color=PATH)
            (self._above,) = above.plot([], [], color=PATH)
            (self._time,) = time.plot([], [], color=PATH)
            self._commands = [
                command.step([], [], where="post", color=COLOURS[j % len(COLOURS)], linewidth=0.9)[0]
                for j in range(self._count())
            ]
            self._noses = [
                space.plot([], [], [], color="black", linewidth=3)[0],
                above.plot([], [], color="black", linewidth=3)[0],
            ]
            self._text = figure.text(0.01, 0.98, "", ha="left", va="top", fontsize=10)
        self._background = self._canvas.copy_from_bbox(figure.bbox)

    def __getstate__(self) -> dict[str, Any]:
        # A canvas cannot be copied to another process; the copied scene creates a new canvas.
        names = ("_task", "_duration", "_force", "_trail", "_low", "_high", "_end")
        return {name: getattr(self, name) for name in names} | {"_farthest": 0.0, "_canvas": None}


class Renderer:
    """Record the episodes of a batch and render them in a mode.

    Raises:
        ConfigError: the mode is unknown.
    """

    def __init__(self, mode: str | None, batch: Batch) -> None:
        if mode is not None and mode not in MODES:
            raise ConfigError(f"render_mode={mode}: unknown; {closest(str(mode), [*MODES, 'None'])}")
        self.mode = mode
        self._batch = batch
        self._steps = np.zeros(batch.n, dtype=np.int64)
        self._outcome: list[str | None] = [None] * batch.n
        self._trails: list[Trail | None] = [None] * batch.n
        self._scenes: list[Scene | None] = [None] * batch.n

    def begin(self, indices: NDArray[np.int64]) -> None:
        """Record the start of episodes."""
        if self.mode is None:
            return
        self._steps[indices] = 0
        for i in indices.tolist():
            self._outcome[i] = None
        if self.mode != "rgb_array":
            return
        state = self._batch.state
        for i in indices.tolist():
            self._scenes[i] = None
            task = self._batch.task
            around = partial(task.outlines, i) if task.world else None
            trail = self._trails[i] = Trail(
                task.goal(i), task.dock_yaw(i), around, bool(task.world and task.world.moves)
            )
            trail.add(state.pose[i], state.distance[i])

    def follow(self, i: int, pose: Any, distance: float, force: Any, outcome: str | None = None) -> None:
        """Record the pose of environment `i` after a step, and the outcome if its episode ended."""
        self._steps[i] += 1
        self._outcome[i] = outcome
        trail = self._trails[i]
        if trail is not None:
            trail.add(pose, distance, force)

    def follow_step(self, result: Transition, begun: NDArray[np.int64]) -> None:
        """Record a step of the batch, except in environments `begun` (k,), whose episodes began in this step."""
        state, last = self._batch.state, result.final_state
        at = {i: k for k, i in enumerate(result.ended.tolist())}
        for i in np.setdiff1d(np.arange(self._batch.n), begun).tolist():
            k = at.get(i)
            shown, row = (state, i) if k is None else (last, k)
            outcome = None if k is None else str(result.records[k]["outcome"])
            self.follow(i, shown.pose[row], shown.distance[row], shown.force[row], outcome)
        self.begin(begun)

    def show(self, i: int) -> Any:
        """Return a picture (352, 832, 3) of uint8, or a line of text, of environment `i`; None without a mode."""
        if self.mode is None:
            return None
        return self._line(i) if self.mode == "ansi" else self._picture(i)

    def _picture(self, i: int) -> NDArray[np.uint8]:
        trail = self._trails[i]
        assert trail is not None
        scene = self._scenes[i]
        if scene is None:
            force = float(np.abs(self._batch.vehicle.force_limits).max(initial=0.0))
            scene = self._scenes[i] = Scene(self._batch.config, force, trail)
        time = self._steps[i] / self._batch.config.step.frequency
        return scene.frame(f"{time:6.1f} s   {trail.distance[-1]:6.2f} m to go   {self._outcome[i] or ''}")

    def _line(self, i: int) -> str:
        state = self._batch.state
        (x, y, z), (a, b, c) = state.pose[i, :3], state.reference[i]
        yaw = np.degrees(frames.yaw(state.pose[i, 3:]))
        time = self._steps[i] / self._batch.config.step.frequency
        return (
            f"step {self._steps[i]} ({time:.1f} s): at ({x:.2f}, {y:.2f}, {z:.2f}) m, yaw {yaw:.0f} deg; "
            f"{state.key} ({a:.2f}, {b:.2f}, {c:.2f}) m, {state.distance[i]:.2f} m away; "
            f"{self._outcome[i] or 'under way'}"
        )
