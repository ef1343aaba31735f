"""A replayed episode as a moving picture (GIF).

What does not move is drawn once: each picture is that background with half a dozen lines drawn over it, a hundred
times faster than drawing the figure anew.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.errors import UserError
from auvbench.evaluation.replay import Replay
from auvbench.reporting.figures import style

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
    fresh = not path.exists()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.open("ab").close()
    except OSError as error:
        raise UserError(f"--video {path}: cannot write there: {error.strerror or error}") from error
    if fresh:
        path.unlink()


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

    _gif(told(), path)
    return path


def pictures(episode: Replay, steps: list[int]) -> Iterator[Picture]:
    """Yield the scene at some steps, (352, 832, 3) each."""
    from auvbench.reporting.replay import heading, lines, scene

    with style.styled():
        figure = style.canvas(*SIZE)
        figure.set_dpi(DPI)
        axes = scene(figure, episode)
        figure.suptitle(heading(episode), x=0.01, ha="left", fontsize=10)
        path3, path2, distance, *commands = lines(axes, episode)
        (nose3,) = axes[0].plot([], [], [], color="black", linewidth=3)
        (nose2,) = axes[1].plot([], [], color="black", linewidth=3)
        moving = [path3, nose3, path2, nose2, distance, *commands]
        for artist in moving:
            artist.set_animated(True)
        figure.draw_without_rendering()  # settles the layout
        figure.set_layout_engine("none")
        canvas: Any = figure.canvas
        canvas.draw()
        background = canvas.copy_from_bbox(figure.bbox)
        left, right = axes[1].get_xlim()
        for step in steps:
            p, yaw = episode.position[: step + 1], episode.yaw[step]
            tip = p[-1] + 0.05 * (right - left) * np.array([np.cos(yaw), np.sin(yaw), 0.0])
            nose = np.stack([p[-1], tip]).T
            path3.set_data_3d(*p.T)
            nose3.set_data_3d(*nose)
            path2.set_data(*p[:, :2].T)
            nose2.set_data(*nose[:2])
            distance.set_data(episode.time[: step + 1], episode.distance[: step + 1])
            for j, command in enumerate(commands):
                command.set_data(episode.time[:step], episode.command[:step, j])
            canvas.restore_region(background)
            for artist in moving:
                artist.axes.draw_artist(artist)
            yield np.array(canvas.buffer_rgba())[..., :3]


def _gif(frames: Iterator[Picture], path: Path) -> None:
    from PIL import Image

    every = [Image.fromarray(frame) for frame in frames]
    # One palette for all: the last picture has every colour, and colours that change from picture to picture flicker.
    palette = every[-1].quantize(256)
    indexed = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in every]
    indexed[0].save(path, save_all=True, append_images=indexed[1:], duration=1000 // RATE, loop=0)
