"""Waves: moments of the spectrum, the orbit of one component, inertia force, a body that drifts with the water."""

from __future__ import annotations

from functools import cache

import numpy as np

from auvbench.dynamics import waves
from auvbench.envs.batch import Batch
from auvbench.simulators.fossen import FossenSimulator
from auvbench.vehicles.vehicle_model import VehicleModel

from ..configs import training
from ..reference.fossen import Array, quaternion, rotation
from ..reference.waves import G, Wave, variance, water
from . import rig
from .case import Case

SECTION = "Waves"
SPECTRA = "spectra of Pierson and Moskowitz 1964 and Hasselmann et al. 1973"
AIRY = "closed form of linear waves on deep water (Faltinsen 1990, chapter 2)"

SMALL = 1e-4
"""m, an amplitude at which terms of second order do not show"""
WAVE = Wave(amplitude=0.5, frequency=2 * np.pi / 6.0, direction=0.7, phase=1.1)
ADDED = np.diag([5.0, 9.0, 14.0, 0.3, 0.4, 0.5])
ADDED[0, 4] = ADDED[4, 0] = 0.6
ADDED[1, 5] = ADDED[5, 1] = -0.4
ADDED[0, 1] = ADDED[1, 0] = 1.5
MASS = 20.0
CENTRE = np.array([0.02, -0.03, 0.05])


def on(components: list[Wave], n: int, time: float = 0.0) -> waves.Waves:
    """The components on n vehicles of the simulator."""
    table = [
        [w.number / (2 * np.pi), w.frequency / (2 * np.pi), w.amplitude * w.frequency] for w in components
    ]
    made = waves.on(np.array(table), n)
    for m, wave in enumerate(components):
        made.rays[:, m, waves.COSINE] = np.cos(wave.direction)
        made.rays[:, m, waves.SINE] = np.sin(wave.direction)
        made.rays[:, m, waves.PHASE] = wave.phase / (2 * np.pi)
    made.time[:] = time
    return made


def drag_alone() -> VehicleModel:
    """1 kg that feels nothing but 1 N s/m of linear drag: its acceleration at rest is the water's velocity."""
    return rig.model(rig.body(D_l=np.array([1.0, 1, 1, 0, 0, 0])))


def afloat(M_A: Array) -> VehicleModel:
    """A body without drag that is as heavy as its water, and balanced."""
    weight = MASS * 9.8
    return rig.model(rig.body(MASS, M_A=M_A, W=weight, B=weight))


def velocities(sea: waves.Waves, places: Array) -> Array:
    """The water's velocity (n, 3) at places (n, 3), as the simulator has it."""
    n, h = len(places), 1e-6
    simulator = FossenSimulator(drag_alone(), n, max_step=h)
    simulator.reset(np.arange(n), np.hstack([places, np.tile([1.0, 0, 0, 0], (n, 1))]), np.zeros((n, 6)))
    simulator.set_waves(sea)
    simulator.step(np.zeros((n, 0)), h)
    return np.asarray(simulator.velocity[:, :3] / h)


@cache
def simulated_variance(spectrum: str, depth: float) -> float:
    """Mean over directions and phases of 512 episodes and 256 moments."""
    n = 512
    batch = Batch(
        training("disturbance=sea_state_4", f"disturbance.waves.spectrum={spectrum}", "noise=none"), n
    )
    batch.reset()
    sea = batch.disturbances["waves"].waves  # type: ignore[index]
    places = np.tile([3.0, -2.0, -depth], (n, 1))
    squares = []
    for moment in range(256):
        sea.time[:] = 23.0 * moment
        squares.append(np.mean(np.sum(velocities(sea, places)[:, :2] ** 2, axis=1)))
    return float(np.mean(squares))


def velocity_error() -> float:
    """Largest deviation from the closed form over places and moments, as a share of the amplitude."""
    rng = np.random.default_rng(1)
    worst = 0.0
    for time in (0.0, 2.2, 61.7):
        places = rng.uniform([-30, -30, -25], [30, 30, -0.5], (64, 3))
        expected = np.array([water([WAVE], time, place)[0] for place in places])
        worst = max(worst, float(np.abs(velocities(on([WAVE], 64, time), places) - expected).max()))
    return worst / (WAVE.amplitude * WAVE.frequency)


@cache
def orbit(amplitude: float, depth: float) -> tuple[float, float, float]:
    """Extent along the wave and up of a neutral sphere's path in one period, and its distance from where it began."""
    wave = Wave(amplitude, WAVE.frequency, WAVE.direction)
    simulator = FossenSimulator(afloat(np.diag([10.0, 10, 10, 0, 0, 0])), 1)
    start = np.array([0.0, 0.0, -depth])
    velocity = np.concatenate([water([wave], 0.0, start)[0], np.zeros(3)])
    simulator.reset(np.array([0]), np.array([[*start, 1.0, 0, 0, 0]]), velocity[None])
    simulator.set_waves(on([wave], 1))
    path = [start]
    for _ in range(600):
        simulator.step(np.zeros((1, 0)), 2 * np.pi / wave.frequency / 600)
        path.append(simulator.pose[0, :3].copy())
    along = np.array(path) @ [np.cos(wave.direction), np.sin(wave.direction), 0.0]
    up = np.array(path)[:, 2]
    return float(np.ptp(along)), float(np.ptp(up)), float(np.linalg.norm(path[-1] - start))


def inertia_error(turning: bool) -> float:
    """Largest deviation of the wrench on a body held in place from its closed form, as a share of the largest entry.

    The wrench is M nu' in waves less M nu' in still water; without C_A and drag nothing else depends on the water.
    """
    b = rig.body(MASS, M_A=ADDED, W=0.0, B=MASS * 9.8, r_b=CENTRE, added_coriolis=False)
    body = rig.model(b)
    place, q = np.array([4.0, 3.0, -2.5]), quaternion(0.4, -0.6, 2.0)
    R, omega = rotation(q), np.array([0.5, -0.3, 0.8]) if turning else np.zeros(3)
    nu = np.concatenate([np.zeros(3), omega])

    def wrench(sea: waves.Waves) -> Array:
        h = 1e-6
        simulator = FossenSimulator(body, 1, max_step=h)
        simulator.reset(np.array([0]), np.concatenate([place, q])[None], nu[None])
        simulator.set_waves(sea)
        simulator.step(np.zeros((1, 0)), h)
        return np.asarray(body.M @ (simulator.velocity[0] - nu) / h)

    got = wrench(on([WAVE], 1, 1.3)) - wrench(waves.still(1))
    velocity, acceleration = (R.T @ world for world in water([WAVE], 1.3, place))
    froude_krylov = MASS * acceleration
    expected = ADDED[:, :3] @ (acceleration - np.cross(omega, velocity))
    expected += np.concatenate([froude_krylov, np.cross(CENTRE, froude_krylov)])
    return float(np.abs(got - expected).max() / np.abs(expected).max())


def drift_error() -> float:
    """Largest difference of velocity between a spinning neutral sphere and the water around it, over the latter's largest."""
    rng = np.random.default_rng(4)
    sea = [
        Wave(SMALL, w, direction, phase)
        for w, direction, phase in zip(
            np.linspace(0.6, 2.0, 8), rng.uniform(-1, 1, 8), rng.uniform(0, 6, 8), strict=True
        )
    ]
    simulator = FossenSimulator(afloat(np.diag([10.0, 10, 10, 0, 0, 0])), 1)
    start = np.array([0.0, 0.0, -4.0])
    velocity = np.concatenate([water(sea, 0.0, start)[0], [0.4, -0.5, 0.3]])
    simulator.reset(np.array([0]), np.array([[*start, 1.0, 0, 0, 0]]), velocity[None])
    simulator.set_waves(on(sea, 1))
    apart, largest = 0.0, 0.0
    for step in range(1, 601):
        simulator.step(np.zeros((1, 0)), 0.1)
        flow = water(sea, 0.1 * step, simulator.pose[0, :3])[0]
        own = rotation(simulator.pose[0, 3:]) @ simulator.velocity[0, :3]
        apart = max(apart, float(np.abs(own - flow).max()))
        largest = max(largest, float(np.abs(flow).max()))
    return apart / largest


def cases() -> list[Case]:
    diameter = 2 * SMALL * np.exp(-(WAVE.frequency**2) / G * 2.0)
    return [
        *(
            Case(SECTION, f"variance of the horizontal velocity, sea state 4, {name}, depth {depth:g} m", SPECTRA,
                 variance(1.88, 8.8, gamma, depth), lambda s=spectrum, d=depth: simulated_variance(s, d),
                 tolerance, "(m/s)^2")
            for spectrum, name, gamma in (("jonswap", "JONSWAP", 3.3), ("pierson_moskowitz", "Pierson-Moskowitz", 1.0))
            for depth, tolerance in ((1.0, 2e-3), (5.0, 1e-3), (20.0, 2e-4))
        ),
        Case(SECTION, "velocity of one component, .5 m and 6 s, largest deviation over its amplitude at the surface", AIRY,
             0.0, velocity_error, 1e-5),
        Case(SECTION, "path of a neutral sphere in a wave of .1 mm and 6 s at 2 m: extent along the wave", AIRY,
             diameter, lambda: orbit(SMALL, 2.0)[0], 2e-8, "m"),
        Case(SECTION, "the same: extent upwards", AIRY, diameter, lambda: orbit(SMALL, 2.0)[1], 2e-8, "m"),
        Case(SECTION, "the same: distance from its start after a period, over the diameter", AIRY, 0.0,
             lambda: orbit(SMALL, 2.0)[2] / diameter, 2e-4),
        Case(SECTION, "inertia force and moment on a fixed body, full M_A, largest deviation", AIRY, 0.0,
             lambda: inertia_error(False), 1e-5),
        Case(SECTION, "the same on a body that turns about its origin", AIRY, 0.0, lambda: inertia_error(True), 1e-5),
        Case(SECTION, "velocity of a spinning neutral sphere less the water's in 60 s of 8 components of .1 mm, largest deviation",
             AIRY, 0.0, drift_error, 2e-3),
    ]  # fmt: skip
