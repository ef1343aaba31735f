"""The compiled simulator against the plain NumPy reference and an integrator of another kind, per vehicle."""

from __future__ import annotations

import numpy as np

from auvbench.simulators import openloop
from auvbench.simulators.fossen import FossenSimulator

from ..reference.fossen import NED, Array, Body, constant, simulate
from ..reference.vehicles import ALL
from . import rig
from .case import Case

SECTION = "Plain reference"
SOURCE = "tests/reference, the same equations in plain NumPy with the numbers transcribed a second time"

FLIP = np.array([1.0, -1, -1, 1, -1, -1])
STEP = 0.01


def in_flu(body: Body) -> Body:
    return body.flipped() if body.down == NED else body


def relative(got: Array, expected: Array) -> float:
    """Largest deviation over the size of the quantity: position, quaternion, velocity, rates apart."""
    worst = 0.0
    for part in (slice(0, 3), slice(3, 7), slice(7, 10), slice(10, 13)):
        size = max(float(np.abs(expected[..., part]).max()), 1e-3)
        worst = max(worst, float(np.abs(got[..., part] - expected[..., part]).max()) / size)
    return worst


def starts(n: int, seed: int = 1) -> tuple[Array, Array]:
    rng = np.random.default_rng(seed)
    q = rng.normal(size=(n, 4))
    pose = np.column_stack([rng.normal(size=(n, 3)) * 3, q / np.linalg.norm(q, axis=1, keepdims=True)])
    return pose, rng.normal(size=(n, 6)) * [0.8, 0.5, 0.5, 0.4, 0.4, 0.4]


def states(simulator: FossenSimulator) -> Array:
    return np.column_stack([simulator.pose, simulator.velocity])


def free_motion(name: str) -> float:
    """Deviation after a second of tumbling under a wrench in a current, from random starts in a batch of 5."""
    n, sheet, body = 5, openloop.without_actuators(rig.vehicle(name)), in_flu(ALL[name])
    rng = np.random.default_rng(3)
    pose, velocity = starts(n)
    wrench = rng.normal(size=(n, 6)) * sheet.mass * [2, 2, 2, 0.05, 0.05, 0.05]
    current = rng.normal(size=(n, 3)) * 0.4
    simulator = FossenSimulator(sheet, n, max_step=STEP)
    simulator.reset(np.arange(n), pose, velocity)
    simulator.external_wrench[:] = wrench
    simulator.set_current(current)
    simulator.step(np.zeros((n, 0)), 1.0)
    expected = np.array(
        [
            simulate(body, np.concatenate([p, v]), np.array([0.0, 1.0]), constant(w), c, step=STEP)[-1]
            for p, v, w, c in zip(pose, velocity, wrench, current, strict=True)
        ]
    )
    return relative(states(simulator), expected)


def other_integrator(name: str) -> float:
    """Deviation of RK4 at .001 s from DOP853 at tight tolerances after 2 s of tumbling in a current."""
    sheet, body = openloop.without_actuators(rig.vehicle(name)), in_flu(ALL[name])
    pose, velocity = starts(1, seed=8)
    simulator = FossenSimulator(sheet, 1, max_step=0.001)
    simulator.reset(np.array([0]), pose, velocity)
    simulator.set_current([0.2, -0.1, 0.05])
    simulator.step(np.zeros((1, 0)), 2.0)
    start = np.concatenate([pose[0], velocity[0]])
    expected = simulate(body, start, np.array([0.0, 2.0]), constant(np.zeros(6)), (0.2, -0.1, 0.05))[-1]
    return relative(states(simulator)[0], expected)


def cases() -> list[Case]:
    rows = []
    for name in ALL:
        rows += [
            Case(SECTION, f"{name}: 1 s of tumbling in a current, RK4 of .01 s in both, relative deviation",
                 SOURCE, 0.0, lambda name=name: free_motion(name), 1e-12),
            Case(SECTION, f"{name}: 2 s of tumbling in a current, RK4 of .001 s against DOP853, relative deviation",
                 SOURCE, 0.0, lambda name=name: other_integrator(name), 1e-7),
        ]  # fmt: skip
    return rows
