"""A replayed episode as a film, GIF or MP4.

What does not move is drawn once: each picture is that background with half a dozen lines drawn over it, a hundred
times faster than drawing the figure anew.
"""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.errors import ReportError, UserError
from auvbench.evaluation.replay import Replay
from auvbench.reporting.figures import style
from auvbench.reporting.figures.style import COLOURS, OUTCOME_LOOK

RATE = 25  # pictures per second
LONGEST = 150  # pictures; a longer episode is shown faster
DPI = 80
SIZE = (10.4, 4.4)  # inches: 832 x 352 pixels, which are even numbers, as video codecs want them

Picture = NDArray[np.uint8]


def check(path: Path) -> None:
    """Whether a film can be written there, asked before anything is computed.

    Raises:
        UserError: another suffix, an MP4 without ffmpeg, a folder, or a place that cannot be written.
    """
    if path.suffix.lower() not in (".mp4", ".gif"):
        raise UserError(f"--video {path}: must end in .mp4 or .gif")
    if path.suffix.lower() == ".mp4" and shutil.which("ffmpeg") is None:
        raise UserError(f"--video {path}: an MP4 needs ffmpeg, which is not installed; name a .gif instead")
    if path.is_dir():
        raise UserError(f"--video {path}: is a folder, name a file")
    fresh = not path.exists()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.open("ab").close()
    except OSError as error:
        raise UserError(f"--video {path}: cannot write there: {error.strerror or error}") from error
    if fresh:
        path.unlink()


def steps_shown(steps: int) -> list[int]:
    """The steps of an episode that become pictures.

    >>> steps_shown(3), len(steps_shown(1000))
    ([0, 1, 2, 3], 150)
    """
    return [int(step) for step in np.unique(np.linspace(0, steps, min(steps + 1, LONGEST)).astype(int))]


def film(episode: Replay, path: Path, tell: Callable[[int, int], None] = lambda done, of: None) -> Path:
    """Writes the episode as a film.

    Args:
        episode: as replayed.
        path: FILE.mp4 or FILE.gif.
        tell: called after each picture with how many are done, of how many.

    Raises:
        UserError: as `check`.
        ReportError: ffmpeg failed.
    """
    check(path)
    steps = steps_shown(len(episode.command))

    def told() -> Iterator[Picture]:
        for number, picture in enumerate(pictures(episode, steps), 1):
            yield picture
            tell(number, len(steps))

    (_mp4 if path.suffix.lower() == ".mp4" else _gif)(told(), path)
    return path


def pictures(episode: Replay, steps: list[int]) -> Iterator[Picture]:
    """The scene at some steps, (352, 832, 3) each."""
    from auvbench.reporting.replay import heading, scene

    with style.styled():
        figure = style.canvas(*SIZE)
        figure.set_dpi(DPI)
        space, above, time, command = scene(figure, episode)
        figure.suptitle(heading(episode), x=0.01, ha="left", fontsize=10)
        colour = OUTCOME_LOOK.get(str(episode.record["outcome"]), OUTCOME_LOOK["timeout"])[0]
        (path3,) = space.plot([], [], [], color=colour)
        (nose3,) = space.plot([], [], [], color="black", linewidth=3)
        (path2,) = above.plot([], [], color=colour)
        (nose2,) = above.plot([], [], color="black", linewidth=3)
        (line,) = time.plot([], [], color=colour)
        thrusters = [
            command.step([], [], where="post", color=COLOURS[j % len(COLOURS)], linewidth=0.9)[0]
            for j in range(episode.command.shape[1])
        ]
        moving: list[tuple[Any, Any]] = [(space, path3), (space, nose3), (above, path2), (above, nose2)]
        moving += [(time, line), *((command, thruster) for thruster in thrusters)]
        for _, artist in moving:
            artist.set_animated(True)
        figure.draw_without_rendering()  # settles the layout
        figure.set_layout_engine("none")
        canvas: Any = figure.canvas
        canvas.draw()
        background = canvas.copy_from_bbox(figure.bbox)
        arm = 0.05 * (above.get_xlim()[1] - above.get_xlim()[0])
        for step in steps:
            p = episode.position[: step + 1]
            tip = p[-1] + arm * np.array([np.cos(episode.yaw[step]), np.sin(episode.yaw[step]), 0.0])
            path3.set_data_3d(*p.T)
            nose3.set_data_3d(*np.stack([p[-1], tip]).T)
            path2.set_data(p[:, 0], p[:, 1])
            nose2.set_data([p[-1, 0], tip[0]], [p[-1, 1], tip[1]])
            line.set_data(episode.time[: step + 1], episode.distance[: step + 1])
            for j, thruster in enumerate(thrusters):
                thruster.set_data(episode.time[:step], episode.command[:step, j])
            canvas.restore_region(background)
            for axes, artist in moving:
                axes.draw_artist(artist)
            yield np.array(canvas.buffer_rgba())[..., :3]


def _gif(frames: Iterator[Picture], path: Path) -> None:
    from PIL import Image

    every = [Image.fromarray(frame) for frame in frames]
    # One palette for all: the last picture has every colour, and colours that change from picture to picture flicker.
    palette = every[-1].quantize(256)
    indexed = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in every]
    indexed[0].save(path, save_all=True, append_images=indexed[1:], duration=1000 // RATE, loop=0)


def _mp4(frames: Iterator[Picture], path: Path) -> None:
    first = next(frames)
    height, width, _ = first.shape
    command = ["ffmpeg", "-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24"]
    command += ["-s", f"{width}x{height}", "-r", str(RATE), "-i", "-", "-pix_fmt", "yuv420p", str(path)]
    encoder = subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE)
    assert encoder.stdin is not None
    try:
        encoder.stdin.write(first.tobytes())
        for frame in frames:
            encoder.stdin.write(frame.tobytes())
    except BrokenPipeError:
        pass  # it says why
    _, said = encoder.communicate()
    if encoder.returncode:
        lines = said.decode(errors="replace").strip().splitlines() or [f"exit code {encoder.returncode}"]
        raise ReportError(f"--video {path}: ffmpeg failed: {lines[-1]}")
