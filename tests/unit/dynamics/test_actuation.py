"""Actuators inside the simulator: curves, exact lags, rotors, rate limits, fins, trim."""

import dataclasses

import numpy as np
import pytest
from scipy.signal import lti, step

from auvbench.dynamics.appendages import lift_and_drag
from auvbench.simulators.fossen import FossenSimulator, actuator_table
from auvbench.vehicles.curves import Curve, Lag, t200_table
from auvbench.vehicles.sheet import load
from tests.reference.actuators import TETHYS
from tests.reference.actuators import lift_and_drag as reference_lift_and_drag


@pytest.fixture(scope="module")
def bluerov2():
    return load("bluerov2")


@pytest.fixture(scope="module")
def lrauv():
    return load("lrauv")


def with_units(vehicle, **changes):
    return dataclasses.replace(
        vehicle, units=tuple(dataclasses.replace(unit, **changes) for unit in vehicle.units)
    )


def test_first_order_lag_is_exact(bluerov2):
    """Thrust after one time constant is 1 - 1/e of the command, whatever the step."""
    for duration, count in ((0.5, 1), (0.05, 10), (1 / 55, 27)):
        simulator = FossenSimulator(with_units(bluerov2, lag=Lag.first_order(0.5)), 1, max_step=0.02)
        for _ in range(count):
            simulator.step(np.ones((1, 6)), duration)
        elapsed = count * duration
        assert simulator.actuators[0] == pytest.approx(
            np.full(6, 40 * (1 - np.exp(-elapsed / 0.5))), rel=1e-12
        )


@pytest.mark.parametrize(
    ("numerator", "denominator"),
    [([2.0], [1.0, 2.0]), ([9.0], [1.0, 1.2, 9.0]), ([6136.0, 108700.0], [1.0, 89.0, 9258.0, 108700.0])],
)
def test_transfer_functions_are_exact(bluerov2, numerator, denominator):
    lag = Lag.transfer_function(numerator, denominator)
    simulator = FossenSimulator(with_units(bluerov2, lag=lag), 1)
    times = np.arange(41) * 0.05
    output = [0.0]
    for _ in times[1:]:
        simulator.step(np.full((1, 6), 0.25), 0.05)
        output.append(float(lag.C @ simulator.actuators[0, : lag.order]))
    expected = step(lti(numerator, denominator), T=times)[1]
    np.testing.assert_allclose(output, 10 * expected, atol=1e-8)
    assert lag.steady(3.0) @ lag.C == pytest.approx(3.0)


def test_lagged_thrust_enters_the_stages_at_the_right_times(bluerov2):
    """Convergence of fourth order in the step, although thrust changes within it."""

    def end(max_step):
        simulator = FossenSimulator(with_units(bluerov2, lag=Lag.first_order(0.1)), 1, max_step=max_step)
        simulator.step(np.array([[0.5, 0.4, 0.3, 0.2, 0.5, -0.4]]), 1.28)
        return simulator.velocity[0]

    exact = end(0.001)
    coarse, fine = (np.linalg.norm(end(h) - exact) for h in (0.04, 0.02))
    assert 10 < coarse / fine < 40


def test_rotor_thrust_is_quadratic(bluerov2):
    curve = Curve("linear", (-200.0, 200.0))
    vehicle = with_units(bluerov2, curve=curve, rotor_constant=2e-4)
    simulator = FossenSimulator(vehicle, 1)
    simulator.step(np.array([[1.0, -1.0, 0.5, 0.0, -0.5, 2.0]]), 0.1)
    assert simulator.command_force[0] == pytest.approx([8.0, -8.0, 2.0, 0.0, -2.0, 8.0])


@pytest.mark.parametrize("name", ["bluerov2_heavy", "bluerov2_heavy_wu2018", "rexrov"])
def test_kernel_and_model_agree_on_force_and_power(name):
    vehicle = load(name)
    command = np.linspace(-1.2, 1.2, 97)[:, None] * np.ones(len(vehicle.units))
    simulator = FossenSimulator(vehicle, 97)
    simulator.step(command, 0.01)
    np.testing.assert_allclose(simulator.command_force, vehicle.force(command), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(simulator.power, vehicle.power(command), rtol=1e-9, atol=1e-9)


def test_no_command_costs_no_power(bluerov2):
    simulator = FossenSimulator(bluerov2, 1)
    simulator.step(np.zeros((1, 6)), 0.04)
    assert simulator.power[0] == 0.0
    assert bluerov2.power(np.zeros(6)) == 0.0


@pytest.mark.parametrize("name", ["bluerov2", "bluerov2_heavy", "bluerov2_heavy_wu2018", "rexrov", "lrauv"])
def test_a_command_that_is_no_number_spoils_its_vehicle_alone(name):
    vehicle = load(name)
    good, mixed = FossenSimulator(vehicle, 2), FossenSimulator(vehicle, 2)
    command = np.full((2, len(vehicle.units)), 0.3)
    good.step(command, 0.04)
    command[0] = np.nan
    mixed.step(command, 0.04)
    assert np.all(np.isnan(mixed.velocity[0]))
    assert np.array_equal(mixed.velocity[1], good.velocity[1])


def test_t200_curve_passes_through_the_table():
    vehicle = load("bluerov2_heavy_wu2018")
    data = t200_table()
    command = (data["pwm_us"] - 1500.0) / 400.0
    force = vehicle.units[0].force(command)
    np.testing.assert_allclose(force, data["force_N"], atol=1e-9)
    assert np.all(force[np.abs(command) < 0.07] == 0.0)
    assert vehicle.force_limits[0] == pytest.approx([-39.908, 51.436], abs=1e-3)
    # Electrical power comes from the same rows.
    outside = np.abs(command) > 0.08
    np.testing.assert_allclose(
        vehicle.units[0].power(force[outside]), data["power_W"][outside], atol=2.0, rtol=0.02
    )


@pytest.mark.parametrize("name", ["bluerov2", "bluerov2_heavy", "bluerov2_heavy_wu2018", "rexrov"])
def test_action_inverts_force(name):
    vehicle = load(name)
    limits = vehicle.force_limits
    force = np.linspace(0.97 * limits[:, 0], 0.97 * limits[:, 1], 31)
    force[np.abs(force) < 0.5] = 0.0
    np.testing.assert_allclose(vehicle.force(vehicle.action(force)), force, atol=1e-3 * limits[0, 1])
    beyond = vehicle.action(2.0 * limits.T)
    assert np.all(np.abs(beyond) <= 1.0)
    assert np.all(np.abs(vehicle.force(beyond)) >= np.abs(limits.T) - 1e-6)


def test_inverse_of_von_benzons_curve_stays_on_its_rising_part():
    unit = load("bluerov2_heavy").units[0]
    top = float(unit.command(100.0))
    assert top == pytest.approx(0.972, abs=1e-3)
    assert float(unit.force(top)) == pytest.approx(30.62, abs=5e-3)
    assert float(unit.force(1.0)) == pytest.approx(30.4)


@pytest.mark.parametrize("angle", [0.0, 0.1, -0.26, 0.5])
def test_fins_against_the_reference(lrauv, angle):
    rows, _ = actuator_table(lrauv)
    rng = np.random.default_rng(2)
    c, s = np.cos(angle), np.sin(angle)
    axes = {
        1: (np.array([c, s, 0]), np.array([-s, c, 0])),
        2: (np.array([c, 0, -s]), np.array([s, 0, c])),
    }
    for velocity in rng.normal(size=(50, 3)):
        for unit, (forward, upward) in axes.items():
            expected = reference_lift_and_drag(velocity, forward, upward, **TETHYS)
            np.testing.assert_allclose(
                lift_and_drag(tuple(velocity), angle, rows[unit]), expected, atol=1e-12
            )
    assert lift_and_drag((0.0, 0.0, 0.0), angle, rows[1]) == (0.0, 0.0, 0.0)


def test_fin_only_sees_flow_through_the_water(lrauv):
    """Drifting with the current, a turned fin feels nothing."""
    simulator = FossenSimulator(lrauv, 1)
    current = np.array([0.4, 0.0, 0.0])
    simulator.reset(np.array([0]), [[0, 0, -5, 1, 0, 0, 0]], [[0.4, 0, 0, 0, 0, 0]])
    simulator.set_current(current)
    simulator.step([[0, 1, 1, 0, 0, 0]], 1.0)
    assert simulator.velocity[0] == pytest.approx([0.4, 0, 0, 0, 0, 0], abs=1e-12)


def test_rate_limits_of_shifter_and_engine(lrauv):
    simulator = FossenSimulator(lrauv, 1, max_step=0.02)
    simulator.step([[0, 0, 0, 1, -1, 0]], 10.0)
    shift, volume, dropped = simulator.actuators[0]
    assert shift == pytest.approx(10.0 * 0.0007)
    assert volume == pytest.approx(500e-6 - 10.0 * 3e-6)
    assert dropped == 0.0
    simulator.step([[0, 0, 0, 1, -1, 0]], 200.0)
    assert simulator.actuators[0, :2] == pytest.approx([0.03, 80e-6])


def test_trim_actuators_push_the_right_way(lrauv):
    # Shifting weight forward and releasing the weight behind the middle both bring the bow down.
    for command, sign in (([0, 0, 0, 1, 0, 0], 1), ([0, 0, 0, 0, 0, 1], 1), ([0, 0, 0, 0, 1, 0], 1)):
        simulator = FossenSimulator(lrauv, 1)
        simulator.step([command], 3.0)
        assert np.sign(simulator.velocity[0, 4]) == sign, command
    heave = {}
    for engine in (-1, 0, 1):
        simulator = FossenSimulator(lrauv, 1)
        simulator.step([[0, 0, 0, 0, engine, 0]], 10.0)
        heave[engine] = simulator.velocity[0, 2]
    assert heave[-1] < heave[0] == 0.0 < heave[1]


def test_a_dropped_weight_stays_dropped(lrauv):
    simulator = FossenSimulator(lrauv, 1)
    simulator.step([[0, 0, 0, 0, 0, 0.4]], 0.1)
    assert simulator.actuators[0, 2] == 0.0
    simulator.step([[0, 0, 0, 0, 0, 0.6]], 0.1)
    simulator.step([[0, 0, 0, 0, 0, -1.0]], 0.1)
    assert simulator.actuators[0, 2] == 1.0
    simulator.reset(np.array([0]), [[0, 0, 0, 1, 0, 0, 0]], np.zeros((1, 6)))
    assert simulator.actuators[0, 2] == 0.0
    assert simulator.actuators[0, 1] == 500e-6
