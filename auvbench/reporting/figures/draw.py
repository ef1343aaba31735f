"""Draw the figures of a report, in the order in which they are shown."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from auvbench.analysis.records import Agent, Problem, Ranking, RunRecord
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
from auvbench.reporting.figures.figure import MAIN, Figure
from auvbench.reporting.figures.scene import Drawing, Scene, scene

FIGURES: dict[str, Callable[[Scene], Drawing | None]] = {
    MAIN: difference.difference_from_baseline,
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


def draw_all(
    runs: Sequence[RunRecord], agents: Sequence[Agent], ranking: Ranking, out: Path
) -> tuple[list[Figure], list[Problem]]:
    """Draw every figure that the data allow into `out`/figures.

    Args:
        runs: the loaded runs.
        agents: those of the ranking, in any order.
        ranking: gives the order and the intervals.
        out: the folder of the report.

    Returns:
        the figures, PNG and SVG, with titles and captions, and the damage found while drawing.
    """
    drawn, problems = _draw(scene(agents, ranking), list(FIGURES), out)
    for name in FIGURES.keys() - drawn.keys():  # an earlier report's, of other runs
        for suffix in (".png", ".svg"):
            (out / "figures" / name).with_suffix(suffix).unlink(missing_ok=True)
    return list(drawn.values()), list(dict.fromkeys(problems))


def draw(names: Sequence[str], agents: Sequence[Agent], ranking: Ranking, out: Path) -> list[Figure]:
    """Draw the named figures into `out`/figures; leave out those that the data do not allow."""
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
