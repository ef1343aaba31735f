"""The physics step is as short as the vehicle needs it, whatever `simulator.max_step` allows."""

import dataclasses

import numpy as np
import pytest
from omegaconf import OmegaConf

from auvbench.config.compose import typed
from auvbench.config.schema import SCALES
from auvbench.config.simulators import Fossen
from auvbench.envs.batch import Batch
from auvbench.envs.simulator_factory import make_simulator
from auvbench.simulators.fossen import FossenSimulator
from auvbench.vehicles import sheet
from auvbench.vehicles.inspect import shortest_drawn_time_constant, shortest_time_constant
from auvbench.vehicles.reader import sheet_names
from auvbench.vehicles.vehicle_model import VehicleModel
from tests import configs

N = 16
TUMBLING = (
    2.0  # rad/s, more than twice what full thrust sustains about any axis of bluerov2_realistic_inertia
)


def launched(simulator: FossenSimulator, turning: float) -> FossenSimulator:
    pose, velocity = np.zeros((N, 7)), np.zeros((N, 6))
    pose[:, 3] = 1.0
    velocity[:, 3:] = turning * np.sign(np.random.default_rng(1).uniform(-1, 1, (N, 3)))
    simulator.reset(np.arange(N), pose, velocity)
    return simulator


def made(name: str, max_step: float, turning: float = 0.0) -> FossenSimulator:
    vehicle = sheet.load(name)
    simulator = make_simulator(Fossen(name="fossen", max_step=max_step, threads=1), vehicle, N)
    assert isinstance(simulator, FossenSimulator)
    return launched(simulator, turning)


def bang_bang(simulator: FossenSimulator, frequency: float, steps: int) -> np.ndarray:
    """Full thrust ahead or back, drawn anew for each actuator in each step; the largest rate in rad/s."""
    rng = np.random.default_rng(0)
    n_u = len(simulator.vehicle.units)
    fastest = np.zeros(N)
    for _ in range(steps):
        simulator.step(np.sign(rng.uniform(-1, 1, (N, n_u))), 1.0 / frequency)
        fastest = np.maximum(fastest, np.abs(simulator.velocity[:, 3:]).max(axis=1))
    assert np.isfinite(simulator.pose).all()
    return fastest


def test_only_one_sheet_takes_shorter_steps_than_the_default():
    steps = {name: [made(name, 0.01).substeps(1 / f) for f in (10, 25, 55)] for name in sheet_names()}
    assert steps.pop("bluerov2_realistic_inertia") == [22, 9, 4]
    assert all(taken == [10, 4, 2] for taken in steps.values()), steps


@pytest.mark.parametrize("frequency", [10.0, 25.0, 55.0])
def test_a_stiff_vehicle_survives_full_thrust_either_way_and_tumbling(frequency):
    simulator = made("bluerov2_realistic_inertia", 0.01, TUMBLING)
    assert bang_bang(simulator, frequency, 4000).max() < 1.5 * TUMBLING


def test_at_the_default_step_it_would_not():
    simulator = launched(
        FossenSimulator(sheet.load("bluerov2_realistic_inertia"), N, max_step=0.01), TUMBLING
    )
    with np.errstate(all="ignore"), pytest.raises(AssertionError):
        bang_bang(simulator, 25.0, 100)


@pytest.mark.parametrize("name", sheet_names())
def test_no_vehicle_needs_a_shorter_step(name):
    """With the longest steps that the schema allows."""
    assert bang_bang(made(name, 1.0), 10.0, 1000).max() < 10.0


def ends(vehicle: VehicleModel, step: float) -> np.ndarray:
    """Positions (N, 3) after 60 s of random commands at 10 Hz."""
    simulator = launched(FossenSimulator(vehicle, N, max_step=step), 0.0)
    rng = np.random.default_rng(2)
    for _ in range(600):
        simulator.step(rng.uniform(-1, 1, (N, len(vehicle.units))), 0.1)
    return simulator.pose[:, :3].copy()


def test_trajectories_of_a_stiff_vehicle_converge():
    vehicle = sheet.load("bluerov2_realistic_inertia")
    h = shortest_time_constant(vehicle)
    whole, half, quarter = (ends(vehicle, h / parts) for parts in (1, 2, 4))
    assert np.abs(whole - half).max() < 1e-3
    assert np.abs(half - quarter).max() < np.abs(whole - half).max() / 8


LIGHT = [
    "disturbance.randomisation.mass={low: 0.3333, high: 0.3333}",
    "disturbance.randomisation.inertia={low: 0.3333, high: 0.3333}",
    "disturbance.randomisation.damping={low: 3, high: 3}",
    "disturbance.randomisation.keep_trim=true",
]


def drawn(name: str, *overrides: str) -> Batch:
    config = configs.plain(f"vehicle={name}", *overrides)
    batch = Batch(typed(OmegaConf.create(config)), N, autoreset=False)
    batch.reset()
    return batch


@pytest.mark.slow
@pytest.mark.parametrize("name", sheet_names())
def test_the_lightest_vehicle_that_may_be_drawn_decides(name: str) -> None:
    """A third of mass and inertia with three times the damping, tumbling at full thrust."""
    simulator = drawn(name, *LIGHT).simulator
    assert isinstance(simulator, FossenSimulator)
    simulator.velocity[:, 3:] = TUMBLING * np.sign(np.random.default_rng(1).uniform(-1, 1, (N, 3)))
    bang_bang(simulator, 10.0, 500)


def test_with_the_bound_of_the_sheet_it_would_not_be_finite() -> None:
    batch = drawn("bluerov2_realistic_inertia", *LIGHT)
    assert isinstance(batch.simulator, FossenSimulator)
    batch.simulator.max_step = min(0.01, shortest_time_constant(batch.vehicle))
    batch.simulator.velocity[:, 3:] = TUMBLING
    with np.errstate(all="ignore"), pytest.raises(AssertionError):
        bang_bang(batch.simulator, 10.0, 500)


def test_the_bound_is_the_time_constant_of_the_extreme_vehicle() -> None:
    """The closed form against the same constant of a sheet that is that vehicle."""
    vehicle = sheet.load("bluerov2_heavy")
    one = dict.fromkeys(SCALES, (1.0, 1.0))
    assert shortest_drawn_time_constant(vehicle, one) == shortest_time_constant(vehicle)
    light = dataclasses.replace(
        vehicle,
        mass=0.5 * vehicle.mass,
        inertia=0.25 * vehicle.inertia,
        M_A=0.5 * vehicle.M_A,
        quadratic_damping=2.0 * vehicle.quadratic_damping,
        linear_damping=2.0 * vehicle.linear_damping,
    )
    ranges = one | {"mass": (0.5, 1.0), "inertia": (0.25, 1), "added_mass": (0.5, 1), "damping": (1, 2)}
    # The weight that is drawn with the mass moves trim and lift: the bound takes the worst of both.
    assert shortest_drawn_time_constant(vehicle, ranges) <= shortest_time_constant(light)
    assert shortest_drawn_time_constant(vehicle, ranges) == pytest.approx(
        shortest_time_constant(light), rel=0.2
    )


@pytest.mark.slow
def test_the_usual_levels_keep_the_usual_steps() -> None:
    for level in ("none", "calm", "moderate", "severe"):
        simulator = drawn("bluerov2", f"disturbance={level}").simulator
        assert isinstance(simulator, FossenSimulator)
        assert [simulator.substeps(1 / f) for f in (10, 25, 55)] == [10, 4, 2]
