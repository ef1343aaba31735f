"""Figures inside the page: each as a data URI, the sharp SVG where it is small and the PNG otherwise."""

from __future__ import annotations

import base64
import struct
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from auvbench.analysis.records import Problem
from auvbench.reporting.page.links import Links

if TYPE_CHECKING:  # drawing needs matplotlib, showing does not
    from auvbench.reporting.figures import Figure

LARGEST_SVG = 150_000
"""bytes; a larger SVG (a scatter of thousands of points) is slow to draw, so its PNG is taken"""
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
    files: tuple[tuple[str, str], ...]
    """(kind, relative link) of the files next to the page"""
    size: tuple[int, int] | None = None
    """width and height of the PNG, px: the room to keep before the picture is there"""

    @property
    def wide(self) -> bool:
        """Several panels side by side, unreadable in half the page's width."""
        return self.size is not None and self.size[0] > WIDE


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
        found.append(Embedded(figure.name, figure.title, figure.caption, data, files, _size(figure.png)))
    return found, problems


def _size(png: Path) -> tuple[int, int] | None:
    """Width and height from the header of a PNG (ISO/IEC 15948, 11.2.2), None where there is none."""
    if not png.is_file():
        return None
    with png.open("rb") as file:
        head = file.read(24)
    if len(head) < 24 or head[:8] != b"\x89PNG\r\n\x1a\n":
        return None
    width, height = struct.unpack(">II", head[16:])
    return width, height


def _choose(there: list[tuple[str, Path, str]]) -> tuple[str, Path, str]:
    first = there[0]
    if first[0] == "SVG" and first[1].stat().st_size > LARGEST_SVG and len(there) > 1:
        return there[1]
    return first
