"""Draw a trajectory: position, attitude and velocity over time."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from auvbench.simulators.openloop import Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Okabe and Ito's palette, which colour-blind readers can distinguish; line styles are for print.
_STYLES = (("#0072B2", "-"), ("#D55E00", "--"), ("#009E73", "-."))


def draw(trajectory: Trajectory, path: Path, title: str = "") -> None:
    """Write `trajectory` to `path`, a .png, .svg or .pdf file."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    rows = trajectory.rows()
    time, position, angles, velocity = rows[:, 0], rows[:, 1:4], np.degrees(rows[:, 4:7]), rows[:, 7:]
    vertical = "down" if trajectory.frame == "ned" else "up"
    world = "north, east, down" if trajectory.frame == "ned" else "east, north, up"
    figure, axes = plt.subplots(2, 2, figsize=(10, 7), layout="constrained", sharex=True)
    _lines(axes[0, 0], time, position, ("x", "y", f"z ({vertical})"), "position, m")
    _lines(axes[0, 1], time, angles, ("roll", "pitch", "yaw"), "attitude, deg")
    _lines(axes[1, 0], time, velocity[:, :3], ("u surge", "v sway", "w heave"), "velocity, m/s")
    _lines(axes[1, 1], time, np.degrees(velocity[:, 3:]), ("p roll", "q pitch", "r yaw"), "rate, deg/s")
    for ax in axes[1]:
        ax.set_xlabel("time, s")
    # A sheet's title with dollar signs is no formula.
    heading = f"{title}   (world {world}; {len(time)} samples)"
    figure.suptitle(heading, fontsize=11).set_parse_math(False)
    figure.savefig(path, dpi=150)
    plt.close(figure)


def _lines(ax: Axes, time: np.ndarray, values: np.ndarray, names: tuple[str, ...], label: str) -> None:
    for column, (name, (colour, style)) in enumerate(zip(names, _STYLES, strict=True)):
        ax.plot(time, values[:, column], style, color=colour, label=name, linewidth=1.6)
    ax.set_ylabel(label)
    ax.grid(alpha=0.3)
    ax.spines[["top", "right"]].set_visible(False)
    # Rounding noise of a quantity that stays at zero should look like zero.
    if float(np.abs(values).max(initial=0.0)) < 1e-9:
        ax.set_ylim(-1, 1)
    ax.legend(frameon=False, fontsize=9)
