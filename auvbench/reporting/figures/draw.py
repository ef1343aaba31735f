"""Draws the figures of a report, in the order in which a reader wants them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from auvbench.analysis.model import Agent, Problem, Ranking, RunRecord
from auvbench.analysis.processes import beside
from auvbench.reporting.figures import (
    conditions,
    difference,
    learning,
    matrices,
    paths,
    style,
    testing,
    training,
)
from auvbench.reporting.figures.model import Figure
from auvbench.reporting.figures.scene import Drawing, Scene, scene

FIGURES: dict[str, Callable[[Scene], Drawing | None]] = {
    "difference_from_baseline": difference.difference_from_baseline,
    "success_over_grid": matrices.success_over_grid,
    "success_over_time": testing.success_over_time,
    "performance_profiles": testing.performance_profiles,
    "improvement": matrices.improvement,
    "steps_deviation": testing.steps_deviation,
    "trajectories": paths.trajectories,
    "failures": testing.failures,
    "cumulative_means": testing.cumulative_means,
    "success_over_conditions": matrices.success_over_conditions,
    "robustness": conditions.robustness,
    "frequency_sweep": conditions.frequency_sweep,
    "transfer": conditions.transfer,
    "gazebo": conditions.gazebo,
    "training_success": learning.success,
    "validation_success": learning.validation,
    "training_curves": training.curves,
    "training_outcomes": training.reward_by_outcome,
    "training_logs": training.logs,
}
"""by file name; one that has nothing to show returns None"""

SECOND_PROCESS = (
    "training_success",
    "validation_success",
    "training_curves",
    "training_outcomes",
    "training_logs",
    "trajectories",
)
"""About half of the work; those that read the training records stand together, so that they are read once."""


def draw_all(
    runs: Sequence[RunRecord], agents: Sequence[Agent], ranking: Ranking, out: Path
) -> tuple[list[Figure], list[Problem]]:
    """Draws every figure that the data allow into `out`/figures.

    Args:
        runs: the loaded runs.
        agents: those of the ranking, in any order.
        ranking: gives the order and the intervals.
        out: the folder of the report.

    Returns:
        the figures, PNG and SVG, with titles and captions, and what was found damaged while drawing.
    """
    shared = scene(agents, ranking)
    names = list(FIGURES)
    with beside(lambda: _draw(shared, SECOND_PROCESS, out)) as rest:
        drawn, found = _draw(shared, [name for name in names if name not in SECOND_PROCESS], out)
        more, problems = rest()
    drawn |= more
    for name in names:
        if name not in drawn:  # an earlier report's, of other runs
            for suffix in (".png", ".svg"):
                (out / "figures" / name).with_suffix(suffix).unlink(missing_ok=True)
    # Without a second process both lists are that of the one scene.
    distinct = list(dict.fromkeys([*found, *problems]))
    return [drawn[name] for name in names if name in drawn], distinct


def draw(names: Sequence[str], agents: Sequence[Agent], ranking: Ranking, out: Path) -> list[Figure]:
    """Draws the named figures into `out`/figures; one that the data do not allow is not among them."""
    drawn, _ = _draw(scene(agents, ranking), names, out)
    return list(drawn.values())


def _draw(shared: Scene, names: Sequence[str], out: Path) -> tuple[dict[str, Figure], list[Problem]]:
    figures = {}
    for name in names:
        with style.styled():
            drawing = FIGURES[name](shared)
            if drawing is None:
                continue
            png, svg = style.save(drawing.canvas, out / "figures" / name)
        figures[name] = Figure(name, drawing.title, drawing.caption, png, svg)
    return figures, shared.problems
