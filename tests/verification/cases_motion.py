"""Whole motions: the LRAUV's system tests, trajectories of two other implementations, terminal speeds, figures."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from auvbench.simulators import openloop
from auvbench.simulators.fossen import FossenSimulator
from auvbench.vehicles import inspect

from ..reference.fossen import Array
from . import rig
from .case import Case

LRAUV = "osrf/lrauv 31b2b90, system tests"
SECTION_LRAUV = "LRAUV Tethys"
SECTION_PATHS = "Trajectories"
SECTION_SPEEDS = "Terminal speeds"
SECTION_MAKER = "Published BlueROV2 figures"

# ---------------------------------------------------------------- LRAUV

CRUISE = 10 * np.pi  # rad/s
THRUST = 0.004312328425753156 * 1025 * 0.2**4 * CRUISE**2
MASS = 148.367 + 4.876161
DRAG = 6.2282
TERMINAL = float(np.sqrt(THRUST / DRAG))
TAU = float(MASS / np.sqrt(THRUST * DRAG))
STEP = 0.02
"""s, the time step of the LRAUV's tests."""


def tethys(time: float, pose: object = (0, 0, -0.5, 1, 0, 0, 0), current: object = (0, 0, 0), sample: float = 1.0,
           velocity: object = (0,) * 6, **physical: float) -> Array:  # fmt: skip
    """Rows (T, 13) of the simulated LRAUV under constant physical commands."""
    lrauv = rig.vehicle("lrauv")
    if "rudder" in physical and abs(physical["rudder"]) > 0.2618:
        lrauv = rig.with_limits(lrauv, "rudder", -1.0, 1.0)
    return openloop.integrate(
        lrauv, duration=time, sample=sample, pose=pose, velocity=velocity, current=current, max_step=STEP,  # type: ignore[arg-type]
        command=rig.command(lrauv, **physical),
    ).rows()  # fmt: skip


@cache
def straight() -> Array:
    return tethys(100.0, propeller=CRUISE)


def heading(degrees: float) -> float:
    """Speed after 45 s along the heading."""
    half = np.radians(degrees) / 2
    row = tethys(45.0, pose=(0, 0, -0.5, np.cos(half), 0, 0, np.sin(half)), propeller=CRUISE, sample=45.0)[-1]
    along = np.array([np.cos(2 * half), np.sin(2 * half)])
    track = row[1:3] / np.linalg.norm(row[1:3])
    assert np.allclose(track, along, atol=1e-9)
    return float(row[7])


@cache
def turn(rudder: float) -> Array:
    """The last row of 50 s straight and 8 s of rudder."""
    lrauv = rig.with_limits(rig.vehicle("lrauv"), "rudder", -1.0, 1.0)
    simulator = FossenSimulator(lrauv, 1, max_step=STEP)
    simulator.reset(np.array([0]), np.array([[0, 0, -0.5, 1, 0, 0, 0.0]]), np.zeros((1, 6)))
    simulator.step(rig.command(lrauv, propeller=CRUISE)[None], 50.0)
    simulator.step(rig.command(lrauv, propeller=CRUISE, rudder=rudder)[None], 8.0)
    trajectory = openloop.Trajectory("enu", np.array([58.0]), simulator.pose, simulator.velocity)
    return trajectory.rows()[-1]


@cache
def sink() -> Array:
    return tethys(40.0, buoyancy_engine=0.0002)


@cache
def broadside() -> Array:
    return tethys(120.0, current=(0, 1, 0))


@cache
def pitch_release() -> Array:
    half = 0.04
    return tethys(200.0, pose=(0, 0, -5, np.cos(half), 0, np.sin(half), 0), sample=0.1)


def idle_motion() -> float:
    """Largest change of any state in 10000 steps of .02 s without input."""
    rows = tethys(200.0)
    return float(np.abs(rows[:, 1:] - rows[0, 1:]).max())


def _lrauv_cases() -> list[Case]:
    def at(t: float) -> float:
        return TERMINAL * float(np.tanh(t / TAU))

    def case(name: str, expected: float, got: Callable[[], float], tolerance: float, unit: str = "") -> Case:
        return Case(SECTION_LRAUV, name, LRAUV, expected, got, tolerance, unit)

    def bound(name: str, relation: str, limit: float, got: Callable[[], float], unit: str) -> Case:
        return Case(SECTION_LRAUV, name, LRAUV, limit, got, 0.0, unit, relation=relation)

    return [
        case("propeller thrust at 10 pi rad/s", 6.980, lambda: float(
            rig.vehicle("lrauv").force(rig.command(rig.vehicle("lrauv"), propeller=CRUISE))[0]), 5e-4, "N"),
        *(case(f"HydrodynamicsTest, heading {h} deg: speed after 45 s, u_inf tanh(t / tau)", at(45), lambda h=h: heading(h), 1e-6, "m/s")
          for h in (0, 90, 180, 270)),
        case("HydrodynamicsTest: the same against the test's own figure", 1.01, lambda: float(straight()[45, 7]), 0.1, "m/s"),
        case("HydrodynamicsTest: vertical speed", 0.0, lambda: float(np.abs(straight()[:, 9]).max()), 1e-3, "m/s"),
        case("HydrodynamicsTest: samples at which the acceleration grew", 0.0,
             lambda: float(np.sum(np.diff(straight()[:, 7], 2) > 0)), 0.0),
        *(case(f"ForwardThrust: speed at {t} s, closed form", at(t), lambda t=t: float(straight()[t, 7]), 1e-6, "m/s")
          for t in (36, 40, 100)),
        case("ForwardThrust: every sample of 36 to 100 s against the test's 1.0 m/s, the farthest", 1.0,
             lambda: float(straight()[36:, 7][np.argmax(np.abs(straight()[36:, 7] - 1))]), 0.06, "m/s"),
        case("ForwardThrust: sideways drift", 0.0, lambda: float(np.abs(straight()[:, 2]).max()), 1e-3, "m"),
        case("ForwardThrust: depth .5 m is kept", -0.5, lambda: float(straight()[-1, 3]), 0.05, "m"),
        case("ThrustState: distance after 40 s", 26.07, lambda: float(straight()[40, 1]), 5e-3, "m"),
        bound("ThrustState: distance against the test's figure", ">", 25.0, lambda: float(straight()[40, 1]), "m"),
        case("ThrustState: speed after 40 s against the test's figure", 1.0, lambda: float(straight()[40, 7]), 0.02, "m/s"),
        case("ThrustAndTurn, rudder -.5 rad for 8 s: yaw", 0.774, lambda: float(turn(-0.5)[6]), 5e-4, "rad"),
        case("ThrustAndTurn: surge", 0.856, lambda: float(turn(-0.5)[7]), 5e-4, "m/s"),
        case("ThrustAndTurn: sway", -0.187, lambda: float(turn(-0.5)[8]), 5e-4, "m/s"),
        case("ThrustAndTurn: yaw rate", 0.1055, lambda: float(turn(-0.5)[12]), 5e-5, "rad/s"),
        case("ThrustAndTurn: yaw rate against the test's figure", 0.1, lambda: float(turn(-0.5)[12]), 0.01, "rad/s"),
        case("ThrustAndTurn: speed against the test's figure", 1.0,
             lambda: float(np.hypot(turn(-0.5)[7], turn(-0.5)[8])), 0.15, "m/s"),
        bound("ThrustAndTurn: way made good", ">", 30.0, lambda: float(turn(-0.5)[1]), "m"),
        bound("ThrustAndTurn: way to port", ">", 0.4, lambda: float(turn(-0.5)[2]), "m"),
        bound("ThrustAndTurn: yaw against the test's figure", ">", 0.5, lambda: float(turn(-0.5)[6]), "rad"),
        bound("ThrustAndTurn: surge against the test's figure", ">", 0.8, lambda: float(turn(-0.5)[7]), "m/s"),
        bound("ThrustAndTurn: sideslip against the test's figure", "<", 0.2, lambda: abs(float(turn(-0.5)[8])), "m/s"),
        case("ThrustAndTurn with the rudder at its joint limit, -.2618 rad: yaw rate", 0.064,
             lambda: float(turn(-0.261799)[12]), 5e-4, "rad/s"),
        case("SinkState, engine to .0002 m3 at 3e-6 m3/s: sinking speed after 40 s", 0.0407,
             lambda: -float(sink()[-1, 9]), 5e-5, "m/s"),
        case("SinkState: depth after 40 s", 1.252, lambda: -float(sink()[-1, 3]), 5e-4, "m"),
        bound("SinkState: sinking speed against the test's figure", ">", 0.01, lambda: -float(sink()[-1, 9]), "m/s"),
        case("SinkState: terminal sinking speed, level, sqrt(g (rho .0003 m3) / 601.27)", 0.0708,
             lambda: -settled("lrauv", push(2, -9.8 * 1025 * 0.0003), 2, 600.0), 5e-5, "m/s"),
        case("RestoringMoment: highest pitch after a release at .08 rad", 0.08,
             lambda: float(pitch_release()[:, 5].max()), 1e-9, "rad"),
        bound("RestoringMoment: pitch swings to the other side", "<", -0.01,
              lambda: float(pitch_release()[:, 5].min()), "rad"),
        case("RestoringMoment: pitch has decayed after 150 s", 0.0,
             lambda: float(np.abs(pitch_release()[1500:, 5]).max()), 0.02, "rad"),
        case("NeutralBuoyancy: largest change of any state in 10000 steps without input", 0.0, idle_motion, 0.0),
        case("GlobalCurrent 1 m/s abeam, 120 s: drift speed against the test's figure", 1.0, current_speed, 0.1, "m/s"),
        case("GlobalCurrent: speed along the other axes, the larger", 0.0, current_cross, 1e-2, "m/s"),
        case("GlobalCurrent without fins, 1 / (1 + d t / m) left of the current", 1 - 1 / (1 + 601.27 * 120 / (148.367 + 126.324739)),
             bare_broadside, 1e-6, "m/s"),
    ]  # fmt: skip


def current_velocity() -> Array:
    """World velocity (3,) after 120 s in the beam current."""
    row = broadside()[-1]
    psi, u, v = row[6], row[7], row[8]
    return np.array([u * np.cos(psi) - v * np.sin(psi), u * np.sin(psi) + v * np.cos(psi), row[9]])


def current_speed() -> float:
    return float(current_velocity()[1])


def current_cross() -> float:
    return float(np.abs(current_velocity()[[0, 2]]).max())


def bare_broadside() -> float:
    bare = openloop.without_actuators(rig.vehicle("lrauv"))
    rows = openloop.integrate(bare, duration=120.0, sample=120.0, current=(0, 1, 0)).rows()
    return float(rows[-1, 8])


# ---------------------------------------------------------------- trajectories

VON_BENZON = "bluerov2_dynamics (von Benzon 2022), DOP853 at 1e-10"
DOCKAUV = "gym_dockauv (Wu 2018), DOP853 at 1e-10"

PATHS = [
    # file, sheet, wrench, usable until s, source
    ("vonbenzon_surge40N", "bluerov2_heavy", (40, 0, 0, 0, 0, 0), 12, VON_BENZON),
    ("vonbenzon_heave_down40N", "bluerov2_heavy", (0, 0, 40, 0, 0, 0), 20, VON_BENZON),
    ("vonbenzon_yaw2Nm", "bluerov2_heavy", (0, 0, 0, 0, 0, 2), 20, VON_BENZON),
    ("vonbenzon_roll_release_20deg", "bluerov2_heavy", (0, 0, 0, 0, 0, 0), 20, VON_BENZON),
    ("wu2018_sway40N", "bluerov2_wu2018", (0, 40, 0, 0, 0, 0), 20, DOCKAUV),
    ("wu2018_yaw2Nm", "bluerov2_wu2018", (0, 0, 0, 0, 0, 2), 20, DOCKAUV),
    ("wu2018_free_float", "bluerov2_wu2018", (0, 0, 0, 0, 0, 0), 60, DOCKAUV),
]


@cache
def deviation(file: str, sheet: str, wrench: tuple[float, ...], until: float) -> Array:
    return rig.deviation(rig.vehicle(sheet), file, wrench, until)


def _path_cases() -> list[Case]:
    rows = []
    for file, sheet, wrench, until, source in PATHS:
        for k, (kind, tolerance) in enumerate(
            (("position", 1e-6), ("attitude", 1e-5), ("velocity", 1e-5), ("rates", 1e-5))
        ):
            rows.append(
                Case(SECTION_PATHS, f"{file}, 0 to {until} s: {kind}, largest deviation over largest value", source, 0.0,
                     lambda a=(file, sheet, wrench, until), k=k: float(deviation(*a)[k]), tolerance)
            )  # fmt: skip
    return rows


# ---------------------------------------------------------------- terminal speeds

TABLE = "terminal speeds computed from the sources' coefficients, reference table"


def settled(sheet: str, wrench: tuple[float, ...], axis: int, seconds: float = 60.0) -> float:
    """Velocity along an axis after a long push on the simulated vehicle, held level by a stiff righting moment.

    A free vehicle pitches or yaws under a surge or sway force (Munk moment); terminal speeds are of level flight.
    """
    from dataclasses import replace

    of = openloop.without_actuators(rig.vehicle(sheet))
    held = replace(
        of,
        M_A=np.diag(np.diag(of.M_A)),
        added_mass_coriolis=False,
        center_of_gravity=np.zeros(3),
        center_of_buoyancy=np.zeros(3),
        weight=of.weight,
        buoyancy=of.buoyancy if axis == 2 else of.weight,
    )
    rows = openloop.integrate(held, duration=seconds, sample=seconds, wrench=wrench, max_step=0.005).rows()
    return float(rows[-1, 7 + axis])


def push(axis: int, amount: float) -> tuple[float, ...]:
    return tuple(amount if k == axis else 0.0 for k in range(6))


def net(sheet: str) -> float:
    return inspect.net_buoyancy(rig.vehicle(sheet))


def _speed_cases() -> list[Case]:
    four = 4 * 40 * float(np.sqrt(0.5))

    def case(
        name: str, expected: float, got: Callable[[], float], tolerance: float = 5e-4, unit: str = "m/s"
    ) -> Case:
        return Case(SECTION_SPEEDS, name, TABLE, expected, got, tolerance, unit)

    return [
        case("bluerov2, surge, 4 x 40 N", 1.495, lambda: settled("bluerov2", push(0, four), 0)),
        case("bluerov2, sway, 4 x 40 N", 1.378, lambda: settled("bluerov2", push(1, four), 1)),
        case("bluerov2, heave, 2 x 40 N without its buoyancy", 0.929, lambda: settled("bluerov2", push(2, 80 - net("bluerov2")), 2)),
        case("bluerov2, free rise", 0.1543, lambda: settled("bluerov2", push(2, 0.0), 2), 1e-4),
        case("bluerov2, net buoyancy", 4.52, lambda: net("bluerov2"), 5e-3, "N"),
        case("bluerov2_wu2018, surge, 4 x 40 N", 2.386, lambda: settled("bluerov2_wu2018", push(0, four), 0)),
        case("bluerov2_wu2018, sway, 4 x 40 N", 2.146, lambda: settled("bluerov2_wu2018", push(1, four), 1)),
        case("bluerov2_wu2018, heave, 4 x 40 N without its buoyancy", 2.011,
             lambda: settled("bluerov2_wu2018", push(2, 160 - net("bluerov2_wu2018")), 2)),
        case("bluerov2_heavy, surge, its own 4 thrusters at full command", 0.734,
             lambda: settled("bluerov2_heavy", push(0, full_heavy() * 4 * float(np.sqrt(0.5))), 0)),
        case("bluerov2_heavy, sway, its own 4 thrusters at full command", 0.629,
             lambda: settled("bluerov2_heavy", push(1, full_heavy() * 4 * float(np.sqrt(0.5))), 1)),
        case("bluerov2_heavy, heave, its own 4 thrusters at full command", 0.718,
             lambda: settled("bluerov2_heavy", push(2, full_heavy() * 4 - net("bluerov2_heavy")), 2)),
        case("bluerov2_heavy, net buoyancy", -0.98, lambda: net("bluerov2_heavy"), 5e-3, "N"),
        case("rexrov, free rise", 0.230, lambda: settled("rexrov", push(2, 0.0), 2, 300.0)),
        case("rexrov, surge, 4 x 2000 x .7071 N", 2.70, lambda: settled("rexrov", push(0, 4 * 2000 * 0.7071), 0, 300.0), 5e-3),
        case("rexrov, net buoyancy", 263.5, lambda: net("rexrov"), 0.05, "N"),
    ]  # fmt: skip


def full_heavy() -> float:
    """N of one of von Benzon's thrusters at command 1."""
    heavy = rig.vehicle("bluerov2_heavy")
    return float(heavy.force(np.ones(8))[0])


# ---------------------------------------------------------------- the maker's figures


def _maker_cases() -> list[Case]:
    g = 9.80665
    bollard = "Blue Robotics, BlueROV2 documentation of 2016-17 and a later product page"

    def case(name: str, expected: float, got: Callable[[], float], tolerance: float, unit: str) -> Case:
        return Case(SECTION_MAKER, name, bollard, expected, got, tolerance, unit)

    def pull(axis: int) -> float:
        return inspect.largest_force(rig.vehicle("bluerov2_heavy_wu2018"), axis, 1.0, moments=False) / g

    return [
        case("forward bollard pull, four T200 at 16 V on the curve (stated: 14)", 14.0, lambda: pull(0), 1.0, "kgf"),
        case("lateral bollard pull, the same four (stated: 14)", 14.0, lambda: pull(1), 1.0, "kgf"),
        case("vertical pull of two T200, half of the heavy's four (stated: 9 to 10.2)", 9.6, lambda: pull(2) / 2, 1.0, "kgf"),
        case("top speed of bluerov2 (stated: 1.0 in 2016, 1.5 m/s later)", 1.5,
             lambda: settled("bluerov2", push(0, 113.137085), 0), 0.1, "m/s"),
        case("free rise with .2 kg of net buoyancy and Wu's drag", 0.17, free_rise_with_ballast, 5e-3, "m/s"),
    ]  # fmt: skip


def free_rise_with_ballast() -> float:
    return settled("bluerov2_wu2018", push(2, 0.2 * 9.81 - net("bluerov2_wu2018")), 2)


def cases() -> list[Case]:
    return [*_lrauv_cases(), *_path_cases(), *_speed_cases(), *_maker_cases()]
