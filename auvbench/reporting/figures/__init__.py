"""The figures of a report: each one a small function that draws what it is handed."""

from auvbench.reporting.figures.draw import FIGURES, draw_all
from auvbench.reporting.figures.figure import MAIN, Figure
from auvbench.reporting.figures.style import colour_of

__all__ = ["FIGURES", "MAIN", "Figure", "colour_of", "draw_all"]
