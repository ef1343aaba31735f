"""Draw a picture of each world, docs/assets/worlds.png (part of `make gallery`; alone: `python -m benchmarks.world_pictures`)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from auvbench.envs.batch import Batch
from auvbench.envs.settings import configuration
from auvbench.registry import WORLDS
from auvbench.worlds.casting import clearance
from auvbench.worlds.kinds import KINDS

TARGET = Path(__file__).parents[1] / "docs" / "assets" / "worlds.png"
TASK = ("task=docking", "vehicle=bluerov2_2026", "algo=pid", "task.start_low=14", "task.depth_low=-40")
KEYS = {
    "tank": ("world.length=36", "world.width=36", "world.depth=30"),
    "slope": ("world.dip=0.3",),
    "rough": ("world.height=1.5",),
    "seabed": ("task.start_low=14",),
    "field": ("world.density=0.04",),
    "pipeline": ("world.height=0.05", "world.radius=0.6", "world.sway=8", "world.altitude=8"),
}
SPAN, STEPS = 22.0, 240


def section(batch: Batch, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the signed distances (k,) in m of points (k, 3) from the world of the first episode."""
    world = batch.task.world
    assert world is not None
    scene = world.solids[0, : batch.task.episodes[0].solids]
    distances, nearest = np.empty(len(points)), np.empty(len(points), np.int64)
    clearance(scene, world.heights, 0.0, points, 100.0, distances, nearest, np.empty((len(points), 3)))
    return distances


def draw(axes: Any, batch: Batch, vertical: bool) -> None:
    """Draw a section through start and goal, from above or from the side."""
    start, goal = np.array(batch.task.episodes[0].start), batch.task.goal(0)
    along = goal[:2] - start[:2]
    along = along / np.linalg.norm(along)
    a = np.linspace(-SPAN, SPAN, STEPS)
    if vertical:
        b = np.linspace(-40.0, 0.0, STEPS)
        grid = np.array([[*(goal[:2] + s * along), z] for z in b for s in a])
        marks = [((p[:2] - goal[:2]) @ along, p[2]) for p in (start, goal)]
        labels = "m from start to dock", "z in m"
    else:
        b = a
        world = batch.task.world
        assert world is not None
        # A pipeline is far below the dock.
        z = world.solids[0, 1]["position"][2] if world.settings.name == "pipeline" else goal[2]
        grid = np.array([[goal[0] + x, goal[1] + y, z] for y in b for x in a])
        marks = [(p - goal)[:2] for p in (start, goal)]
        labels = "m east of the dock", "m north of the dock"
    distances = section(batch, grid).reshape(STEPS, STEPS)
    axes.contourf(a, b, distances, levels=[-1e3, 0.0], colors=["#6b5a45"])
    axes.contour(a, b, distances, levels=[1.0, 2.0, 4.0, 8.0], colors="#2a7ab0", linewidths=0.5)
    for (x, y), name, marker in zip(marks, ("start", "dock"), "o*", strict=True):
        axes.plot(x, y, marker, color="#c0392b", markersize=7, label=name)
    axes.set(xlabel=labels[0], ylabel=labels[1], aspect="equal")


def main() -> None:
    """Draw each world from above and from the side, at the depth of the dock or the pipe and through start and dock."""
    names = [*(name for name in WORLDS if name not in ("open", "bottom")), "seabed"]
    figure = Figure(figsize=(3.0 * len(names), 6.0), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(2, len(names))
    for column, name in enumerate(names):
        batch = Batch(configuration(overrides=[*TASK, f"world={name}", *KEYS.get(name, ())]), 1, seed=3)
        batch.reset()
        draw(panels[0, column], batch, vertical=False)
        draw(panels[1, column], batch, vertical=True)
        panels[0, column].set_title(f"world={name}")
        kinds = {KINDS[k] for k in batch.task.world.solids[0, : batch.task.episodes[0].solids]["kind"]}  # type: ignore[union-attr]
        panels[1, column].set_title(", ".join(sorted(kinds)), fontsize=9)
    panels[0, 0].legend(loc="upper left", fontsize=8)
    figure.savefig(TARGET, dpi=80)


if __name__ == "__main__":
    main()
