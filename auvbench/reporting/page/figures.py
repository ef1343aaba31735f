"""Figures inside the page: each as a data URI, the sharp SVG where it is small and the PNG otherwise."""

from __future__ import annotations

import base64
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from auvbench.reporting.model import Problem
from auvbench.reporting.page.links import Links

if TYPE_CHECKING:  # drawing needs matplotlib, showing does not
    from auvbench.reporting.figures import Figure

LARGEST_SVG = 150_000
"""bytes; a larger SVG (a scatter of thousands of points) is slow to draw, so its PNG is taken"""
BUDGET = 4_500_000
"""bytes of all figures; what does not fit is linked instead"""


@dataclass(frozen=True, slots=True)
class Embedded:
    """A figure as the template draws it."""

    name: str
    title: str
    caption: str
    data: str
    """data URI; '' where the figure is only linked"""
    files: tuple[tuple[str, str], ...]
    """(kind, relative link) of the files beside the page"""


def embed(
    figures: Iterable[Figure], links: Links, *, budget: int = BUDGET
) -> tuple[list[Embedded], list[Problem]]:
    """All figures in their order; one whose files are missing becomes a `Problem`."""
    found: list[Embedded] = []
    problems: list[Problem] = []
    for figure in figures:
        kinds = (("SVG", figure.svg, "image/svg+xml"), ("PNG", figure.png, "image/png"))
        there = [(kind, path, mime) for kind, path, mime in kinds if path.is_file()]
        if not there:
            message = f"the figure's files {figure.svg.name} and {figure.png.name} are not there"
            problems.append(Problem(where=figure.name, kind="missing", message=message))
            continue
        _, path, mime = _choose(there)
        data = ""
        if path.stat().st_size <= budget:
            content = path.read_bytes()
            budget -= len(content)
            data = f"data:{mime};base64,{base64.b64encode(content).decode('ascii')}"
        files = tuple((kind, links.to(path)) for kind, path, _ in there)
        found.append(Embedded(figure.name, figure.title, figure.caption, data, files))
    return found, problems


def _choose(there: list[tuple[str, Path, str]]) -> tuple[str, Path, str]:
    first = there[0]
    if first[0] == "SVG" and first[1].stat().st_size > LARGEST_SVG and len(there) > 1:
        return there[1]
    return first
