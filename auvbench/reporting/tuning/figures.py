"""Figures of a study: its history, its rungs, what mattered, and where the good trials lie."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from auvbench.reporting.figures import style
from auvbench.reporting.figures.model import Figure
from auvbench.reporting.figures.scene import Drawing
from auvbench.reporting.tuning import over_keys, over_trials
from auvbench.tuning.outcome import Outcome

FIGURES: dict[str, Callable[[Outcome], Drawing | None]] = {
    "history": over_trials.history,
    "importances": over_keys.importances,
    "slices": over_keys.slices,
    "parallel": over_keys.parallel,
    "rungs": over_trials.climbing,
}
"""by file name, in the order of the page; one that has nothing to show returns None"""


def draw(found: Outcome, out: Path) -> list[Figure]:
    """Draws what the study allows into `out`/figures, PNG and SVG."""
    figures = []
    for name, drawn in FIGURES.items():
        with style.styled():
            drawing = drawn(found)
            if drawing is None:
                for suffix in (".png", ".svg"):
                    (out / "figures" / name).with_suffix(suffix).unlink(missing_ok=True)
                continue
            png, svg = style.save(drawing.canvas, out / "figures" / name)
        figures.append(Figure(name, drawing.title, drawing.caption, png, svg))
    return figures
