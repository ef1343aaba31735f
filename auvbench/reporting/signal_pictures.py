"""Draw the signals of an episode over time, and write them as a table."""

from __future__ import annotations

from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from auvbench.errors import UserError
from auvbench.evaluation.signals import ATTITUDE, Panel, Signals
from auvbench.reporting.figures import style
from auvbench.reporting.figures.looks import palette
from auvbench.runs.atomic_io import check_writable, write_atomic

KINDS = (".png", ".svg", ".csv")
WIDTH, HEIGHT = 10.4, 1.35
"""width of the figure, and height of a row of panels, inches"""
MOST = 8
"""largest number of lines in a panel with a legend"""


def check(path: Path) -> None:
    """Check that signals can be written to a file.

    Raises:
        UserError: the suffix is not one of `KINDS`, or the path is a folder or not writable.
    """
    if path.suffix.lower() not in KINDS:
        raise UserError(f"--signals {path}: must end in .png, .svg or .csv")
    check_writable(path, f"--signals {path}")


def write(signals: Signals, path: Path, about: str) -> None:
    """Write signals as a picture (.png, .svg) or as a table (.csv); `about` is the title."""
    kind = path.suffix.lower()
    if kind == ".csv":
        write_atomic(path, signals.table.to_csv(index=False, float_format="%.9g").encode())
        return
    with style.styled():
        write_atomic(path, style.drawn(draw(signals, about), kind.removeprefix(".")))


def draw(signals: Signals, about: str) -> Any:
    """Return a figure with the vehicle's motion on the left, and the agent's observations on the right."""
    pairs = list(zip_longest(signals.motion, signals.observed))
    figure = style.canvas(WIDTH, HEIGHT * len(pairs) + 0.5)
    axes = figure.subplots(len(pairs), 2, sharex=True, squeeze=False)
    for row, panels in zip(axes, pairs, strict=True):
        for ax, panel in zip(row, panels, strict=True):
            if panel is None:
                ax.set_axis_off()
            else:
                _panel(ax, signals, panel)
    for column in range(2):
        last = [pair[column] is not None for pair in pairs].count(True) - 1
        if last >= 0:
            axes[last, column].set_xlabel("time (s)")
            axes[last, column].tick_params(labelbottom=True)
    figure.suptitle(about, x=0.01, ha="left", fontsize=10)
    return figure


def _panel(ax: Any, signals: Signals, panel: Panel) -> None:
    table, time = signals.table, signals.table["t_s"].to_numpy()
    colours = palette(len(panel.columns))
    is_command = panel.columns[0].endswith("_cmd")
    for name, label, colour in zip_longest(panel.columns, panel.labels, colours):
        values = table[name].to_numpy()
        if name in ATTITUDE:
            values = np.degrees(np.unwrap(values))
        ax.plot(
            time,
            values,
            color=colour,
            linewidth=0.9,
            label=label,
            drawstyle="steps-post" if is_command else "default",
        )
    for name, colour in zip(panel.dashed, colours, strict=False):
        ax.plot(time, table[name].to_numpy(), color=colour, linewidth=0.8, linestyle="--")
    unit = f" ({panel.unit})" if panel.unit else ""
    ax.set_title(f"{panel.title}{unit}", loc="left", fontsize=8)
    ax.margins(x=0.0)
    ax.tick_params(labelsize=7)
    if 1 < len(panel.labels) <= MOST:
        ax.legend(
            fontsize=5.5,
            ncols=2 if len(panel.labels) > 3 else 1,
            loc="center left",
            bbox_to_anchor=(1.0, 0.5),
        )
