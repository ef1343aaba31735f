"""A replayed episode: a summary with sparklines, and a figure; film.py makes a film."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from auvbench.envs.scene import panels
from auvbench.evaluation.replay import Replay
from auvbench.reporting.figures import style
from auvbench.reporting.figures.style import COLOURS, OUTCOME_LOOK

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
    lines = [
        f"{episode.run}, protocol {episode.protocol}, condition {episode.condition}, episode {r['episode']}",
        f"{r['outcome']} after {r['steps']} steps ({float(r['duration_s']):.1f} s at "
        f"{config.step.frequency:g} Hz), return {float(r['return']):.1f}",
        f"waypoint ({wx:.1f}, {wy:.1f}, {wz:.1f}) m, {float(r['initial_distance_m']):.1f} m away; "
        f"ended {float(r['final_distance_m']):.2f} m from it",
        f"path {float(r['path_length_m']):.1f} m (efficiency {float(r['path_efficiency']):.2f}), deviation "
        f"{float(r['deviation_mean_m']):.2f} ± {float(r['deviation_std_m']):.2f} m, "
        f"depth margin {float(r['depth_margin_m']):.1f} m",
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
