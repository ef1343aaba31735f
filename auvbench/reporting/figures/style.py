"""Define the style of the figures: legends, axes, files; `looks` has the looks of agents."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as Canvas
from matplotlib.lines import Line2D
from matplotlib.ticker import EngFormatter, FixedLocator, NullLocator

from auvbench.envs import rendering
from auvbench.reporting.figures.looks import Look
from auvbench.runs.atomic_io import write_atomic

METADATA: dict[str, dict[str, None]] = {"png": {"Software": None}, "svg": {"Date": None, "Creator": None}}
"""metadata by file format; None removes an entry whose value would depend on the date or the version"""
OUTCOME_LOOK = {
    "success": ("#009E73", "o"),
    "collision": ("#D55E00", "X"),
    "timeout": ("#0072B2", "s"),
    "out_of_bounds": ("#CC79A7", "D"),
}
"""colour and marker of each outcome in all figures"""

DPI = 150

_RC: Any = rendering.LOOK | {
    "legend.frameon": False,
    "lines.markersize": 5,
    "svg.fonttype": "none",  # keep text as text: smaller files, searchable
    "svg.hashsalt": "auvbench",  # fixed, so that the same figure has the same bytes
    "path.simplify": True,
    "text.parse_math": False,  # a dollar sign in a label does not start a formula
}


@contextmanager
def styled() -> Iterator[None]:
    """Apply the style of the figures, and restore the caller's style on exit."""
    with rendering.own_style(_RC):
        yield


def canvas(width: float, height: float) -> Canvas:
    """Return an empty figure of a size in inches. It is not made by pyplot, which would keep a reference to the figure."""
    figure = Canvas(figsize=(width, height), dpi=DPI, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def title(ax: Axes, text: str) -> None:
    """Set a panel's title with line breaks."""
    ax.set_title(textwrap.fill(text, 26, break_long_words=False), loc="left")


def save(figure: Canvas, path: Path) -> tuple[Path, Path]:
    """Write `path`.png and `path`.svg atomically, and return the two paths; `path` may contain dots: current=0.5."""
    if engine := figure.get_layout_engine():
        engine.execute(figure)  # compute the layout once for the two formats
    # Remove the layout engine: savefig draws everything twice if the figure has one, even the engine "none".
    figure.set_layout_engine(None)
    png, svg = (path.with_name(path.name + suffix) for suffix in (".png", ".svg"))
    pictures = {kind: drawn(figure, kind) for kind in METADATA}  # draw both pictures before writing a file
    write_atomic(png, pictures["png"], sync_folder=False)
    write_atomic(svg, pictures["svg"])
    return png, svg


def drawn(figure: Canvas, kind: str) -> bytes:
    """Return the content of a figure's file; `kind` is png or svg."""
    stream = io.BytesIO()
    figure.savefig(stream, format=kind, metadata=METADATA[kind])
    return stream.getvalue()


def legend(figure: Canvas, looks: dict[str, Look], *, lines: bool = True, markers: bool = True) -> None:
    """Add one legend under the panels, in as many columns as fit."""
    handles = [
        Line2D(
            [],
            [],
            color=look.colour,
            marker=look.marker if markers else "",
            linestyle=look.linestyle if lines else "",
            label=label,
        )
        for label, look in looks.items()
    ]
    length = max(map(len, looks), default=1)
    columns = max(1, min(len(handles), int(figure.get_figwidth() / (0.08 * length + 0.75))))
    rows = -(-len(handles) // columns)
    columns = -(-len(handles) // rows)  # evenly filled rows: 3 + 3, not 5 + 1
    figure.legend(
        handles=handles, loc="outside lower center", ncols=columns, handlelength=3.2 if lines else 1.5
    )


def engineering(axis: Any) -> None:
    """Format the ticks of an axis with prefixes: 250k for 250000."""
    axis.set_major_formatter(EngFormatter(sep=""))


def symlog(ax: Axes) -> None:
    """Scale an axis of returns for K = 1 and K = 100: linear up to ±1000, logarithmic beyond."""
    ax.set_yscale("symlog", linthresh=1000)
    powers = [1e3, 1e4, 1e5, 1e6]
    ax.yaxis.set_major_locator(FixedLocator([*(-p for p in reversed(powers)), 0.0, *powers]))
    ax.yaxis.set_minor_locator(NullLocator())
    engineering(ax.yaxis)
