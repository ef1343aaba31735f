"""A replayed episode as a moving picture (GIF).

What does not move is drawn once: each picture is that background with half a dozen lines drawn over it, a hundred
times faster than drawing the figure anew.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from numpy.typing import NDArray

from auvbench.envs.scene import panels
from auvbench.errors import UserError
from auvbench.evaluation.replay import Replay
from auvbench.record import Record
from auvbench.reporting.figures import style
from auvbench.reporting.figures.style import COLOURS, OUTCOME_LOOK
from auvbench.runs.atomic_io import check_writable

BARS = "▁▂▃▄▅▆▇█"


def sparkline(values: Any, width: int = 48, low: float | None = None, high: float | None = None) -> str:
    """Return a series as a line of block characters, means over equal parts.

    >>> sparkline([0, 1, 2, 3], width=4)
    '▁▃▆█'
    """
    series = np.asarray(values, dtype=float)
    parts = np.array([part.mean() for part in np.array_split(series, min(width, len(series)))])
    floor = float(parts.min()) if low is None else low
    span = (float(parts.max()) if high is None else high) - floor
    level = (parts - floor) / span if span > 0 else np.zeros_like(parts)
    return "".join(BARS[i] for i in np.clip(np.rint(level * 7), 0, 7).astype(int))


def summary(episode: Replay) -> str:
    """Return the episode in a dozen lines."""
    r, config = episode.record, episode.config
    wx, wy, wz = (float(v) for v in episode.waypoint)
    waypoint = config.task.name == "waypoint"
    lines = [
        f"{episode.run}, protocol {episode.protocol}, condition {episode.condition}, episode {r['episode']}",
        f"{r['outcome']} after {r['steps']} steps ({float(r['duration_s']):.1f} s at "
        f"{config.step.frequency:g} Hz), return {float(r['return']):.1f}",
        f"{'waypoint' if waypoint else 'goal'} ({wx:.1f}, {wy:.1f}, {wz:.1f}) m, "
        f"{'' if waypoint else 'reference '}{float(r['initial_distance_m']):.1f} m away; "
        f"ended {float(r['final_distance_m']):.2f} m from it",
        f"path {float(r['path_length_m']):.1f} m, {_accuracy(r)}, depth margin {float(r['depth_margin_m']):.1f} m",
        f"command norm {float(r['command_norm_mean_N']):.1f} N on average, energy {float(r['energy_J']) / 1e3:.2f} kJ",
        "",
    ]
    series: list[tuple[str, Any, str, float | None, float | None]] = [
        ("distance", episode.distance, "m", 0.0, None),
        ("z", episode.position[:, 2], "m", None, None),
        ("yaw", np.degrees(episode.yaw), "deg", -180.0, 180.0),
    ]
    bound = float(np.abs(episode.command).max()) or 1.0
    series += [(name, episode.command[:, j], "N", -bound, bound) for j, name in enumerate(episode.actuators)]
    width = max(len(name) for name, *_ in series)
    for name, values, unit, low, high in series:
        lines.append(
            f"{name:<{width}}  {sparkline(values, low=low, high=high)}  {np.min(values):.1f} to {np.max(values):.1f} {unit}"
        )
    return "\n".join(lines)


def _accuracy(r: Record) -> str:
    """Return how well the vehicle went, by the metrics of its task."""
    if "deviation_mean_m" in r:
        straight = f"efficiency {float(r['path_efficiency']):.2f}"
        return (
            f"{straight}, deviation {float(r['deviation_mean_m']):.2f} ± {float(r['deviation_std_m']):.2f} m"
        )
    for name, title in (
        ("cross_track_rms_m", "RMS cross-track distance"),
        ("position_error_rms_m", "RMS position error"),
    ):
        if name in r:
            return f"{title} {float(r[name]):.2f} m"
    return f"final position error {float(r['final_position_error_m']):.2f} m"


def scene(figure: Canvas, episode: Replay) -> tuple[Any, Axes, Axes, Axes]:
    """Return the axes in space, from above, of distance and of commands, with all that does not move."""
    return panels(
        figure,
        episode.config.task,
        np.asarray(episode.waypoint, dtype=np.float64),
        episode.position[0],
        low=episode.position.min(0),
        high=episode.position.max(0),
        end=float(episode.time[-1]),
        farthest=float(episode.distance.max()) * 1.05,
        force=float(np.abs(episode.command).max()) * 1.05 or 1.0,
        dock_yaw=None if episode.dock_yaw is None else float(episode.dock_yaw[0]),
    )


def heading(episode: Replay) -> str:
    """Return the title of the pictures of an episode."""
    r = episode.record
    return f"{episode.run}   episode {r['episode']}: {r['outcome']} after {r['steps']} steps"


def lines(axes: tuple[Any, Axes, Axes, Axes], episode: Replay) -> list[Any]:
    """Add the moving lines to the axes of `scene`, with the whole episode: path twice, distance, commands."""
    space, above, time, command = axes
    colour = OUTCOME_LOOK.get(str(episode.record["outcome"]), OUTCOME_LOOK["timeout"])[0]
    x, y, z = episode.position.T
    if episode.reference is not None:
        grey: Any = {"color": "#9a9a9a", "linestyle": "--", "linewidth": 1.0}
        space.plot(*episode.reference.T, **grey)
        above.plot(*episode.reference[:, :2].T, **grey)
    drawn = [space.plot(x, y, z, color=colour)[0], above.plot(x, y, color=colour)[0]]
    drawn += time.plot(episode.time, episode.distance, color=colour)
    for j, name in enumerate(episode.actuators):
        forces, hue = episode.command[:, j], COLOURS[j % len(COLOURS)]
        drawn += command.step(episode.time[:-1], forces, where="post", color=hue, linewidth=0.9, label=name)
    return drawn


def draw(episode: Replay, path: Path) -> tuple[Path, Path]:
    """Draw the figure of an episode as `path`.png and `path`.svg; return both."""
    with style.styled():
        figure = style.canvas(11.0, 4.6)
        axes = scene(figure, episode)
        path_above = lines(axes, episode)[1]
        _, above, _, command = axes
        stride = max(1, len(episode.yaw) // 12)
        (x, y, _), yaw = episode.position[::stride].T, episode.yaw[::stride]
        colour = path_above.get_color()
        above.quiver(x, y, np.cos(yaw), np.sin(yaw), color=colour, angles="xy", width=0.006, scale=18)
        command.legend(ncols=4, fontsize=6.5, loc="upper center", bbox_to_anchor=(0.5, -0.3))
        figure.suptitle(heading(episode), x=0.01, ha="left", fontsize=10)
        return style.save(figure, path)


RATE = 25  # pictures per second
LONGEST = 150  # pictures; a longer episode is shown faster
DPI = 80
SIZE = (10.4, 4.4)  # inches: 832 x 352 pixels

Picture = NDArray[np.uint8]


def check(path: Path) -> None:
    """Check that a film can be written to a path.

    Raises:
        UserError: another suffix, a folder, or a place that cannot be written.
    """
    if path.suffix.lower() != ".gif":
        raise UserError(f"--video {path}: must end in .gif; ffmpeg -i FILE.gif FILE.mp4 makes another format")
    check_writable(path, f"--video {path}")


def steps_shown(steps: int) -> list[int]:
    """Return the steps of an episode that become pictures.

    >>> steps_shown(3), len(steps_shown(1000))
    ([0, 1, 2, 3], 150)
    """
    return [int(step) for step in np.unique(np.linspace(0, steps, min(steps + 1, LONGEST)).astype(int))]


def film(episode: Replay, path: Path, tell: Callable[[int, int], None] = lambda done, of: None) -> Path:
    """Write the episode as a film.

    Args:
        episode: as replayed.
        path: FILE.gif.
        tell: called after each picture with how many are done, of how many.

    Raises:
        UserError: as `check`.
    """
    check(path)
    steps = steps_shown(len(episode.command))

    def told() -> Iterator[Picture]:
        for number, picture in enumerate(pictures(episode, steps), 1):
            yield picture
            tell(number, len(steps))

    save_gif(told(), path)
    return path


def hold_still(figure: Canvas, moving: list[Any]) -> tuple[Any, Any]:
    """Draw a figure without the artists that move; return its canvas, and the picture to draw them on."""
    for artist in moving:
        artist.set_animated(True)
    figure.draw_without_rendering()  # settles the layout
    figure.set_layout_engine("none")
    canvas: Any = figure.canvas
    canvas.draw()
    return canvas, canvas.copy_from_bbox(figure.bbox)


def pictures(episode: Replay, steps: list[int]) -> Iterator[Picture]:
    """Yield the scene at some steps, (352, 832, 3) each; a ring is a reference that moves."""
    with style.styled():
        figure = style.canvas(*SIZE)
        figure.set_dpi(DPI)
        axes = scene(figure, episode)
        figure.suptitle(heading(episode), x=0.01, ha="left", fontsize=10)
        path3, path2, distance, *commands = lines(axes, episode)
        (nose3,) = axes[0].plot([], [], [], color="black", linewidth=3)
        (nose2,) = axes[1].plot([], [], color="black", linewidth=3)
        (aim3,) = axes[0].plot([], [], [], "o", color="black", markersize=4, fillstyle="none")
        (aim2,) = axes[1].plot([], [], "o", color="black", markersize=4, fillstyle="none")
        moving = [path3, nose3, path2, nose2, aim3, aim2, distance, *commands]
        canvas, background = hold_still(figure, moving)
        left, right = axes[1].get_xlim()
        for step in steps:
            p, yaw = episode.position[: step + 1], episode.yaw[step]
            tip = p[-1] + 0.05 * (right - left) * np.array([np.cos(yaw), np.sin(yaw), 0.0])
            nose = np.stack([p[-1], tip]).T
            path3.set_data_3d(*p.T)
            nose3.set_data_3d(*nose)
            path2.set_data(*p[:, :2].T)
            if episode.reference is not None:
                aim3.set_data_3d(*episode.reference[step, :, None])
                aim2.set_data(*episode.reference[step, :2, None])
            nose2.set_data(*nose[:2])
            distance.set_data(episode.time[: step + 1], episode.distance[: step + 1])
            for j, command in enumerate(commands):
                command.set_data(episode.time[:step], episode.command[:step, j])
            canvas.restore_region(background)
            for artist in moving:
                artist.axes.draw_artist(artist)
            yield np.array(canvas.buffer_rgba())[..., :3]


def save_gif(frames: Iterator[Picture], path: Path, hold: int = 0) -> None:
    """Write pictures as a film that repeats; the last one stays for `hold` pictures more."""
    from PIL import Image

    every = [Image.fromarray(frame) for frame in frames]
    # One palette for all: the last picture has every colour, and colours that change from picture to picture flicker.
    palette = every[-1].quantize(256)
    indexed = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in every]
    durations = [*[1000 // RATE] * (len(every) - 1), 1000 // RATE * (1 + hold)]
    indexed[0].save(path, save_all=True, append_images=indexed[1:], duration=durations, loop=0)
