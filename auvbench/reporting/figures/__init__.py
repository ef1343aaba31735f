"""The figures of a report: each is a small function that draws a scene."""

from auvbench.reporting.figures.draw import FIGURES, draw_all
from auvbench.reporting.figures.scene import MAIN, Figure
from auvbench.reporting.figures.style import colour_of

__all__ = ["FIGURES", "MAIN", "Figure", "colour_of", "draw_all"]
