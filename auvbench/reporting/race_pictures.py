"""Several runs in the same episode of a test, in one scene: a figure and a film (GIF)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from auvbench.analysis.labels import title
from auvbench.envs.scene import panels
from auvbench.evaluation.replay import Replay
from auvbench.reporting import replay_pictures
from auvbench.reporting.figures import style
from auvbench.reporting.replay_pictures import DPI, SIZE, Picture, hold_still

HOLD = 25
"""pictures at the end in which nothing moves"""


def labels(episodes: Sequence[Replay]) -> list[str]:
    """Return the algorithm of each run, with its seed where several runs have the same algorithm."""
    names = [title(episode.config.algo.name) for episode in episodes]
    return [
        name if names.count(name) == 1 else f"{name} seed {episode.config.seed}"
        for name, episode in zip(names, episodes, strict=True)
    ]


def draw(episodes: Sequence[Replay], path: Path) -> tuple[Path, Path]:
    """Draw the whole episodes as `path`.png and `path`.svg; return both."""
    with style.styled():
        figure, drawn = _scene(episodes)
        for moving, episode in zip(drawn, episodes, strict=True):
            _move(moving, episode, len(episode.command))
        return style.save(figure, path)


def film(
    episodes: Sequence[Replay], path: Path, tell: Callable[[int, int], None] = lambda done, of: None
) -> Path:
    """Write the episodes as one film, all from the same moment on; see `replay_pictures.film`."""
    replay_pictures.check(path)
    longest = max(episodes, key=lambda episode: episode.time[-1])
    times = [float(longest.time[step]) for step in replay_pictures.steps_shown(len(longest.command))]

    def told() -> Iterator[Picture]:
        for number, picture in enumerate(_pictures(episodes, times), 1):
            yield picture
            tell(number, len(times))

    replay_pictures.save_gif(told(), path, hold=HOLD)
    return path


def _scene(episodes: Sequence[Replay]) -> tuple[Any, list[list[Any]]]:
    """Return a figure, and for each episode its moving artists: path and nose in space and from above, distance."""
    figure = style.canvas(*SIZE)
    figure.set_dpi(DPI)
    first = episodes[0]
    positions = np.concatenate([episode.position for episode in episodes])
    space, above, time, legend = panels(
        figure,
        first.config.task,
        np.asarray(first.waypoint, dtype=np.float64),
        first.position[0],
        low=positions.min(0),
        high=positions.max(0),
        end=max(float(episode.time[-1]) for episode in episodes),
        farthest=max(float(episode.distance.max()) for episode in episodes) * 1.05,
        force=1.0,
    )
    time.set(xlabel="time (s)")
    legend.set_axis_off()
    drawn = []
    for episode, label, colour in zip(episodes, labels(episodes), style.palette(len(episodes)), strict=True):
        (path3,), (path2,) = space.plot([], [], [], color=colour), above.plot([], [], color=colour)
        (nose3,) = space.plot([], [], [], color="black", linewidth=3)
        (nose2,) = above.plot([], [], color="black", linewidth=3)
        (distance,) = time.plot([], [], color=colour)
        end = f"{episode.record['outcome']}, {float(episode.time[-1]):.1f} s"
        legend.plot([], [], color=colour, linewidth=3, label=f"{label}: {end}")
        drawn.append([path3, nose3, path2, nose2, distance])
    legend.legend(loc="center", fontsize=10)
    place = first.condition if first.condition != "nominal" else ""
    about = f"{first.protocol} {place} episode {first.record['episode']}"
    figure.suptitle(" ".join(about.split()), x=0.01, ha="left", fontsize=10)
    return figure, drawn


def _move(moving: Sequence[Any], episode: Replay, step: int) -> None:
    """Let the artists of an episode show its first steps."""
    path3, nose3, path2, nose2, distance = moving
    p, yaw = episode.position[: step + 1], episode.yaw[step]
    left, right = path2.axes.get_xlim()
    tip = p[-1] + 0.05 * (right - left) * np.array([np.cos(yaw), np.sin(yaw), 0.0])
    nose = np.stack([p[-1], tip]).T
    path3.set_data_3d(*p.T)
    nose3.set_data_3d(*nose)
    path2.set_data(*p[:, :2].T)
    nose2.set_data(*nose[:2])
    distance.set_data(episode.time[: step + 1], episode.distance[: step + 1])


def _pictures(episodes: Sequence[Replay], times: Sequence[float]) -> Iterator[Picture]:
    """Yield the scene at some times, (352, 832, 3) each; an episode that has ended stands still."""
    with style.styled():
        figure, drawn = _scene(episodes)
        artists = [artist for moving in drawn for artist in moving]
        canvas, background = hold_still(figure, artists)
        for time in times:
            canvas.restore_region(background)
            for moving, episode in zip(drawn, episodes, strict=True):
                last = int(np.searchsorted(episode.time, time, side="right")) - 1
                _move(moving, episode, min(last, len(episode.command)))
            for artist in artists:
                artist.axes.draw_artist(artist)
            yield np.array(canvas.buffer_rgba())[..., :3]
