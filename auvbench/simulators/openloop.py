"""Integrate one vehicle under constant inputs, in ENU/FLU or NED/FRD; write and draw its trajectory."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from auvbench.dynamics import frames
from auvbench.errors import AuvbenchError
from auvbench.simulators.fossen import FossenSimulator
from auvbench.vehicles.vehicle_model import VehicleModel

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FloatArray = NDArray[np.float64]

HEADER = "t_s,x_m,y_m,z_m,phi_rad,theta_rad,psi_rad,u_mps,v_mps,w_mps,p_radps,q_radps,r_radps"


REST = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
"""Pose at the origin with aligned axes."""

# Okabe and Ito's palette, which colour-blind readers can distinguish; line styles for black-and-white print.
_STYLES = (("#0072B2", "-"), ("#D55E00", "--"), ("#009E73", "-."))


class IntegrationError(AuvbenchError):
    """The motion exceeded the range of floating point: the step is too long, or the input is too large."""


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """A vehicle's motion at sample times, in `frame` ("enu": ENU/FLU, "ned": NED/FRD)."""

    frame: str
    time: FloatArray  # (T,) s
    pose: FloatArray  # (T, 7) x y z qw qx qy qz
    velocity: FloatArray  # (T, 6) u v w p q r over ground, body axes

    def rows(self) -> FloatArray:
        """Return (T, 13) values in the order of `HEADER`; psi is unwrapped."""
        angles = frames.euler(self.pose[:, 3:])
        angles[:, 2] = np.unwrap(angles[:, 2])
        return np.column_stack([self.time, self.pose[:, :3], angles, self.velocity])

    def csv(self) -> str:
        """Return the trajectory as CSV with 12 significant digits."""
        lines = (",".join(f"{value + 0.0:.12g}" for value in row) for row in self.rows().tolist())
        return "\n".join([HEADER, *lines, ""])


def sample_times(duration: float, sample: float) -> FloatArray:
    """Return the times 0, sample, 2 sample, ... and `duration` itself, (T,) in s."""
    # The factor 1 + 1e-12 absorbs the rounding of the quotient: 20 s at 0.1 s must give 200 intervals.
    whole = math.floor(duration / sample * (1 + 1e-12))
    times: FloatArray = np.arange(whole + 1, dtype=np.float64) * sample
    if duration - times[-1] > 1e-9 * duration:
        return np.append(times, duration)
    times[-1] = duration
    return times


def integrate(
    vehicle: VehicleModel,
    *,
    duration: float,
    sample: float,
    wrench: ArrayLike | None = None,
    command: ArrayLike | None = None,
    pose: ArrayLike | None = None,
    velocity: ArrayLike | None = None,
    current: ArrayLike | None = None,
    frame: str = "enu",
    max_step: float = 0.001,
) -> Trajectory:
    """Integrate `vehicle` from `pose` (7,) and `velocity` (6,) under constant inputs, all in `frame`.

    Args:
        vehicle: vehicle to integrate.
        duration: duration, s.
        sample: time between samples, s; steps end exactly at the samples.
        wrench: (6,) force and moment on the body at its origin, N and N m.
        command: (n_u,) commands in [-1, 1]; None: zeros.
        pose: (7,) x y z qw qx qy qz, body to world; None: the origin, axes aligned.
        velocity: (6,) velocity over ground, body axes.
        current: (3,) current in m/s, world axes.
        frame: frame of all inputs and of the result, "enu" or "ned".
        max_step: longest step of RK4, s.

    Raises:
        IntegrationError: the state exceeded the range of floating point.
    """
    turn, turn_pose = (frames.flip, frames.flip_pose) if frame == "ned" else (np.array, np.array)
    start = np.array(REST if pose is None else pose, dtype=np.float64)
    start[3:] /= np.linalg.norm(start[3:])
    simulator = FossenSimulator(vehicle, 1, max_step=max_step)
    simulator.reset(
        np.array([0]), turn_pose(start)[None], turn(np.zeros(6) if velocity is None else velocity)[None]
    )
    if wrench is not None:
        simulator.external_wrench[0] = turn(wrench)
    if current is not None:
        simulator.set_current(turn(current))
    action = np.zeros((1, len(vehicle.actuators)))
    if command is not None:
        action[0] = command
    times = sample_times(duration, sample)
    poses, velocities = [simulator.pose[0].copy()], [simulator.velocity[0].copy()]
    for before, after in pairwise(times.tolist()):
        # All whole intervals get exactly the duration `sample`; differences of rounded times would vary in the last bits.
        simulator.step(action, min(sample, duration - before) if after == duration else sample)
        if not (np.isfinite(simulator.pose).all() and np.isfinite(simulator.velocity).all()):
            raise IntegrationError(
                f"the motion diverged between {before:g} and {after:g} s: use a max_step below {max_step:g} s"
            )
        poses.append(simulator.pose[0].copy())
        velocities.append(simulator.velocity[0].copy())
    return Trajectory(frame, times, turn_pose(np.array(poses)), turn(np.array(velocities)))


def without_actuators(vehicle: VehicleModel) -> VehicleModel:
    """Return the vehicle without thrusters, fins and ballast."""
    return dataclasses.replace(vehicle, units=(), controllable=())


def write(trajectory: Trajectory, path: Path) -> None:
    """Write `trajectory` as CSV."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(trajectory.csv(), encoding="utf-8")


def draw(trajectory: Trajectory, path: Path, title: str = "") -> None:
    """Write `trajectory` to `path`, a .png, .svg or .pdf file."""
    from matplotlib.figure import Figure

    rows = trajectory.rows()
    time, position, angles, velocity = rows[:, 0], rows[:, 1:4], np.degrees(rows[:, 4:7]), rows[:, 7:]
    vertical = "down" if trajectory.frame == "ned" else "up"
    world = "north, east, down" if trajectory.frame == "ned" else "east, north, up"
    figure = Figure(figsize=(10, 7), layout="constrained")
    axes = figure.subplots(2, 2, sharex=True)
    _lines(axes[0, 0], time, position, ("x", "y", f"z ({vertical})"), "position, m")
    _lines(axes[0, 1], time, angles, ("roll", "pitch", "yaw"), "attitude, deg")
    _lines(axes[1, 0], time, velocity[:, :3], ("u surge", "v sway", "w heave"), "velocity, m/s")
    _lines(axes[1, 1], time, np.degrees(velocity[:, 3:]), ("p roll", "q pitch", "r yaw"), "rate, deg/s")
    for ax in axes[1]:
        ax.set_xlabel("time, s")
    # a dollar sign in a sheet's title does not start a formula
    heading = f"{title}   (world {world}; {len(time)} samples)"
    figure.suptitle(heading, fontsize=11).set_parse_math(False)
    figure.savefig(path, dpi=150)


def _lines(ax: Axes, time: FloatArray, values: FloatArray, names: tuple[str, ...], label: str) -> None:
    for column, (name, (colour, style)) in enumerate(zip(names, _STYLES, strict=True)):
        ax.plot(time, values[:, column], style, color=colour, label=name, linewidth=1.6)
    ax.set_ylabel(label)
    ax.grid(alpha=0.3)
    ax.spines[["top", "right"]].set_visible(False)
    # Rounding noise of a quantity that stays at zero should look like zero.
    if float(np.abs(values).max(initial=0.0)) < 1e-9:
        ax.set_ylim(-1, 1)
    ax.legend(frameon=False, fontsize=9)
