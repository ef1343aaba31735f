"""Draw the figures of a report; each figure has a function that draws it from a scene (the data of the report)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from auvbench import integrations
from auvbench.analysis.records import Agent, Problem, Ranking
from auvbench.registry import resolve

if TYPE_CHECKING:
    from auvbench.reporting.figures.scene import Scene

MAIN = "difference_from_baseline"
"""Name of the figure next to the main table"""


@dataclass(frozen=True, slots=True)
class Figure:
    """Figure that was saved as PNG and SVG."""

    name: str
    """file name without suffix"""
    title: str
    caption: str
    png: Path
    svg: Path


_HERE = "auvbench.reporting.figures"
FIGURES: dict[str, str] = {
    MAIN: f"{_HERE}.difference:difference_from_baseline",
    "success_over_grid": f"{_HERE}.testing:success_over_grid",
    "success_over_time": f"{_HERE}.testing:success_over_time",
    "steps_deviation": f"{_HERE}.testing:steps_deviation",
    "success_over_conditions": f"{_HERE}.testing:success_over_conditions",
    **integrations.FIGURES,
    "training_success": f"{_HERE}.training:success",
    "validation_success": f"{_HERE}.training:validation",
    "training_curves": f"{_HERE}.training:length_and_return",
}
"""Functions of the figures by file name, in the order of the report. Each takes a scene, and returns a drawing, or
None if the data do not allow the figure.
"""


def draw_all(agents: Sequence[Agent], ranking: Ranking, out: Path) -> tuple[list[Figure], list[Problem]]:
    """Draw every figure that the data allow into `out`/figures, and remove the files of all other figures.

    Returns:
        Saved figures, and problems with damaged files that the figures needed.
    """
    from auvbench.reporting.figures.scene import scene  # late: a report without figures needs no Matplotlib

    shared = scene(agents, ranking)
    drawn = _draw(shared, list(FIGURES), out / "figures")
    for name in FIGURES.keys() - {figure.name for figure in drawn}:
        for suffix in (".png", ".svg"):
            (out / "figures" / name).with_suffix(suffix).unlink(missing_ok=True)
    return drawn, list(dict.fromkeys(shared.problems))


def draw(names: Sequence[str], agents: Sequence[Agent], ranking: Ranking, folder: Path) -> list[Figure]:
    """Draw the named figures into a folder, except those that the data do not allow."""
    from auvbench.reporting.figures.scene import scene

    return _draw(scene(agents, ranking), names, folder)


def _draw(shared: Scene, names: Sequence[str], folder: Path) -> list[Figure]:
    from auvbench.reporting.figures import style

    figures = []
    for name in names:
        with style.styled():
            drawing = resolve(FIGURES[name])(shared)
            if drawing is not None:
                png, svg = style.save(drawing.canvas, folder / name)
                figures.append(Figure(name, drawing.title, drawing.caption, png, svg))
    return figures
