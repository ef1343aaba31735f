"""Draw PPO with a sonar and PID on the shortest way through one field of obstacles, docs/assets/field.gif (part of `make gallery`).

    python -m benchmarks.field_film

It trains PPO for some minutes. Seen from above; the film starts with its last picture, as hero.gif does.
"""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from PIL import Image

from auvbench import cli
from auvbench.config.compose import compose
from auvbench.config.validate import evaluate_config
from auvbench.evaluation.replay import Replay, replay
from auvbench.runs.directory import find_runs
from benchmarks.hero import INK, WATER, drawn, write

TARGET = Path(__file__).parents[1] / "docs" / "assets" / "field.gif"
CONDITION, EPISODE = "density=0.03", 3
SPEED, RATE = 5.0, 8
"""seconds of the episode in a second of the film, and pictures per second"""
SIDE = 4.0
"""m round both ways"""
AGENTS = {"pid": ("PID, shortest way on the map", "#ffffff"), "ppo": ("PPO, multibeam sonar", "#4cc9f0")}
HULL = np.array([[0.45, 0.0], [0.2, 0.25], [-0.3, 0.25], [-0.3, -0.25], [0.2, -0.25]]) * 1.5
"""m, a vehicle from above, bow first, drawn larger"""


def main() -> None:
    """Train both agents and draw their film."""
    with TemporaryDirectory() as folder:
        for words in (["task=transit_map", "algo=pid"], ["task=transit", "algo=ppo_transit", "seed=300"]):
            if code := cli.main(["train", *words, f"output={folder}"]):
                raise SystemExit(code)
        film(Path(folder))


def film(folder: Path) -> None:
    """Write the film of a folder with a run of PID and one of PPO."""
    protocol = evaluate_config(compose("evaluate", ["protocol=transit"])).protocol
    runs = {run.check()["algo"]["agent"]: run for run in find_runs([folder])}
    episodes = {name: replay(runs[name], protocol, CONDITION, EPISODE) for name in AGENTS}
    write(TARGET, episodes, _picture, SPEED, RATE, colours=48)


def _picture(episodes: dict[str, Replay], time: float) -> Image.Image:
    """Draw the field at a time (s) as 760 x 420 pixels, with the line from the start to the goal to the right."""
    figure = Figure(figsize=(7.6, 4.2), dpi=100, facecolor=WATER)
    axes: Any = figure.add_axes((0.0, 0.0, 1.0, 0.84))
    axes.set(aspect="equal")
    axes.set_axis_off()
    first = next(iter(episodes.values()))
    start = np.asarray(first.position[0])[:2]
    c, s = (first.waypoint[:2] - start) / np.linalg.norm(first.waypoint[:2] - start)
    turn = np.array([[c, -s], [s, c]])
    ways = {name: (np.asarray(episode.position)[:, :2] - start) @ turn for name, episode in episodes.items()}
    places = np.vstack([*ways.values()])
    low, high = places.min(0) - SIDE, places.max(0) + SIDE
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    solids = (np.asarray(first.outlines)[:, :, :2] - start) @ turn
    axes.add_collection(LineCollection(list(solids), colors="#e9a15b", linewidths=0.8, zorder=1))
    radius = first.config.task.goal_radius  # type: ignore[attr-defined]
    angle = np.linspace(0.0, 2.0 * np.pi, 60)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1) * radius + (first.waypoint[:2] - start) @ turn
    axes.fill(*ring.T, color="#7ae582", alpha=0.5, zorder=2)
    for row, (name, (title, colour)) in enumerate(AGENTS.items()):
        episode = episodes[name]
        step = int(np.searchsorted(episode.time, time, side="right")) - 1
        way = ways[name][: step + 1]
        axes.plot(*way.T, color=colour, linewidth=2, zorder=3)
        bow = np.array([np.cos(episode.yaw[step]), np.sin(episode.yaw[step])]) @ turn
        axes.fill(*(HULL @ np.array([bow, [-bow[1], bow[0]]]) + way[-1]).T, color=colour, zorder=4)
        done = time >= episode.time[-1]
        seconds = min(time, float(episode.time[-1]))
        ends = f" {episode.record['outcome']}" if done else ""
        text = f"{title}: {seconds:.1f} s{ends}"
        figure.text(0.03, 0.92 - 0.07 * row, text, color=colour, fontsize=13)
    figure.text(0.03, 0.06, "10 m", color=INK, fontsize=11)
    axes.plot([low[0] + 1.0, low[0] + 11.0], [low[1] + 0.8] * 2, color=INK, linewidth=2)
    return drawn(figure)


if __name__ == "__main__":
    main()
