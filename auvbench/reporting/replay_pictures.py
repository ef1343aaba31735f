"""Show replayed episodes of a test as text, as a figure, and as a film (GIF); several runs share one scene.

The background of a film is drawn once. Each picture only draws a dozen lines over it, which is a hundred times
faster than drawing the whole figure.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench import metrics
from auvbench.analysis.labels import title
from auvbench.envs.rendering import panels
from auvbench.errors import UserError
from auvbench.evaluation.replay import Replay
from auvbench.record import Record
from auvbench.registry import TASKS
from auvbench.reporting.figures import style
from auvbench.reporting.figures.looks import COLOURS, palette
from auvbench.reporting.figures.style import OUTCOME_LOOK
from auvbench.runs.atomic_io import check_writable

RATE = 25  # pictures per second
LONGEST = 150  # largest number of pictures; a longer episode is played faster
HOLD = 25
"""additional time for which a film of several runs shows its last picture, in pictures"""
DPI = 80
SIZE = (10.4, 4.4)  # inches: 832 x 352 pixels
GREY: Any = {"color": "#9a9a9a", "linestyle": "--", "linewidth": 1.0}
"""line style of a reference"""

Picture = NDArray[np.uint8]


def summary(episode: Replay) -> str:
    """Return a text of a few lines that describes the episode."""
    r, config = episode.record, episode.config
    wx, wy, wz = (float(v) for v in episode.waypoint)
    task = TASKS[config.task.name]
    return "\n".join(
        [
            f"{episode.run}, protocol {episode.protocol}, condition {episode.condition}, episode {r['episode']}",
            f"{r['outcome']} after {r['steps']} steps ({float(r['duration_s']):.1f} s at "
            f"{config.step.frequency:g} Hz), return {float(r['return']):.1f}",
            f"{task.goal} ({wx:.1f}, {wy:.1f}, {wz:.1f}) m, "
            f"{'' if task.free_goal else 'reference '}{float(r['initial_distance_m']):.1f} m away; "
            f"ended {float(r['final_distance_m']):.2f} m from it",
            f"path {float(r['path_length_m']):.1f} m, {_accuracy(r)}, depth margin {float(r['depth_margin_m']):.1f} m",
            f"command norm {float(r['command_norm_mean_N']):.1f} N on average, energy {float(r['energy_J']) / 1e3:.2f} kJ",
        ]
    )


def _accuracy(r: Record) -> str:
    """Return a text on the vehicle's accuracy: the first metric of a fixed list that has a value in the record."""
    names = (
        "formation_error_rms_m",
        "deviation_mean_m",
        "cross_track_rms_m",
        "position_error_rms_m",
        "final_position_error_m",
        "altitude_error_rms_m",
        "clearance_min_m",
        "final_distance_m",  # measured in every task
    )
    name = next(name for name in names if name in r)
    return f"{next(m.title for m in metrics.registered() if m.name == name)} {float(r[name]):.2f} m"


@dataclass(frozen=True, slots=True)
class Moving:
    """The lines of an episode that a figure redraws for each step."""

    episode: Replay
    space: list[Any]
    """Lines in the 3-D view: path, nose, position of the moving reference, and the paths of the other vehicles of a team,
    each with a marker at its end"""
    above: list[Any]
    """The same lines in the view from above"""
    distance: Any
    commands: list[Any]
    """one line for the command of each actuator; empty if the figure shows several episodes"""

    @property
    def artists(self) -> list[Any]:
        return [*self.space, *self.above, self.distance, *self.commands]

    def show(self, step: int) -> None:
        """Set the data of the lines up to a step of the episode."""
        e = self.episode
        p, yaw = e.position[: step + 1], e.yaw[step]
        left, right = self.above[0].axes.get_xlim()
        tip = p[-1] + 0.05 * (right - left) * np.array([np.cos(yaw), np.sin(yaw), 0.0])
        aim = np.empty((0, 3)) if e.reference is None else e.reference[step, None]
        others = () if e.others is None else e.others[: step + 1].swapaxes(0, 1)
        lines = (p, np.stack([p[-1], tip]), aim, *others)
        for points, solid, flat in zip(lines, self.space, self.above, strict=True):
            solid.set_data_3d(*points.T)
            flat.set_data(*points[:, :2].T)
        self.distance.set_data(e.time[: step + 1], e.distance[: step + 1])
        for j, command in enumerate(self.commands):
            command.set_data(e.time[:step], e.command[:step, j])


def scene(episodes: Sequence[Replay]) -> tuple[Any, list[Moving]]:
    """Return a figure with the background, and the lines of each episode, which have no data yet."""
    figure = style.canvas(*SIZE)
    figure.set_dpi(DPI)
    first, single = episodes[0], len(episodes) == 1
    paths = [path for episode in episodes for path in (episode.position, episode.others) if path is not None]
    positions = np.concatenate([path.reshape(-1, 3) for path in paths])
    space, above, time, last = panels(
        figure,
        first.config.task,
        np.asarray(first.waypoint, dtype=np.float64),
        first.position[0],
        low=positions.min(0),
        high=positions.max(0),
        end=max(float(episode.time[-1]) for episode in episodes),
        farthest=max(float(episode.distance.max()) for episode in episodes) * 1.05,
        force=float(np.abs(first.command).max()) * 1.05 or 1.0,
        dock_yaw=None if first.dock_yaw is None else float(first.dock_yaw[0]),
        outlines=_outlines(episodes),
    )
    own = OUTCOME_LOOK.get(str(first.record["outcome"]), OUTCOME_LOOK["timeout"])[0]
    moving = []
    for episode, colour in zip(episodes, [own] if single else palette(len(episodes)), strict=True):
        if episode.reference is not None:
            space.plot(*episode.reference.T, **GREY)
            above.plot(*episode.reference[:, :2].T, **GREY)
        free = [c for c in COLOURS if c != colour]
        looks: list[dict[str, Any]] = [
            {"color": colour},
            {"color": "black", "linewidth": 3},
            {"color": "black", "marker": "o", "markersize": 4, "fillstyle": "none"},
            *(
                {"color": c if single else colour, "linewidth": 0.9, "marker": "o", "markevery": [-1]}
                for c in free[: _others(episode)]
            ),
        ]
        solid = [space.plot([], [], [], **look)[0] for look in looks]
        flat = [above.plot([], [], **look)[0] for look in looks]
        commands = [
            last.plot(
                [], [], drawstyle="steps-post", color=COLOURS[j % len(COLOURS)], linewidth=0.9, label=name
            )[0]
            for j, name in enumerate(episode.actuators)
            if single
        ]
        moving.append(Moving(episode, solid, flat, time.plot([], [], color=colour)[0], commands))
    if single:
        r = first.record
        about = f"{first.run}   episode {r['episode']}: {r['outcome']} after {r['steps']} steps"
    else:
        time.set(xlabel="time (s)")
        last.set_axis_off()
        for label, lines in zip(labels(episodes), moving, strict=True):
            e = lines.episode
            end = f"{e.record['outcome']}, {float(e.time[-1]):.1f} s"
            last.plot([], [], color=lines.distance.get_color(), linewidth=3, label=f"{label}: {end}")
        last.legend(loc="center", fontsize=10)
        place = first.condition if first.condition != "nominal" else ""
        about = " ".join(f"{first.protocol} {place} episode {first.record['episode']}".split())
    figure.suptitle(about, x=0.01, ha="left", fontsize=10)
    return figure, moving


def _others(episode: Replay) -> int:
    """Return the number of vehicles in an episode, not counting the first vehicle."""
    return 0 if episode.others is None else episode.others.shape[1]


def _outlines(episodes: Sequence[Replay]) -> Any:
    """Return the segments (k, 2, 3) in m of the solids near any of the paths; None in open water."""
    outlines = [episode.outlines for episode in episodes if episode.outlines is not None]
    return np.concatenate(outlines).astype(np.float64) if outlines else None


def labels(episodes: Sequence[Replay]) -> list[str]:
    """Return a label for each episode: the algorithm, with the seed if several episodes have the same algorithm."""
    names = [title(episode.config.algo.name) for episode in episodes]
    return [
        name if names.count(name) == 1 else f"{name} seed {episode.config.seed}"
        for name, episode in zip(names, episodes, strict=True)
    ]


def draw(episodes: Sequence[Replay], path: Path) -> tuple[Path, Path]:
    """Draw the complete episodes as `path`.png and `path`.svg, and return the two paths."""
    with style.styled():
        figure, moving = scene(episodes)
        for lines in moving:
            lines.show(len(lines.episode.command))
            if lines.commands:
                axes = lines.commands[0].axes
                axes.legend(ncols=4, fontsize=6.5, loc="upper center", bbox_to_anchor=(0.5, -0.3))
        return style.save(figure, path)


def check(path: Path) -> None:
    """Check that a film can be written to a path.

    Raises:
        UserError: the suffix is not .gif, the path is a folder, or it is not writable.
    """
    if path.suffix.lower() != ".gif":
        raise UserError(f"--video {path}: must end in .gif; convert it with ffmpeg -i FILE.gif FILE.mp4")
    check_writable(path, f"--video {path}")


def film(episodes: Sequence[Replay], path: Path) -> Path:
    """Write the episodes as one film, in which all episodes start at the same time, and return its path.

    Args:
        episodes: replayed episodes.
        path: path of the GIF.

    Raises:
        UserError: see `check`.
    """
    from PIL import Image

    check(path)
    longest = max(episodes, key=lambda episode: episode.time[-1])
    n = len(longest.command)
    steps = np.unique(np.linspace(0, n, min(n + 1, LONGEST)).astype(int))
    frames = pictures(episodes, [float(longest.time[step]) for step in steps])
    every = [Image.fromarray(frame) for frame in frames]
    # All pictures use the palette of the last picture, which has every colour. Different palettes would flicker.
    palette = every[-1].quantize(256)
    indexed = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in every]
    still = 1 + HOLD * (len(episodes) > 1)
    durations = [*[1000 // RATE] * (len(every) - 1), 1000 // RATE * still]
    indexed[0].save(path, save_all=True, append_images=indexed[1:], duration=durations, loop=0)
    return path


def pictures(episodes: Sequence[Replay], times: Sequence[float]) -> Iterator[Picture]:
    """Yield a picture (352, 832, 3) of the scene at each time in s; an episode that has ended keeps its last state."""
    with style.styled():
        figure, moving = scene(episodes)
        artists = [artist for lines in moving for artist in lines.artists]
        for artist in artists:
            artist.set_animated(True)
        figure.draw_without_rendering()  # computes the layout
        figure.set_layout_engine("none")
        canvas: Any = figure.canvas
        canvas.draw()
        background = canvas.copy_from_bbox(figure.bbox)
        for time in times:
            canvas.restore_region(background)
            for lines in moving:
                shown = int(np.searchsorted(lines.episode.time, time, side="right")) - 1
                lines.show(min(shown, len(lines.episode.command)))
            for artist in artists:
                artist.axes.draw_artist(artist)
            yield np.array(canvas.buffer_rgba())[..., :3]
