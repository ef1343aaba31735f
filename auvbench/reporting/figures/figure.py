"""A drawn figure."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

MAIN = "difference_from_baseline"
"""name of the figure that stands with the main table"""


@dataclass(frozen=True, slots=True)
class Figure:
    """One figure on disk, with what a reader needs to understand it without the text."""

    name: str
    """file name without suffix"""
    title: str
    caption: str
    png: Path
    svg: Path
