"""Draws the figures of a report, in the order in which a reader wants them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from auvbench.reporting.figures import matrices, paths, robustness, style, testing, training
from auvbench.reporting.figures.model import Figure
from auvbench.reporting.figures.scene import Drawing, Scene, scene
from auvbench.reporting.model import Agent, Ranking, RunRecord

FIGURES: dict[str, Callable[[Scene], Drawing | None]] = {
    "success_over_grid": matrices.success_over_grid,
    "success_over_time": testing.success_over_time,
    "performance_profiles": testing.performance_profiles,
    "improvement": matrices.improvement,
    "steps_deviation": testing.steps_deviation,
    "trajectories": paths.trajectories,
    "failures": testing.failures,
    "cumulative_means": testing.cumulative_means,
    "robustness": robustness.curves,
    "training_curves": training.curves,
    "training_outcomes": training.reward_by_outcome,
    "training_logs": training.logs,
}
"""by file name; one that has nothing to show returns None"""


def draw_all(runs: Sequence[RunRecord], agents: Sequence[Agent], ranking: Ranking, out: Path) -> list[Figure]:
    """Draws every figure that the data allow into `out`/figures.

    Args:
        runs: the loaded runs.
        agents: those of the ranking, in any order.
        ranking: gives the order and the intervals.
        out: the folder of the report.

    Returns:
        the figures, PNG and SVG, with titles and captions.
    """
    figures = []
    shared = scene(agents, ranking)
    for name, draw in FIGURES.items():
        with style.styled():
            drawing = draw(shared)
            if drawing is None:
                continue
            png, svg = style.save(drawing.canvas, out / "figures" / name)
        figures.append(Figure(name, drawing.title, drawing.caption, png, svg))
    return figures
