"""Figures inside the page: each as a data URI, the sharp SVG where it is small and the PNG otherwise."""

from __future__ import annotations

import base64
from collections.abc import Iterable
from dataclasses import dataclass

from PIL import Image  # matplotlib's own

from auvbench.analysis.records import Problem
from auvbench.reporting.figures import Figure
from auvbench.reporting.page.links import Links

LARGEST_SVG = 150_000
"""bytes; the PNG of a larger SVG is shown, because a browser draws thousands of points slowly"""
WIDE = 1200
"""px of a PNG from which a figure takes the whole width of the page"""
BUDGET = 4_000_000
"""bytes of all figures; what does not fit is linked instead"""


@dataclass(frozen=True, slots=True)
class Embedded:
    """A figure as the template draws it."""

    name: str
    title: str
    caption: str
    data: str
    """data URI; '' where the figure is only linked"""
    href: str
    """link to the file of the figure"""
    size: tuple[int, int]
    """width and height of the PNG, px: the room to keep before the picture is there"""

    @property
    def wide(self) -> bool:
        """Whether half the page's width is too little."""
        return self.size[0] > WIDE


def embed(
    figures: Iterable[Figure], links: Links, *, budget: int = BUDGET
) -> tuple[list[Embedded], list[Problem]]:
    """Return the figures in their order; one whose files are missing becomes a `Problem`."""
    found: list[Embedded] = []
    problems: list[Problem] = []
    for figure in figures:
        try:
            with Image.open(figure.png) as image:
                size = image.size
            small = figure.svg.stat().st_size <= LARGEST_SVG
            content = (figure.svg if small else figure.png).read_bytes()
        except OSError as error:
            message = f"the figure's files cannot be read: {error.strerror or error}"
            problems.append(Problem(where=figure.name, kind="missing", message=message))
            continue
        data = ""
        if len(content) <= budget:
            budget -= len(content)
            kind = "svg+xml" if small else "png"
            data = f"data:image/{kind};base64,{base64.b64encode(content).decode('ascii')}"
        found.append(Embedded(figure.name, figure.title, figure.caption, data, links.to(figure.svg), size))
    return found, problems
