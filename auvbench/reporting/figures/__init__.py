"""The figures of a report: each is a small function that draws a scene."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from auvbench import integrations, registry
from auvbench.analysis.records import Agent, Problem, Ranking
from auvbench.reporting.figures import difference, style, testing, training
from auvbench.reporting.figures.scene import MAIN, Drawing, Figure, Scene, scene
from auvbench.reporting.figures.style import colour_of

__all__ = ["FIGURES", "MAIN", "Figure", "colour_of", "draw", "draw_all"]


def _late(code: str) -> Callable[[Scene], Drawing | None]:
    """Return a figure of an integration, which imports its code when it is drawn."""
    return lambda scene: registry.resolve(code)(scene)


FIGURES: dict[str, Callable[[Scene], Drawing | None]] = {
    MAIN: difference.difference_from_baseline,
    "success_over_grid": testing.success_over_grid,
    "success_over_time": testing.success_over_time,
    "steps_deviation": testing.steps_deviation,
    "success_over_conditions": testing.success_over_conditions,
    **{name: _late(code) for name, code in integrations.FIGURES.items()},
    "training_success": training.success,
    "validation_success": training.validation,
    "training_curves": training.length_and_return,
}
"""figures by file name, in the order of the report; each function returns None if it has nothing to show"""


def draw_all(agents: Sequence[Agent], ranking: Ranking, out: Path) -> tuple[list[Figure], list[Problem]]:
    """Draw every figure that the data allow into `out`/figures, and remove stale ones.

    Returns:
        Figures as PNG and SVG, and the damage found while drawing.
    """
    shared = scene(agents, ranking)
    drawn = _draw(shared, list(FIGURES), out / "figures")
    for name in FIGURES.keys() - {figure.name for figure in drawn}:
        for suffix in (".png", ".svg"):
            (out / "figures" / name).with_suffix(suffix).unlink(missing_ok=True)
    return drawn, list(dict.fromkeys(shared.problems))


def draw(names: Sequence[str], agents: Sequence[Agent], ranking: Ranking, folder: Path) -> list[Figure]:
    """Draw the named figures into a folder, except those that the data do not allow."""
    return _draw(scene(agents, ranking), names, folder)


def _draw(shared: Scene, names: Sequence[str], folder: Path) -> list[Figure]:
    figures = []
    for name in names:
        with style.styled():
            drawing = FIGURES[name](shared)
            if drawing is not None:
                png, svg = style.save(drawing.canvas, folder / name)
                figures.append(Figure(name, drawing.title, drawing.caption, png, svg))
    return figures
