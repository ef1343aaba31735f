"""The symbolic equations against the compiled kernel."""

from dataclasses import replace

import numpy as np
import pytest

from auvbench.errors import ConfigError
from auvbench.simulators.fossen import FossenSimulator
from auvbench.vehicles import sheet
from auvbench.vehicles.curves import Lag
from auvbench.vehicles.symbolic import RIGID, Direct, symbolic

pytest.importorskip("casadi")

THRUSTERS_ALONE = ("bluerov2", "bluerov2_gz_sim_8_11", "bluerov2_gz_sim_8_12", "bluerov2_heavy", "bluerov2_heavy_wu2018", "bluerov2_realistic_inertia", "bluerov2_wu2018", "rexrov")  # fmt: skip


def states(vehicle, n, seed):
    """Poses (n, 7), velocities (n, 6), actions (n, n_u) all over the place."""
    rng = np.random.default_rng(seed)
    q = rng.normal(size=(n, 4))
    pose = np.hstack([rng.normal(0.0, 20.0, (n, 3)), q / np.linalg.norm(q, axis=1, keepdims=True)])
    return pose, rng.normal(0.0, 1.0, (n, 6)), rng.uniform(-1.0, 1.0, (n, len(vehicle.units)))


@pytest.mark.parametrize("name", THRUSTERS_ALONE)
def test_accelerations_are_those_of_the_compiled_kernel(name):
    vehicle = sheet.load(name)
    # What the symbolic model simplifies, a rotor's lag and one of higher order, is left out.
    units = [replace(u, lag=Lag.none()) if u.rotor_constant or u.lag.order > 1 else u for u in vehicle.units]
    vehicle = replace(vehicle, units=tuple(units))
    model, n, h = symbolic(vehicle), 64, 1e-3
    pose, velocity, action = states(vehicle, n, 1)
    current = np.array([0.3, -0.2, 0.1])
    simulator = FossenSimulator(vehicle, n, max_step=h)
    simulator.reset(np.arange(n), pose, velocity)
    simulator.set_current(current)
    simulator.step(action, h)
    values = vehicle.force(action)
    step = model.step(h, 1)
    found = np.array(
        [
            step(np.concatenate([pose[i], velocity[i], model.rest]), values[i], current).full().ravel()
            for i in range(n)
        ]
    )
    lagless = model.n_x == RIGID
    # Where there is a lag the kernel integrates it exactly and the symbolic model by RK4.
    tolerance = 1e-12 if lagless else 1e-7
    moved = np.abs(simulator.velocity - velocity).max()
    assert np.abs(found[:, 7:13] - simulator.velocity).max() < tolerance * max(1.0, moved / h)
    assert np.abs(found[:, :7] - simulator.pose).max() < 1e-10
    assert (
        np.abs(found[:, 13:] - simulator.actuators).max(initial=0.0)
        < 1e-6 * np.abs(vehicle.command_limits).max()
    )


def test_a_vehicle_with_fins_is_refused():
    with pytest.raises(ConfigError, match=r"lrauv.*rudder"):
        symbolic(sheet.load("lrauv"))


def test_a_direct_call_returns_the_bits_and_the_layout_of_casadis_call():
    model = symbolic(sheet.load("rexrov"))
    rng = np.random.default_rng(3)
    function = model.derivative.map(4)
    direct = Direct(function)
    for _ in range(2):
        arguments = [rng.normal(size=(rows, 4)) for rows in (model.n_x, model.n_u, 3)]
        (result,), expected = direct(*arguments), function(*arguments).full()
        assert np.array_equal(result, expected)
        assert result.strides == expected.strides
    (again,) = direct(*(argument + 1.0 for argument in arguments))
    assert not np.array_equal(result, again), "a result must not change with the next call"
    assert np.array_equal(result, expected)
