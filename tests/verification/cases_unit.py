"""Values that others' unit tests print: Coriolis matrices, Munk moment, damping, thrust, lag, lift."""

from __future__ import annotations

from functools import cache

import numpy as np

from auvbench.dynamics.rigid_body import coriolis
from auvbench.simulators import openloop
from auvbench.simulators.fossen import FossenSimulator
from auvbench.vehicles.actuators import Actuator, Fin, Thruster
from auvbench.vehicles.curves import Curve, Lag

from ..reference.fossen import Array, quaternion
from . import rig
from .case import Case

GZ = "gz-sim8 8.14.0, unit tests"
UUV = "uuv_simulator bfb40cb, unit tests"
DOCKAUV = "gym_dockauv 6b36b5b, unit tests (Wu 2018)"

SECTION_GZ = "Gazebo"
SECTION_UUV = "UUV Simulator"
SECTION_DOCKAUV = "gym_dockauv"
SECTION_THRUSTERS = "Thrusters"

# ---------------------------------------------------------------- Gazebo

GZ_CORIOLIS = np.array(
    [
        [0, 0, 0, 0, 9, -4],
        [0, 0, 0, -9, 0, 1],
        [0, 0, 0, 4, -1, 0],
        [0, 9, -4, 0, 36, -25],
        [-9, 0, 1, -36, 0, 16],
        [4, -1, 0, 25, -16, 0],
    ],
    dtype=float,
)
GZ_NU = np.arange(1.0, 7.0)


@cache
def added_mass_wrench(diagonal: tuple[float, ...], nu: tuple[float, ...]) -> Array:
    """-C_A(nu) nu (6,) of the simulator: its motion with the term less its motion without."""
    M_A = np.diag(diagonal)
    with_it, without = (
        rig.hydrodynamic_wrench(rig.model(rig.body(M_A=M_A, added_coriolis=on)), nu) for on in (True, False)
    )
    return with_it - without


def gz_coriolis_error() -> float:
    return float(np.abs(coriolis(np.diag(GZ_NU), GZ_NU) - GZ_CORIOLIS).max())


def gz_coriolis_wrench_error() -> float:
    got = added_mass_wrench(tuple(GZ_NU), tuple(GZ_NU))
    return float(np.abs(got + GZ_CORIOLIS @ GZ_NU).max())


def drag(linear: float, quadratic: float, u: float) -> float:
    body = rig.body(D_l=np.array([linear, 0, 0, 0, 0, 0]), D_q=np.array([quadratic, 0, 0, 0, 0, 0]))
    return -float(rig.hydrodynamic_wrench(rig.model(body), (u, 0, 0, 0, 0, 0))[0])


def thruster(curve: Curve, lag: Lag | None = None, rotor: float = 0.0) -> Actuator:
    lag = Lag.none() if lag is None else lag
    return Thruster(
        name="thruster",
        curve=curve,
        lag=lag,
        position=np.zeros(3),
        direction=np.array([1.0, 0, 0]),
        rotor_constant=rotor,
    )


def thrust(k_t: float, rho: float, D: float, omega: float) -> float:
    """N that push the simulated body when its rotor turns at omega rad/s."""
    unit = thruster(Curve("linear", (-400.0, 400.0)), rotor=k_t * rho * D**4)
    return thrust_of(unit, omega / 400.0)


def thrust_of(unit: Actuator, command: float, duration: float = 1e-3) -> float:
    """Mean N over `duration` on a body of 1 kg that does nothing else."""
    simulator = FossenSimulator(rig.model(rig.body(), (unit,)), 1, max_step=duration)
    simulator.step(np.array([[command]]), duration)
    return float(simulator.velocity[0, 0] / duration)


def gz_lift() -> float:
    """Vertical N on a wing of 10 m2 with a dihedral of .1 rad, at an angle of attack of .1 rad and .2 m/s in air."""
    parameters = dict.fromkeys(Fin.UNITS, 0.0) | {"area": 10.0, "lift_slope": 4.0, "stall_angle": 1.0}
    wing = Fin(
        name="wing",
        curve=Curve("linear", (-0.1, 0.1)),
        position=np.zeros(3),
        direction=np.array([0.0, np.cos(0.1), np.sin(0.1)]),  # its hinge
        **parameters,
    )
    of = rig.model(rig.body(), (wing,), density=1.2041)
    # About the hinge, to port, a positive angle lowers the leading edge.
    return float(rig.hydrodynamic_wrench(of, (0.2, 0, 0, 0, 0, 0), action=[-1.0])[2])


RUNNING = "measured on a running gz-sim 8.14.0, added mass by SDF's fluid_added_mass"


@cache
def ahead() -> tuple[float, float]:
    """Pitch (rad) and climb (m/s) of bluerov2 under 4 x 10 N ahead, settled, before it begins to yaw."""
    rows = openloop.integrate(
        rig.vehicle("bluerov2"), duration=15.0, sample=5.0, command=[0.25, 0.25, 0.25, 0.25, 0, 0]
    ).rows()
    return float(rows[-1, 5]), float((rows[-1, 3] - rows[-2, 3]) / 5.0)


def free_rise() -> float:
    rows = openloop.integrate(rig.vehicle("bluerov2"), duration=60.0, sample=60.0).rows()
    return float(rows[-1, 9])


# ---------------------------------------------------------------- UUV Simulator

SPHERE_ADDED = 2 / 3 * np.pi * 1028 * 0.1**3
SPHERE_DRAG = 0.5 * 1028 * 0.5 * np.pi * 0.1**2


def sphere_added_mass() -> float:
    """Added mass that a push reveals: force over acceleration, less the body's own mass."""
    body = rig.body(M_A=np.diag([SPHERE_ADDED] * 3 + [0.0] * 3))
    return float(10.0 / rig.acceleration(rig.model(body), wrench=(10, 0, 0, 0, 0, 0))[0] - body.m)


def sphere_drag() -> float:
    body = rig.body(D_q=np.array([SPHERE_DRAG] * 3 + [0.0] * 3))
    return float(rig.hydrodynamic_wrench(rig.model(body), (0, 0, 1, 0, 0, 0))[2])


def lag_response(tau: float, t: float, step: float = 0.05) -> float:
    """Output of the simulated first-order thruster after t seconds of a unit command."""
    unit = thruster(Curve("linear", (-1.0, 1.0)), Lag.first_order(tau))
    simulator = FossenSimulator(rig.model(rig.body(), (unit,)), 1, max_step=step)
    simulator.step(np.array([[1.0]]), t)
    return float(unit.lag.C @ simulator.actuators[0])


def conversion(command: float) -> float:
    """The published conversion curve, resampled at equal spacing as the simulator's tables are."""
    points = np.linspace(-5, 5, 11)
    values = np.interp(points, [-5, 0, 2, 5], [-100, -10, 20, 120])
    return float(Curve("table", (-100.0, 120.0), table=values)(command / 5.0))


def fault(effectiveness: float) -> float:
    """N of a 10 N thruster with the given health."""
    unit = thruster(Curve("linear", (-10.0, 10.0)))
    simulator = FossenSimulator(rig.model(rig.body(), (unit,)), 1, max_step=1e-3)
    simulator.effectiveness[0, 0] = effectiveness
    simulator.step(np.ones((1, 1)), 1e-3)
    return float(simulator.velocity[0, 0] / 1e-3)


# ---------------------------------------------------------------- gym_dockauv

NU = (3.0, 2.0, 1.0, 0.3, 0.2, 0.1)
FLIP = np.array([1.0, -1, -1, 1, -1, -1])
"""gym_dockauv has z down: its numbers are compared in its own axes."""


def dockauv_coriolis(row: int, column: int) -> float:
    M_A = rig.vehicle("bluerov2_wu2018").M_A
    C = coriolis(M_A, np.array(NU) * FLIP)
    return float(C[row, column] * FLIP[row] * FLIP[column])


@cache
def dockauv_drag() -> Array:
    """D(nu) nu (6,) from the simulator: what damping takes from the motion, without and with."""
    from dataclasses import replace

    full = rig.vehicle("bluerov2_wu2018")
    bare = replace(full, linear_damping=np.zeros(6), quadratic_damping=np.zeros(6))
    nu = np.array(NU) * FLIP
    return (rig.hydrodynamic_wrench(bare, nu) - rig.hydrodynamic_wrench(full, nu)) * FLIP


@cache
def dockauv_restoring() -> Array:
    """g(eta) (6,) from the simulator at rest."""
    pose = np.concatenate([np.zeros(3), quaternion(0.3, -0.2, -0.1)])
    return -rig.hydrodynamic_wrench(rig.vehicle("bluerov2_wu2018"), np.zeros(6), pose=pose) * FLIP


# ---------------------------------------------------------------- thrusters

T200 = "Blue Robotics, T200 public performance data, 16 V, September 2019"
T200_POINTS = (
    (1100, -39.91), (1140, -35.85), (1200, -26.56), (1300, -14.10), (1440, -1.78), (1468, -0.356), (1472, 0.0),
    (1500, 0.0), (1528, 0.0), (1532, 0.40), (1600, 5.916), (1700, 17.88), (1800, 33.54), (1860, 45.59), (1900, 51.44),
)  # fmt: skip
VON_BENZON = "von Benzon et al. 2022, eq. 18"
VON_BENZON_POINTS = (1.062, 3.064, 6.523, 11.288, 16.594, 21.434, 25.129, 27.754, 29.83, 30.4)


def steady_thrust(sheet: str, command: float) -> float:
    return float(rig.vehicle(sheet).force(np.full(8, command))[0])


def electrical_power(pwm: float) -> float:
    """W that one T200 takes, from the simulator, after all its eight were commanded alike."""
    of = rig.vehicle("bluerov2_heavy_wu2018")
    simulator = FossenSimulator(of, 1)
    simulator.step(np.full((1, 8), (pwm - 1500) / 400), 0.01)
    return float(simulator.power[0] / 8)


def lag_settles() -> float:
    """Share of the commanded force that von Benzon's thruster gives after 2 s."""
    of = rig.vehicle("bluerov2_heavy")
    simulator = FossenSimulator(of, 1)
    simulator.step(np.full((1, 8), 0.5), 2.0)
    unit = of.units[0]
    return float(unit.lag.C @ simulator.actuators[0, : unit.lag.order] / unit.force(0.5))


def _thruster_cases() -> list[Case]:
    rows = [
        Case(SECTION_THRUSTERS, f"T200 at {pwm} us", T200, force,
             lambda pwm=pwm: steady_thrust("bluerov2_heavy_wu2018", (pwm - 1500) / 400), 6e-3, "N")
        for pwm, force in T200_POINTS
    ]  # fmt: skip
    rows += [
        Case(SECTION_THRUSTERS, "T200 at 1100 us: electrical power", T200, 388.8, lambda: electrical_power(1100), 0.1, "W"),
        Case(SECTION_THRUSTERS, "T200 at 1900 us: electrical power", T200, 381.0, lambda: electrical_power(1900), 0.5, "W"),
        Case(SECTION_THRUSTERS, "T200 in its dead band: electrical power", T200, 0.0, lambda: electrical_power(1500), 1e-9, "W"),
    ]  # fmt: skip
    rows += [
        Case(SECTION_THRUSTERS, f"von Benzon's curve at command {0.1 * (k + 1):.1f}", VON_BENZON, force,
             lambda k=k: steady_thrust("bluerov2_heavy", 0.1 * (k + 1)), 6e-3, "N")
        for k, force in enumerate(VON_BENZON_POINTS)
    ]  # fmt: skip
    rows.append(
        Case(
            SECTION_THRUSTERS,
            "von Benzon's transfer function: steady gain",
            VON_BENZON,
            1.0,
            lag_settles,
            1e-6,
        )
    )
    return rows


def cases() -> list[Case]:
    rows = [
        Case(SECTION_GZ, "added-mass Coriolis matrix for M_A = diag(1..6), nu = (1..6), largest deviation of an entry",
             GZ, 0.0, gz_coriolis_error, 1e-12),
        Case(SECTION_GZ, "its wrench -C nu on the simulated body, largest deviation",
             GZ, 0.0, gz_coriolis_wrench_error, 1e-6, "N, N m"),
        Case(SECTION_GZ, "its power nu . C nu", GZ, 0.0,
             lambda: float(GZ_NU @ added_mass_wrench(tuple(GZ_NU), tuple(GZ_NU))), 1e-6, "W"),
        Case(SECTION_GZ, "Munk moment of M_A = diag(5, 100, 100, 0, 10, 10) at u 1, v .5 m/s",
             GZ, -47.5, lambda: float(added_mass_wrench((5, 100, 100, 0, 10, 10), (1, 0.5, 0, 0, 0, 0))[5]), 1e-6, "N m"),
        Case(SECTION_GZ, "drag, linear .2 and quadratic 6.2282, at 2 m/s",
             GZ, 25.3128, lambda: drag(0.2, 6.2282, 2.0), 1e-6, "N"),
        Case(SECTION_GZ, "D(0,0), linear .2 and quadratic 6.2282, at 2 m/s",
             GZ, 12.6564, lambda: drag(0.2, 6.2282, 2.0) / 2.0, 1e-6, "N s/m"),
        Case(SECTION_GZ, "D(0,0), quadratic 10, at .7 m/s", GZ, 7.0, lambda: drag(0.0, 10.0, 0.7) / 0.7, 1e-6, "N s/m"),
    ]  # fmt: skip
    for k_t, rho, D, omega in (
        (0.005, 950, 0.2, 198.680),
        (0.004, 1000, 0.2, 216.506),
        (0.005, 950, 0.25, 127.155),
    ):
        rows.append(
            Case(SECTION_GZ, f"thrust at {omega} rad/s, kT {k_t}, rho {rho}, D {D}",
                 GZ, 300.0, lambda a=(k_t, rho, D, omega): thrust(*a), 0.01, "N")
        )  # fmt: skip
    rows.append(
        Case(SECTION_GZ, "lift of a wing, cla 4, a0 .1, area 10, rho 1.2041, .2 m/s, dihedral .1",
             GZ, 0.0958, gz_lift, 5e-5, "N")
    )  # fmt: skip
    rows += [
        Case(SECTION_GZ, "yaw moment of M_A = diag(2, 15, 15, .01, .5, .5) at u 1, v .2 m/s",
             RUNNING, -2.6, lambda: float(added_mass_wrench((2, 15, 15, 0.01, 0.5, 0.5), (1, 0.2, 0, 0, 0, 0))[5]), 1e-6, "N m"),
        Case(SECTION_GZ, "bluerov2, 4 x 10 N ahead: pitch", RUNNING, -0.095, lambda: ahead()[0], 1e-3, "rad"),
        Case(SECTION_GZ, "bluerov2, 4 x 10 N ahead: climb", RUNNING, 0.212, lambda: ahead()[1], 5e-4, "m/s"),
        Case(SECTION_GZ, "bluerov2, free rise", RUNNING, 0.15447, free_rise, 2e-4, "m/s"),
    ]  # fmt: skip
    rows += [
        Case(SECTION_UUV, "added mass of a sphere, radius .1 m, rho 1028", UUV, 2.153, sphere_added_mass, 5e-4, "kg"),
        Case(SECTION_UUV, "its quadratic drag at 1 m/s", UUV, -8.074, sphere_drag, 5e-4, "N"),
        Case(SECTION_UUV, "first-order thruster, tau .5 s, unit step, at .5 s (steps of .05 s)",
             UUV, 1 - np.exp(-1.0), lambda: lag_response(0.5, 0.5), 1e-12),
        Case(SECTION_UUV, "the same in one step of .5 s", UUV, 1 - np.exp(-1.0), lambda: lag_response(0.5, 0.5, 0.5), 1e-12),
        *(
            Case(SECTION_UUV, f"conversion {{-5: -100, 0: -10, 2: 20, 5: 120}} at {x:g}",
                 UUV, expected, lambda x=x: conversion(x), 1e-9, "N")
            for x, expected in ((-7.0, -100.0), (-2.5, -55.0), (0.0, -10.0), (1.0, 5.0), (3.5, 70.0), (9.0, 120.0))
        ),
        Case(SECTION_UUV, "a 10 N thruster, healthy", UUV, 10.0, lambda: fault(1.0), 1e-9, "N"),
        Case(SECTION_UUV, "the same at half its efficiency", UUV, 5.0, lambda: fault(0.5), 1e-9, "N"),
        Case(SECTION_UUV, "the same dead", UUV, 0.0, lambda: fault(0.0), 1e-9, "N"),
    ]  # fmt: skip
    nu_text = "nu = (3, 2, 1, .3, .2, .1)"
    rows += [
        Case(SECTION_DOCKAUV, f"C_A[{i},{j}] at {nu_text}", DOCKAUV, value,
             lambda i=i, j=j: dockauv_coriolis(i, j), 1e-9)
        for i, j, value in ((0, 4, 14.57), (2, 3, 25.4), (5, 4, -0.036))
    ]  # fmt: skip
    rows += [
        Case(SECTION_DOCKAUV, f"D[{i},{i}] at {nu_text}", DOCKAUV, value,
             lambda i=i: float(dockauv_drag()[i] / NU[i]), 1e-6)
        for i, value in enumerate((58.57, 49.54, 42.17, 0.535, 0.38, 0.225))
    ]  # fmt: skip
    rows += [
        Case(SECTION_DOCKAUV, f"restoring {axis} at roll .3, pitch .2, yaw .1 rad", DOCKAUV, value,
             lambda i=i: float(dockauv_restoring()[i]), 5e-5, unit)
        for i, (axis, value, unit) in enumerate(
            zip(("X", "Y", "Z", "K", "M", "N"), (-0.3944, 0.5749, 1.8585, 0.6535, 0.4483, 0.0),
                ("N",) * 3 + ("N m",) * 3, strict=True)
        )
    ]  # fmt: skip
    return [*rows, *_thruster_cases()]
