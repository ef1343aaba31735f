"""Draw the figures of `auvbench identify` and `auvbench validate`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator
from numpy.typing import NDArray

from auvbench.identification.fit import Fit
from auvbench.identification.log import CHANNELS, UNITS
from auvbench.identification.validation import HORIZONS, Validation
from auvbench.reporting.figures import style
from auvbench.reporting.figures.looks import LINESTYLES, MARKERS, Linestyle, Look, palette
from auvbench.reporting.figures.scene import Drawing

SHOWN = 40.0
"""Length of the shown part of the first log, s"""
BEFORE, AFTER, MEASURED = "#D55E00", "#0072B2", "#9a9a9a"


def prediction(fit: Fit) -> Drawing:
    """Draw the measurements of the first log, and the predictions before and after the fit in each window."""
    windows = fit.windows
    channels = list(windows.channels)
    columns = 2 if len(channels) > 1 else 1
    rows = -(-len(channels) // columns)
    with style.styled():
        canvas = style.canvas(10.4, 1.7 * rows + 0.8)
        axes = canvas.subplots(rows, columns, sharex=True, squeeze=False).ravel()
        own = np.flatnonzero((windows.log == 0) & (windows.start < windows.start[0] + SHOWN))
        for ax, channel in zip(axes, channels, strict=False):
            for k in own:
                measured = np.isfinite(windows.measured[k, :, channel])
                time = windows.start[k] + windows.time[k][measured]
                ax.plot(time, windows.measured[k, measured, channel], ".", color=MEASURED, markersize=3)
                for values, colour, line in ((fit.before, BEFORE, "--"), (fit.predicted, AFTER, "-")):
                    ax.plot(time, values[k, measured, channel], line, color=colour, linewidth=1.1)
            ax.set_ylabel(f"{CHANNELS[channel]} ({UNITS[channel]})")
        for ax in axes[len(channels) :]:
            ax.set_visible(False)
        for ax in axes[max(0, len(channels) - columns) : len(channels)]:
            ax.set_xlabel("time (s)")
            ax.tick_params(labelbottom=True)
        _legend(canvas, [("measured", MEASURED, None), ("sheet", BEFORE, "--"), ("identified", AFTER, "-")])
    return Drawing(
        canvas,
        "Measured and predicted",
        f"First log, up to {SHOWN:.0f} s. Each line starts from the measured state of a window of {windows.length:g} s.",
    )


def residuals(fit: Fit) -> Drawing:
    """Draw the root mean square errors before and after the fit over the time since the start of a window."""
    windows = fit.windows
    channels = list(windows.channels)
    columns = min(4, len(channels))
    rows = -(-len(channels) // columns)
    edges = np.linspace(0.0, windows.length, 11)
    place = np.clip(np.digitize(windows.time, edges) - 1, 0, 9)
    with style.styled():
        canvas = style.canvas(10.4, 2.0 * rows + 0.8)
        axes = canvas.subplots(rows, columns, sharex=True, squeeze=False).ravel()
        for ax, channel in zip(axes, channels, strict=False):
            for values, colour, line in ((fit.before, BEFORE, "--"), (fit.predicted, AFTER, "-")):
                error = windows.error(values)[..., channel]
                means = [_rms(error[place == k]) for k in range(10)]
                ax.plot(0.5 * (edges[1:] + edges[:-1]), means, line, color=colour, marker="o", markersize=3)
            ax.set_ylim(bottom=0.0)
            ax.set_title(f"{CHANNELS[channel]} ({UNITS[channel]})", loc="left")
            ax.set_xlabel("time in the window (s)")
        for ax in axes[len(channels) :]:
            ax.set_visible(False)
        _legend(canvas, [("sheet", BEFORE, "--"), ("identified", AFTER, "-")])
    return Drawing(
        canvas, "Residuals", "Root mean square of prediction less measurement over the time in a window."
    )


def parameters(fit: Fit) -> Drawing:
    """Draw the ratio of each fitted number to the sheet's number, with its 95 % interval."""
    shown = [e for e in fit.estimates if e.parameter.log]
    with style.styled():
        canvas = style.canvas(8.0, 0.24 * max(len(shown), 3) + 1.0)
        ax = canvas.subplots()
        for row, estimate in enumerate(shown):
            prior, colour = estimate.parameter.prior, MEASURED if estimate.kept else AFTER
            low, high = (float(np.clip(end / prior, 0.05, 20.0)) for end in (estimate.low, estimate.high))
            ax.plot([low, high], [row, row], "-", color=colour, linewidth=2.0)
            ax.plot(
                [estimate.value / prior], [row], "s" if estimate.kept else "o", color=colour, markersize=5
            )
        ax.axvline(1.0, color=MEASURED, linestyle="--", linewidth=1.0)
        ax.set_xscale("log")
        ticks = [0.1, 0.25, 0.5, 1.0, 2.0, 4.0, 10.0]
        ax.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
        ax.set_xticks([], minor=True)
        ax.set_yticks(range(len(shown)), [e.parameter.name for e in shown])
        ax.invert_yaxis()
        ax.set_xlabel("fitted number / sheet's number")
    return Drawing(
        canvas,
        "Numbers of the sheet before and after",
        "95 % intervals. A grey square stays at the sheet's number, because the logs do not identify it.",
    )


def errors(result: Validation) -> Drawing:
    """Draw the prediction errors over the horizon, for each measured channel and predictor."""
    rms = [prediction.rms() for prediction in result.predictions]
    channels = [CHANNELS.index(name) for name in result.channels]
    columns = min(4, len(channels))
    rows = -(-len(channels) // columns)
    colours = palette(len(rms))
    with style.styled():
        canvas = style.canvas(10.4, 2.1 * rows + 1.0)
        axes = canvas.subplots(rows, columns, sharex=True, squeeze=False).ravel()
        for ax, channel in zip(axes, channels, strict=False):
            for k, table in enumerate(rms):
                ax.plot(
                    HORIZONS,
                    table[:, channel],
                    LINESTYLES[k % 4],
                    color=colours[k],
                    marker=MARKERS[k % len(MARKERS)],
                    markersize=3,
                )
            _log_scales(ax)
            ax.set_title(f"{CHANNELS[channel]} ({UNITS[channel]})", loc="left")
            ax.set_xlabel("horizon (s)")
        for ax in axes[len(channels) :]:
            ax.set_visible(False)
        looks = {
            prediction.name: Look(colours[k], MARKERS[k % len(MARKERS)], LINESTYLES[k % 4])
            for k, prediction in enumerate(result.predictions)
        }
        style.legend(canvas, looks)
    return Drawing(canvas, "Errors over the horizon", "Root mean square of prediction less measurement.")


def _log_scales(ax: Axes) -> None:
    ax.set_xscale("log")
    if ax.lines and any(np.nanmax(np.nan_to_num(line.get_ydata())) > 0.0 for line in ax.lines):
        ax.set_yscale("log")
        ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        ax.yaxis.set_minor_locator(NullLocator())
    ax.set_xticks(HORIZONS, [f"{horizon:g}" for horizon in HORIZONS], fontsize=7)
    ax.set_xticks([], minor=True)


def _rms(error: NDArray[np.float64]) -> float:
    error = error[np.isfinite(error)]
    return float(np.sqrt(np.mean(error**2))) if error.size else float("nan")


def _legend(canvas: Canvas, entries: Sequence[tuple[str, str, Linestyle | None]]) -> None:
    """Add a legend with entries (label, colour, line style); the line style None means points."""
    handles = [
        Line2D([], [], color=colour, linestyle=line or "", marker="" if line else ".", label=label)
        for label, colour, line in entries
    ]
    canvas.legend(handles=handles, loc="outside lower center", ncols=len(handles))
