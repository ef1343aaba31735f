"""Draw the thrusters of the BlueROV2s and their directions: docs/assets/vehicles.png (part of `make gallery`)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyBboxPatch

from auvbench.vehicles.sheet import load

TARGET = Path(__file__).parents[1] / "docs" / "assets" / "vehicles.png"
LENGTH, WIDTH = 0.457, 0.338
"""m, length and width of a BlueROV2 (Blue Robotics, data sheet)"""
VEHICLES = {"bluerov2": "bluerov2, six thrusters", "bluerov2_heavy": "bluerov2_heavy, eight thrusters"}
ACROSS, UP = "#0072B2", "#D55E00"
ARROW = 0.11
"""m, length of an arrow of a horizontal thruster"""


def main() -> None:
    """Draw both vehicles from above, bow up."""
    figure = Figure(figsize=(9.0, 3.6), dpi=100, facecolor="white")
    for number, (name, title) in enumerate(VEHICLES.items()):
        _vehicle(figure.add_axes((0.5 * number, 0.02, 0.5, 0.86)), name)
        figure.text(0.25 + 0.5 * number, 0.92, title, ha="center", fontsize=14, fontweight="bold")
    canvas: Any = FigureCanvasAgg(figure)
    canvas.print_png(TARGET)
    print(f"wrote {TARGET}")


def _vehicle(axes: Any, name: str) -> None:
    """Draw body, axes and thrusters of a sheet; forward is up and port is left."""
    axes.set(xlim=(-0.36, 0.36), ylim=(-0.25, 0.25), aspect="equal")
    axes.set_axis_off()
    corner = (-WIDTH / 2, -LENGTH / 2)
    axes.add_patch(
        FancyBboxPatch(
            corner, WIDTH, LENGTH, boxstyle="round,pad=0,rounding_size=.05", fc="#eef3f6", ec="#9fb3bf"
        )
    )
    for tip, label in (((0.0, 0.06), "x"), ((-0.05, 0.0), "y")):
        axes.annotate("", tip, (0.0, 0.0), arrowprops={"arrowstyle": "->", "shrinkA": 0, "color": "#777777"})
        axes.text(tip[0] * 1.2, tip[1] * 1.4, label, color="#777777", fontsize=11, ha="center", va="center")
    for unit in load(name).units:
        place = np.array([-unit.position[1], unit.position[0]])
        push = np.array([-unit.direction[1], unit.direction[0]])
        number = unit.name.removeprefix("thruster")
        if np.linalg.norm(push) < 0.5:  # the thruster pushes up
            axes.add_patch(Circle((place[0], place[1]), 0.035, fc="white", ec=UP, linewidth=2))
            axes.plot(*place, "o", color=UP, markersize=4)
            axes.text(*(place + np.array([0.0, 0.055])), number, color=UP, fontsize=13, ha="center")
        else:
            axes.annotate(
                "",
                place + ARROW * push,
                place,
                arrowprops={"arrowstyle": "-|>", "color": ACROSS, "linewidth": 3},
            )
            axes.plot(*place, "o", color=ACROSS, markersize=8)
            axes.text(*(place - 0.045 * push), number, color=ACROSS, fontsize=13, ha="center", va="center")


if __name__ == "__main__":
    main()
