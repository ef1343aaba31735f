"""Check simulators."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.config.compose import compose
from auvbench.config.simulators import Capabilities
from auvbench.config.validate import train_config
from auvbench.envs.simulator_factory import make_simulator
from auvbench.simulators import guard
from auvbench.simulators.base import Simulator
from auvbench.testing import draws
from auvbench.testing.draws import ConformanceError, same
from auvbench.vehicles import sheet

N, STEPS, DURATION = 3, 12, 0.1
"""Number of vehicles, number of steps of a check, and duration of a step in s"""

Make = Callable[[int], Simulator]
"""Function that returns a new simulator with the given number of vehicles"""

STATE = ("pose", "velocity", "command_force", "power")


def start(simulator: Simulator, first: int = 0, **options: Any) -> None:
    """Put all vehicles at different places, at rest; a vehicle's place depends on `first` plus the vehicle's row."""
    rows = np.arange(simulator.n)
    pose = np.zeros((simulator.n, 7))
    pose[:, 0], pose[:, 2], pose[:, 3] = 2.0 * (first + rows), -20.0, 1.0
    simulator.reset(rows, pose, np.zeros((simulator.n, 6)), **options)


def fly(simulator: Simulator, steps: range = range(STEPS), first: int = 0) -> dict[str, NDArray[np.float64]]:
    """Apply commands for some steps; return the states after each step by name, (steps, n, ...)."""
    states: dict[str, list[NDArray[np.float64]]] = {name: [] for name in STATE}
    for step in steps:
        simulator.step(draws.actions(step, simulator.n, len(simulator.vehicle.actuators), first), DURATION)
        for name in STATE:
            states[name].append(np.array(getattr(simulator, name), dtype=np.float64))
    return {name: np.asarray(values) for name, values in states.items()}


def compare(first: dict[str, Any], second: dict[str, Any], what: str) -> None:
    for name in first:
        same(first[name], second[name], f"{what}: {name}")


def its_arrays_are_what_they_should(make: Make) -> None:
    """Check the simulator's arrays, and check that `capabilities` has the right type.

    `pose` (n, 7), `velocity` (n, 6), `command_force` (n, n_u) and `power` (n,) must be finite float64 arrays, and quaternions must
    have length 1.
    """
    simulator = make(N)
    if not isinstance(simulator.capabilities, Capabilities):
        raise ConformanceError("capabilities is no auvbench.plugin.Capabilities")
    start(simulator)
    fly(simulator)
    for name, shape in guard.shapes(simulator).items():
        array = np.asarray(getattr(simulator, name))
        if array.shape != shape or array.dtype != np.float64:
            raise ConformanceError(f"{name} is {array.dtype}{array.shape}; it must be float64{shape}")
        if not np.isfinite(array).all():
            raise ConformanceError(f"{name} is not finite after {STEPS} steps")
    length = np.linalg.norm(simulator.pose[:, 3:], axis=1)
    if np.abs(length - 1.0).max() > 1e-9:
        raise ConformanceError(f"the quaternion of a pose has length {length.max():.12g}; it must be 1")


def reset_puts_vehicles_where_it_says(make: Make) -> None:
    """Check that `reset` moves the given vehicles, and no others."""
    simulator = make(N)
    start(simulator)
    fly(simulator)
    other_poses = simulator.pose[[0, 2]].copy()
    pose = np.array([[5.0, -4.0, -30.0, np.cos(0.4), 0.0, 0.0, np.sin(0.4)]])
    simulator.reset(np.array([1]), pose, np.zeros((1, 6)))
    if np.abs(simulator.pose[1] - pose[0]).max() > 1e-9:
        raise ConformanceError(f"reset to {pose[0]} leaves the vehicle at {simulator.pose[1]}")
    if np.abs(simulator.velocity[1]).max() > 1e-9:
        raise ConformanceError(f"reset at rest leaves the vehicle a velocity of {simulator.velocity[1]}")
    same(simulator.pose[[0, 2]], other_poses, "reset of vehicle 1 must not move the other vehicles")


def motion_does_not_depend_on_the_batch(make: Make) -> None:
    """Check that, in a deterministic simulator, a vehicle's motion is bit for bit the same in a batch of any size."""
    simulator = make(N)
    start(simulator)
    together = fly(simulator)
    simulator_of_one = make(1)
    start(simulator_of_one, first=1)
    single = fly(simulator_of_one, first=1)
    if simulator.capabilities.deterministic:
        second = {name: values[:, 1:2] for name, values in together.items()}
        compare(second, single, "a vehicle alone and among three")


def nothing_outlives_a_reset(make: Make) -> None:
    """Check that, in a deterministic simulator, motion after a `reset` is bit for bit the motion in a new simulator."""
    simulator = make(N)
    start(simulator)
    first = fly(simulator)
    start(simulator)
    second = fly(simulator)
    if simulator.capabilities.deterministic:
        compare(first, second, "after a reset")


def motion_is_deterministic(make: Make) -> None:
    """Check that steps draw from no global generator, and that in a deterministic simulator the same commands give the same bits."""
    draws.reseed_generators(1)
    simulator = make(N)
    start(simulator)
    with draws.untouched("stepping"):
        first = fly(simulator)
    draws.reseed_generators(2)
    repeated = make(N)
    start(repeated)
    if simulator.capabilities.deterministic:
        compare(first, fly(repeated), "made a second time")


def commands_are_clipped(make: Make) -> None:
    """Check that a command above 1 gives the same force as a command of 1."""
    forces = []
    for size in (1.0, 3.0):
        simulator = make(1)
        start(simulator)
        simulator.step(np.full((1, len(simulator.vehicle.actuators)), size), DURATION)
        forces.append(np.array(simulator.command_force))
    same(forces[0], forces[1], "commands of 1 and 3 must give the same force")


def its_state_comes_back(make: Make) -> None:
    """Check that `state_dict` has plain arrays, and that with `exact_resume` another simulator continues exactly from this state."""
    simulator = make(N)
    start(simulator)
    fly(simulator)
    state = {name: np.array(value) for name, value in simulator.state_dict().items()}
    objects = [name for name, value in state.items() if value.dtype.hasobject]
    if objects:
        raise ConformanceError(
            f"state_dict: {objects[0]} contains Python objects; it must contain plain arrays, which can be stored without a pickle"
        )
    if not simulator.capabilities.exact_resume:
        return
    ahead = range(STEPS, 2 * STEPS)
    went_on = fly(simulator, ahead)
    other = make(N)
    start(other)
    other.load_state_dict(state)
    compare(went_on, fly(other, ahead), "from its state_dict on")


def it_does_what_it_declares(make: Make) -> None:
    """Check that currents and scales change the motion, if `capabilities` declares them."""
    can = make(1).capabilities
    moved = []
    for current in (0.0, 0.5) if can.currents != "none" else ():
        simulator = make(1)
        start(simulator)
        simulator.set_current([current, 0.0, 0.0])
        for _ in range(STEPS):
            simulator.step(np.zeros((1, len(simulator.vehicle.actuators))), DURATION)
        moved.append(float(simulator.pose[0, 0]))
    if moved and not moved[1] > moved[0] + 1e-3:
        raise ConformanceError(
            f"a current of 0.5 m/s must carry a vehicle along; it moves {moved[1] - moved[0]:.3g} m in {STEPS * DURATION:g} s"
        )
    if can.scales:
        speeds = []
        for mass in (1.0, 1.5):
            simulator = make(1)
            start(simulator, scales=np.array([[mass, mass, 1.0, 1.0, 1.0, 1.0]]))
            simulator.step(np.full((1, len(simulator.vehicle.actuators)), 0.5), DURATION)
            speeds.append(np.array(simulator.velocity))
        if np.array_equal(speeds[0], speeds[1]):
            raise ConformanceError(
                "a vehicle with scales of 1.5 for mass and inertia moves as one without; scales must change the motion"
            )


SIMULATOR_CHECKS: tuple[Callable[[Make], None], ...] = (
    its_arrays_are_what_they_should,
    reset_puts_vehicles_where_it_says,
    motion_does_not_depend_on_the_batch,
    nothing_outlives_a_reset,
    motion_is_deterministic,
    commands_are_clipped,
    its_state_comes_back,
    it_does_what_it_declares,
)
"""The checks of every simulator."""


def check_simulator(*overrides: str, only: Callable[[Make], None] | None = None) -> None:
    """Check a simulator against its contract (`auvbench.simulators.base.Simulator`).

    Args:
        overrides: arguments of `auvbench train`: the simulator, `simulator=NAME`, and possibly a vehicle.
        only: one of `SIMULATOR_CHECKS`; default: all.

    Raises:
        ConformanceError: the simulator breaks its contract.
        ConfigError: an override is wrong, or the simulator cannot be used here.
    """
    config = train_config(compose("train", list(overrides)))
    vehicle = sheet.load(config.vehicle)

    def make(n: int) -> Simulator:
        return make_simulator(config.simulator, vehicle, n, config.disturbance)

    draws.run_checks(SIMULATOR_CHECKS, only, overrides, lambda check: check(make))
