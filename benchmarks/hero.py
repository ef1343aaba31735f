"""Draw MPC, PID and PPO on their way to one waypoint as a film, docs/assets/hero.gif (part of `make gallery`).

`experiment=quickstart` trains the agents. The projection is parallel; shadows on a grid below the vehicles show their place. The
film starts with its last picture, so that programs that show only the first picture show the result.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from auvbench import cli
from auvbench.config.compose import compose
from auvbench.config.validate import evaluate_config
from auvbench.envs.rendering import tolerance
from auvbench.evaluation.replay import Replay, replay
from auvbench.runs.directory import find_runs

TARGET = Path(__file__).parents[1] / "docs" / "assets" / "hero.gif"
EPISODE = 1
"""episode whose times are near the means of 500 waypoints"""
SPEED = 2.5
"""seconds of the episode in a second of the film"""
RATE = 12
"""pictures per second"""
WATER, GRID, INK, MUTED = "#0b2a3f", "#1d4763", "#ffffff", "#9fc3d8"
AGENTS = {"mpc": ("MPC", "#ffb000"), "pid": ("PID", "#ffffff"), "ppo": ("PPO", "#4cc9f0")}
BODY = np.array([0.457, 0.338, 0.254]) * 4
"""m, length, width and height of a BlueROV2, which is drawn larger"""
TURN, TILT = np.radians(5.0), np.radians(25.0)
"""direction of view, rad: angle about the vertical axis, and angle above the horizon"""

Floats = NDArray[np.float64]


def main() -> None:
    """Train the three agents and draw their film."""
    with TemporaryDirectory() as folder:
        words = ["train", "-m", "experiment=quickstart", f"output={folder}"]
        if code := cli.main(words):
            raise SystemExit(code)
        film(Path(folder))


def film(folder: Path) -> None:
    """Write the film of an experiment's folder, with one run of each agent."""
    protocol = evaluate_config(compose("evaluate", ["protocol=test"])).protocol
    runs = {
        run.check()["algo"]["name"]: run
        for run in sorted(find_runs([folder]), key=lambda run: run.id, reverse=True)
    }
    episodes = {name: replay(runs[name], protocol, "nominal", EPISODE) for name in AGENTS}
    write(TARGET, episodes, _picture, SPEED, RATE, colours=96)


def write(
    target: Path,
    episodes: dict[str, Replay],
    picture: Callable[[dict[str, Replay], float], Image.Image],
    speed: float,
    rate: int,
    colours: int,
) -> None:
    """Write a film of episodes that begin together.

    Args:
        target: file.
        episodes: by agent.
        picture: function that draws the episodes at a time in s.
        speed: seconds of the episodes in a second of the film.
        rate: pictures per second.
        colours: of all pictures.
    """
    longest = max(float(episode.time[-1]) for episode in episodes.values())
    times = np.arange(0.0, longest, speed / rate)
    frames = [picture(episodes, float(time)) for time in (longest, *times)]
    palette = frames[0].quantize(colours)
    small = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    durations = [2500, *[1000 // rate] * len(times)]
    small[0].save(target, save_all=True, append_images=small[1:], duration=durations, loop=0, optimize=True)
    print(f"wrote {target}")


def drawn(figure: Figure) -> Image.Image:
    """Return a figure as a picture."""
    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    return Image.fromarray(np.array(canvas.buffer_rgba())[..., :3])


def _project(points: Any) -> Floats:
    """Return places (..., 3) m, z up, on the picture plane (..., 2) m."""
    x, y, z = np.moveaxis(np.asarray(points, dtype=np.float64), -1, 0)
    right = x * np.cos(TURN) - y * np.sin(TURN)
    away = x * np.sin(TURN) + y * np.cos(TURN)
    return np.stack([right, z * np.cos(TILT) + away * np.sin(TILT)], axis=-1)


def _picture(episodes: dict[str, Replay], time: float) -> Image.Image:
    """Draw the race at a time (s) as 880 x 440 pixels."""
    figure = Figure(figsize=(8.8, 4.4), dpi=100, facecolor=WATER)
    axes: Any = figure.add_axes((0.0, 0.0, 0.7, 1.0))
    axes.set(aspect="equal")
    axes.set_axis_off()
    waypoint = np.asarray(next(iter(episodes.values())).waypoint, dtype=np.float64)
    floor = _floor(axes, episodes, waypoint)
    for name, (title, colour) in AGENTS.items():
        episode = episodes[name]
        step = int(np.searchsorted(episode.time, time, side="right")) - 1
        way = np.asarray(episode.position[: step + 1], dtype=np.float64)
        shadow = way.copy()
        shadow[:, 2] = floor
        axes.plot(*_project(shadow).T, color="#061a28", linewidth=2.5, zorder=1)
        axes.plot(*_project(way).T, color=colour, linewidth=3, zorder=3)
        _body(axes, way[-1], float(episode.yaw[step]), colour)
        row = list(AGENTS).index(name)
        done = time >= episode.time[-1]
        seconds = min(time, float(episode.time[-1]))
        y = 0.62 - 0.19 * row
        figure.text(0.7, y, title, color=colour, fontsize=27, fontweight="bold")
        figure.text(
            0.97, y, f"{seconds:.1f} s", color=INK if done else MUTED, fontsize=27, ha="right",
            fontweight="bold" if done else "normal",
        )  # fmt: skip
    figure.text(0.7, 0.84, "time to the waypoint", color=MUTED, fontsize=17)
    return drawn(figure)


def _floor(axes: Any, episodes: dict[str, Replay], waypoint: Floats) -> float:
    """Draw the waypoint, and a grid of 5 m below it; return the grid's z (m)."""
    radius = tolerance(next(iter(episodes.values())).config.task)
    places = np.vstack(
        [*(episode.position for episode in episodes.values()), waypoint - radius, waypoint + radius]
    )
    low, high = places.min(0), places.max(0)
    floor = float(low[2]) - 1.0
    a, b = np.floor(low[:2] / 5) * 5, np.ceil(high[:2] / 5) * 5
    for x in np.arange(a[0], b[0] + 1, 5):
        axes.plot(*_project([[x, a[1], floor], [x, b[1], floor]]).T, color=GRID, linewidth=1, zorder=0)
    for y in np.arange(a[1], b[1] + 1, 5):
        axes.plot(*_project([[a[0], y, floor], [b[0], y, floor]]).T, color=GRID, linewidth=1, zorder=0)
    angle = np.linspace(0, 2 * np.pi, 60)
    ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1) * radius
    axes.fill(*_project([*(ring * [1, 1, 0] + [*waypoint[:2], floor])]).T, color="#061a28", zorder=0.5)
    centre = _project(waypoint)
    axes.fill(*(centre + ring[:, :2]).T, color="#7ae582", alpha=0.28, zorder=2, linewidth=0)
    axes.plot(*(centre + ring[:, :2]).T, color="#7ae582", linewidth=2, zorder=2)
    axes.plot(*centre, "+", color="#7ae582", markersize=12, markeredgewidth=2, zorder=2)
    return floor


def _body(axes: Any, position: Floats, yaw: float, colour: str) -> None:
    """Draw a vehicle: a box with a lighter bow."""
    c, s = np.cos(yaw), np.sin(yaw)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    x, y, z = BODY / 2
    faces = {
        "top": [(x, y, z), (x, -y, z), (-x, -y, z), (-x, y, z)],
        "port": [(x, y, z), (x, y, -z), (-x, y, -z), (-x, y, z)],
        "starboard": [(x, -y, z), (x, -y, -z), (-x, -y, -z), (-x, -y, z)],
        "stern": [(-x, y, z), (-x, y, -z), (-x, -y, -z), (-x, -y, z)],
        "bow": [(x, y, z), (x, y, -z), (x, -y, -z), (x, -y, z)],
    }
    towards = np.array([-np.sin(TURN) * np.cos(TILT), -np.cos(TURN) * np.cos(TILT), np.sin(TILT)])
    for name, corners in faces.items():
        points = np.array(corners) @ turn.T
        if points.mean(0) @ towards > 0:  # the side faces the viewer
            look = {"top": colour, "bow": "#333333"}.get(name, "#5b7f96")
            axes.fill(*_project(points + position).T, color=look, zorder=4, ec="#061a28", linewidth=0.8)


if __name__ == "__main__":
    main()
