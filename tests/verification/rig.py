"""What the cases stand on: test bodies for the real simulator, and ways to read forces and paths from it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np

from auvbench.simulators import openloop
from auvbench.simulators.fossen import FossenSimulator
from auvbench.vehicles import sheet
from auvbench.vehicles.actuators import Actuator
from auvbench.vehicles.curves import Curve
from auvbench.vehicles.vehicle_model import VehicleModel

from ..reference.fossen import ENU, NED, Array, Body

DATA = Path(__file__).parent / "data"


@cache
def vehicle(name: str) -> VehicleModel:
    """A sheet of `conf/vehicle`."""
    return sheet.load(name)


def body(m: float = 1.0, **changes: object) -> Body:
    """A neutral point-like body of 1 kg and 1 kg m2 in still water, with `changes`."""
    plain = Body(
        name="test body",
        m=m,
        r_g=np.zeros(3),
        I_g=np.eye(3),
        M_A=np.zeros((6, 6)),
        D_l=np.zeros(6),
        D_q=np.zeros(6),
        W=0.0,
        B=0.0,
        r_b=np.zeros(3),
        down=ENU,
    )
    return replace(plain, **changes)  # type: ignore[arg-type]


def model(given: Body, units: tuple[Actuator, ...] = (), density: float = 1000.0) -> VehicleModel:
    """The body of a reference computation as a vehicle of the simulator."""
    b = given.flipped() if given.down == NED else given
    return VehicleModel(
        name=b.name,
        title=b.name,
        gravity=9.8,
        density=density,
        mass=b.m,
        center_of_gravity=b.r_g,
        inertia=b.I_g,
        weight=b.W,
        buoyancy=b.B,
        center_of_buoyancy=b.r_b,
        M_A=b.M_A,
        added_mass_coriolis=b.added_coriolis,
        linear_damping=b.D_l,
        quadratic_damping=b.D_q,
        units=units,
    )


def acceleration(
    of: VehicleModel,
    nu: object = (0,) * 6,
    wrench: object = (0,) * 6,
    pose: object = (0, 0, 0, 1, 0, 0, 0),
    current: object = (0, 0, 0),
    action: object = None,
) -> Array:
    """nu_dot (6,) that the compiled simulator gives at once, from three very short steps extrapolated to none."""
    estimates = []
    for h in (4e-5, 2e-5, 1e-5):
        simulator = FossenSimulator(of, 1, max_step=h)
        simulator.reset(np.array([0]), np.array([pose], float), np.array([nu], float))
        simulator.external_wrench[0] = wrench
        simulator.set_current(np.array(current, float))
        simulator.step(np.zeros((1, len(of.units))) if action is None else np.array([action], float), h)
        estimates.append((simulator.velocity[0] - np.array(nu, float)) / h)
    # Richardson: the error of a forward difference is c1 h + c2 h^2 + ...
    first = [2 * fine - coarse for coarse, fine in pairwise(estimates)]
    return np.asarray((4 * first[1] - first[0]) / 3)


def hydrodynamic_wrench(of: VehicleModel, nu: object, **more: object) -> Array:
    """M nu_dot (6,): everything that acts on the vehicle at velocity `nu`, as the simulator computes it."""
    return np.asarray(of.M @ acceleration(of, nu, **more))  # type: ignore[arg-type]


def with_limits(of: VehicleModel, name: str, low: float, high: float) -> VehicleModel:
    """The vehicle with another range of one actuator's physical command."""
    units = tuple(
        replace(unit, curve=Curve("linear", (low, high), neutral=unit.curve.neutral))
        if unit.name == name
        else unit
        for unit in of.units
    )
    return replace(of, units=units)


def command(of: VehicleModel, **physical: float) -> Array:
    """Normalised commands (n_u,) that stand for physical ones: N, rad/s, rad, m or m3; others at neutral."""
    unknown = set(physical) - set(of.actuators)
    assert not unknown, unknown
    return np.array(
        [float(unit.curve.inverse(physical.get(unit.name, unit.curve.neutral))) for unit in of.units]
    )


def published(file: str) -> Array:
    """Rows (T, 13) of a reference trajectory."""
    return np.loadtxt(DATA / f"{file}.csv", delimiter=",", skiprows=1)


def deviation(of: VehicleModel, file: str, wrench: tuple[float, ...], until: float) -> Array:
    """Largest deviations (4,) from a published trajectory: position, angles, velocity and rates.

    Each is divided by the largest magnitude of the same kind in the file.
    """
    rows = published(file)
    rows = rows[rows[:, 0] <= until + 1e-9]
    from auvbench.dynamics import frames

    trajectory = openloop.integrate(
        openloop.without_actuators(of),
        duration=rows[-1, 0],
        sample=rows[1, 0],
        wrench=wrench,
        pose=np.concatenate([rows[0, 1:4], frames.quaternion(rows[0, 4:7])]),
        velocity=rows[0, 7:],
        frame="ned",
    )
    got = trajectory.rows()
    assert np.array_equal(np.round(got[:, 0], 9), np.round(rows[:, 0], 9))
    found = []
    for k in range(1, 13, 3):
        size = np.abs(rows[:, k : k + 3]).max()
        found.append(np.abs(got[:, k : k + 3] - rows[:, k : k + 3]).max() / (size or 1.0))
    return np.array(found)
