"""Thrusters before Gazebo: the same as in the embedded simulator, and the bindings' absence in one line."""

import numpy as np
import pytest

from auvbench.cli import main
from auvbench.config.compose import compose
from auvbench.config.validate import train_config
from auvbench.envs.batch import Batch
from auvbench.errors import ConfigError
from auvbench.integrations.gazebo import bindings
from auvbench.integrations.gazebo.simulator import Thrust
from auvbench.simulators.fossen import FossenSimulator
from auvbench.vehicles.sheet import load


@pytest.mark.parametrize("name", ["bluerov2", "bluerov2_heavy", "bluerov2_heavy_wu2018", "rexrov"])
def test_states_and_forces_are_those_of_the_embedded_simulator(name):
    vehicle = load(name)
    rng = np.random.default_rng(0)
    n = 5
    fossen = FossenSimulator(vehicle, n, max_step=0.01)
    thrust = Thrust(vehicle, fossen.actuators.copy())
    for _ in range(4):
        command = rng.uniform(-1, 1, (n, len(vehicle.units)))
        forces = thrust.forces(command, 10, 0.01)
        fossen.step(command, 0.1)
        np.testing.assert_allclose(thrust.states, fossen.actuators, rtol=1e-9, atol=1e-9)
    for _ in range(30):
        forces = thrust.forces(command, 20, 0.01)
    np.testing.assert_allclose(forces[-1], vehicle.force(command), rtol=1e-6, atol=1e-6)


def test_the_force_of_a_physics_step_is_that_of_its_middle():
    vehicle = load("rexrov")  # first order, then squared
    fine, coarse = (Thrust(vehicle, FossenSimulator(vehicle, 1).actuators) for _ in range(2))
    command = np.full((1, len(vehicle.units)), 0.7)
    mean = fine.forces(command, 1000, 1e-4).reshape(10, 100, -1).mean(axis=1)
    # The first steps rise as the square of time, where the middle is below the mean.
    np.testing.assert_allclose(coarse.forces(command, 10, 1e-2)[2:, 0], mean[2:], rtol=0.01)


@pytest.mark.slow
def test_missing_bindings_are_one_line_that_says_how_they_come(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(bindings, "_MODULES", ("auvbench_has_no_such_module",))
    bindings.load.cache_clear()
    try:
        config = train_config(compose("train", ["simulator=gazebo", "algo=pid"]))
        with pytest.raises(ConfigError, match=r"python3-gz-sim8.*--system-site-packages"):
            Batch(config, 1)
        assert bindings.missing() is not None
        code = main(["train", "simulator=gazebo", "algo=ppo", f"output={tmp_path}"])
        error = capsys.readouterr().err
        assert code == 2
        assert error.count("gz-harmonic") == 1
        assert "Traceback" not in error
    finally:
        bindings.load.cache_clear()


@pytest.mark.slow
def test_currents_that_gazebo_cannot_are_refused_while_composing():
    published = ["simulator=gazebo", "simulator.hydrodynamics=published"]
    with pytest.raises(
        ConfigError, match="needs a varying current, which simulator=gazebo does not have as configured"
    ):
        train_config(compose("train", [*published, "disturbance=gauss_markov"]))
    train_config(compose("train", [*published, "disturbance=current"]))
    train_config(compose("train", ["simulator=gazebo", "disturbance=depth_current"]))
    train_config(compose("train", ["simulator=gazebo", "disturbance=severe"]))
