"""Motions from rest that both simulators compute, with a wrench or with commands to the thrusters."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from auvbench.integrations.gazebo import sdf
from auvbench.integrations.gazebo.simulator import GazeboSimulator
from auvbench.integrations.gazebo.world import NewBody
from auvbench.simulators.base import Simulator
from auvbench.simulators.fossen import FossenSimulator
from auvbench.vehicles import sheet
from auvbench.vehicles.vehicle_model import VehicleModel

Floats = NDArray[np.float64]

INTERVAL = 0.1
"""s between samples; also the shortest time for which a command is held"""

AT_REST = np.array([0.0, 0.0, -5.0, 1.0, 0.0, 0.0, 0.0])


@dataclass(frozen=True, slots=True)
class Case:
    """One motion, in ENU/FLU.

    `wrench` (6,) acts at the body's origin with the thrusters off. Each of the `commands` (k, n_u) in [-1, 1] is held for
    duration / k.
    """

    name: str
    vehicle: str
    duration: float = 20.0
    wrench: tuple[float, ...] = (0.0,) * 6
    commands: Floats | None = None
    roll: float = 0.0
    current: tuple[float, float, float] = (0.0, 0.0, 0.0)
    mixed: bool = field(default=False)

    @property
    def pose(self) -> Floats:
        pose = AT_REST.copy()
        pose[3], pose[4] = np.cos(self.roll / 2), np.sin(self.roll / 2)
        return pose

    def command(self, time: float) -> Floats | None:
        if self.commands is None:
            return None
        held = self.duration / len(self.commands)
        return np.asarray(self.commands[min(int(time / held + 1e-9), len(self.commands) - 1)])


@dataclass(frozen=True, slots=True)
class Path:
    """A motion sampled at times (T,), every `INTERVAL` from 0."""

    time: Floats
    pose: Floats  # (T, 7)
    velocity: Floats  # (T, 6)

    @property
    def travelled(self) -> Floats:
        """Return the distance travelled (T,) in m."""
        steps = np.linalg.norm(np.diff(self.pose[:, :3], axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])


def verification() -> list[Case]:
    """Return the wrenches, in FLU, and durations of the trajectories in docs/verification.md."""
    heavy, wu = "bluerov2_heavy", "bluerov2_heavy_wu2018"
    return [
        Case("surge 40 N", heavy, 12.0, (40.0, 0, 0, 0, 0, 0)),
        Case("down 40 N", heavy, 20.0, (0, 0, -40.0, 0, 0, 0)),
        Case("yaw 2 N m", heavy, 20.0, (0, 0, 0, 0, 0, -2.0)),
        Case("released at 20 deg of roll", heavy, 20.0, roll=np.radians(20.0)),
        Case("sway 40 N", wu, 20.0, (0, -40.0, 0, 0, 0, 0)),
        Case("yaw 2 N m", wu, 20.0, (0, 0, 0, 0, 0, -2.0)),
        Case("free float", wu, 20.0),
    ]


def mixed() -> list[Case]:
    """Return commands that move the BlueROV2 in all axes at once."""
    ahead = np.array([[0.25, 0.25, 0.25, 0.25, 0.0, 0.0]])
    turning = np.array([[0.5, 0.3, 0.5, 0.3, 0.0, 0.0]])
    spiral = np.array([[0.6, 0.3, 0.6, 0.3, -0.3, 0.3]])
    full = np.array([[1.0, 1.0, 1.0, 1.0, 0.0, 0.0]])
    rng = np.random.default_rng(7)
    cases = [
        Case("4 x 10 N ahead", "bluerov2", commands=ahead, mixed=True),
        Case("4 x 40 N ahead", "bluerov2", commands=full, mixed=True),
        Case("ahead and turning", "bluerov2", commands=turning, mixed=True),
        Case("spiral down", "bluerov2", commands=spiral, mixed=True),
        Case(
            "ahead across 0.3 m/s of current",
            "bluerov2",
            commands=ahead,
            current=(0.0, 0.3, 0.0),
            mixed=True,
        ),
    ]
    for k in range(5):
        random = rng.uniform(-1.0, 1.0, (20, 6))
        cases.append(Case(f"random commands {k + 1}", "bluerov2", commands=random, mixed=True))
    return cases


def bare(vehicle: VehicleModel) -> VehicleModel:
    """Return the vehicle without thrusters."""
    return dataclasses.replace(vehicle, units=(), controllable=())


def embedded(case: Case, plugin: str = "") -> Path:
    """Return the embedded simulator's motion, with steps of .001 s.

    Args:
        case: the motion.
        plugin: release of gz-sim whose Coriolis term of the added mass is used; "": Fossen's term.
    """
    vehicle = dataclasses.replace(model(case), plugin=plugin)
    return follow(FossenSimulator(vehicle, 1, max_step=0.001), case)


def gazebo(case: Case, hydrodynamics: str, step: float) -> Path:
    """Return Gazebo's motion with physics steps of `step` seconds."""
    return follow(GazeboSimulator(model(case), 1, max_step=step, hydrodynamics=hydrodynamics), case)


class PluginsCurrent(GazeboSimulator):
    """Gazebo with corrected hydrodynamics and the plugin's own current, as for a user of the SDF file."""

    def _new_body(self, index: int, place: int) -> NewBody:
        text = sdf.model(
            self.vehicle, "corrected", name="{name}", thrusters=False, current=self.current[index, :3]
        )
        return NewBody(place, text, self.pose[index].copy())


def with_the_plugins_current(case: Case, step: float) -> Path:
    """Return Gazebo's motion with `<fluid_added_mass>` and `<default_current>`."""
    return follow(PluginsCurrent(model(case), 1, max_step=step), case)


def model(case: Case) -> VehicleModel:
    vehicle = sheet.load(case.vehicle)
    return bare(vehicle) if case.commands is None else vehicle


def follow(simulator: Simulator, case: Case) -> Path:
    simulator.reset(np.array([0]), case.pose[None], np.zeros((1, 6)))
    simulator.set_current(case.current)
    simulator.external_wrench[0] = case.wrench  # type: ignore[attr-defined]
    steps = round(case.duration / INTERVAL)
    still = np.zeros((1, len(simulator.vehicle.units)))
    poses, velocities = [simulator.pose[0].copy()], [simulator.velocity[0].copy()]
    for k in range(steps):
        command = case.command(k * INTERVAL)
        simulator.step(still if command is None else command[None], INTERVAL)
        poses.append(simulator.pose[0].copy())
        velocities.append(simulator.velocity[0].copy())
    return Path(INTERVAL * np.arange(steps + 1), np.array(poses), np.array(velocities))
