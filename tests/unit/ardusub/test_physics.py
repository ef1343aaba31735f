"""What ArduSub's sensors read, and that the vehicle below them is the one of the embedded simulator."""

import math

import numpy as np
import pytest

from auvbench.dynamics.frames import euler, rotation
from auvbench.errors import ConfigError
from auvbench.integrations.ardusub.physics import Physics
from auvbench.integrations.ardusub.sensors import GRAVITY
from auvbench.simulators.fossen import FossenSimulator
from auvbench.vehicles.physical import PhysicalCommands
from tests.ardusub_peer import NEUTRAL, configuration

DT = 1 / 400
DEEP = "task.start=[0,0,-20]"
AHEAD = (1350, 1350, 1650, 1650, *NEUTRAL[4:])
TUMBLE = (1300, 1620, 1540, 1700, 1380, 1650, 1590, 1410, *NEUTRAL[8:])


def physics(*overrides, **options):
    return Physics(configuration(*overrides), **options)


def run(one, pwm, seconds, dt=DT):
    for _ in range(round(seconds / dt)):
        state = one.step(pwm, dt)
    return state


def roll_pitch_yaw(state):
    return euler(state.quaternion)


def test_at_the_start_it_is_level_looks_north_and_lies_at_the_surface():
    state = physics().step(NEUTRAL, 1e-6)
    np.testing.assert_allclose(roll_pitch_yaw(state), 0.0, atol=1e-9)
    np.testing.assert_allclose(state.position, 0.0, atol=1e-9)


def test_at_rest_the_accelerometer_reads_minus_gravity():
    """A vehicle that floats comes to rest at the surface, with as much above it as carries its net buoyancy."""
    one = physics("vehicle=bluerov2")
    state = run(one, NEUTRAL, 90.0, dt=0.02)
    np.testing.assert_allclose(state.specific_force, (0.0, 0.0, -GRAVITY), atol=1e-3)
    np.testing.assert_allclose(state.gyro, 0.0, atol=1e-4)
    np.testing.assert_allclose(state.velocity, 0.0, atol=1e-3)
    vehicle = one.vehicle
    side = (vehicle.buoyancy / vehicle.density / vehicle.gravity) ** (1 / 3)
    under = vehicle.weight / vehicle.buoyancy
    assert state.depth == pytest.approx(side * (under - 0.5), abs=1e-3)


def test_without_thrust_and_water_it_falls_freely():
    """Above the surface there is no buoyancy; the added mass stays."""
    one = physics("vehicle=bluerov2")
    one.simulator.pose[0, 2] = 5.0
    state = one.step(NEUTRAL, 1e-5)
    mass = one.vehicle.M[2, 2]
    fall = one.vehicle.weight / mass
    assert state.specific_force[2] == pytest.approx(fall - GRAVITY, rel=1e-4)


@pytest.mark.parametrize("vehicle", ["bluerov2", "bluerov2_heavy"])
def test_specific_force_and_gyro_integrate_to_velocity_and_attitude(vehicle):
    """An inertial navigation with these readings finds the vehicle's own motion."""
    one = physics(f"vehicle={vehicle}", DEEP)
    state = one.step(NEUTRAL, DT)
    velocity, position = np.array(state.velocity), np.array(state.position)
    R = rotation(state.quaternion)
    for k in range(1200):
        state = one.step(TUMBLE if k % 400 < 200 else AHEAD, DT)
        before = velocity.copy()
        p, q, r = np.array(state.gyro) * DT
        R = R @ rotation(np.array([1.0, p / 2, q / 2, r / 2]) / math.sqrt(1 + (p * p + q * q + r * r) / 4))
        velocity += (rotation(state.quaternion) @ state.specific_force + (0.0, 0.0, GRAVITY)) * DT
        position += (before + velocity) / 2 * DT
    assert np.linalg.norm(state.velocity) > 0.2
    np.testing.assert_allclose(velocity, state.velocity, atol=1e-9)
    np.testing.assert_allclose(position, state.position, atol=1e-3)
    np.testing.assert_allclose(R, rotation(state.quaternion), atol=0.02)


def test_a_pulse_of_surge_moves_it_north_and_a_stick_to_starboard_east():
    one = physics("vehicle=bluerov2_heavy", DEEP)
    ahead = one.step(AHEAD, DT)
    force = one.motors.forces(AHEAD)
    # The motor's lag holds the thrust back at first; later the whole of it acts.
    assert ahead.specific_force[0] > 0.0
    state = run(one, AHEAD, 0.3)
    assert state.velocity[0] > 0.1
    assert abs(state.velocity[1]) < 1e-2
    assert state.current == pytest.approx(
        float(one.vehicle.power(one.vehicle.action(force))) / 16.0, rel=1e-6
    )
    assert np.count_nonzero(force) == 4
    right = run(physics("vehicle=bluerov2_heavy", DEEP), (1650, 1350, 1650, 1350, *NEUTRAL[4:]), 0.3)
    assert right.velocity[1] > 0.1
    turn = run(physics("vehicle=bluerov2_heavy", DEEP), (1650, 1350, 1350, 1650, *NEUTRAL[4:]), 0.3)
    assert turn.gyro[2] > 0.1
    assert roll_pitch_yaw(turn)[2] > 0.01


@pytest.mark.parametrize("vehicle", ["bluerov2", "bluerov2_heavy", "bluerov2_heavy_wu2018"])
def test_under_water_the_floats_are_those_of_the_embedded_simulator(vehicle):
    one = physics(
        f"vehicle={vehicle}", DEEP, "disturbance.current.speed=0.4", "disturbance.current.direction=0.7"
    )
    physical = PhysicalCommands(one.vehicle)
    other = FossenSimulator(physical.model, 1, one.simulator.max_step)
    other.reset(np.array([0]), one.simulator.pose.copy(), np.zeros((1, 6)))
    other.set_current(0.4 * np.array([math.cos(0.7), math.sin(0.7), 0.0]))
    for pwm in (AHEAD, TUMBLE):
        command = physical(one.motors.forces([pwm]))
        for _ in range(200):
            one.step(pwm, DT)
            other.step(command, DT)
    np.testing.assert_array_equal(one.simulator.pose, other.pose)
    np.testing.assert_array_equal(one.simulator.velocity, other.velocity)
    assert np.all(one.simulator.velocity != 0.0)


def test_a_reset_repeats_the_same_floats_in_the_same_water():
    one = physics(
        DEEP,
        "disturbance=sea_state_3",
        "disturbance.current.gauss_markov.sigma=0.2",
        "disturbance.fault.mode=any",
    )
    first = [one.step(TUMBLE, DT) for _ in range(900)]
    one.reset()
    assert [one.step(TUMBLE, DT) for _ in range(900)] == first
    other = physics(
        DEEP,
        "disturbance=sea_state_3",
        "disturbance.current.gauss_markov.sigma=0.2",
        "disturbance.fault.mode=any",
        "seed=1",
    )
    assert other.step(TUMBLE, DT) != first[0]


def test_a_current_carries_it_along():
    one = physics(
        "vehicle=bluerov2_heavy", DEEP, "disturbance.current.speed=0.5", "disturbance.current.direction=0"
    )
    state = run(one, NEUTRAL, 60.0, dt=0.01)
    north, east, _ = state.velocity
    assert east == pytest.approx(0.5, abs=0.02)
    assert abs(north) < 0.02


def test_waves_move_it_to_and_fro_and_their_time_is_that_of_the_steps():
    one = physics(DEEP.replace("-20", "-2"), "disturbance=sea_state_4")
    speeds = [run(one, NEUTRAL, 1.0).velocity[0] for _ in range(20)]
    assert min(speeds) < -0.05 < 0.05 < max(speeds)
    assert one.simulator.waves.time[0] == pytest.approx(one.time)


def test_a_dead_thruster_gives_nothing():
    one = physics("vehicle=bluerov2_heavy", DEEP, "disturbance=fault", "disturbance.fault.actuator=thruster1")
    run(one, AHEAD, 0.5)
    assert one.simulator.command_force[0, 0] == 0.0
    assert np.all(one.simulator.command_force[0, 1:4] != 0.0)


def test_steps_of_another_length_reach_the_same_place():
    coarse, fine = physics(DEEP), physics(DEEP)
    a, b = run(coarse, AHEAD, 3.0, dt=1 / 50), run(fine, AHEAD, 3.0, dt=1 / 1200)
    np.testing.assert_allclose(a.position, b.position, atol=1e-4)
    assert a.time == pytest.approx(b.time)


def test_a_lower_voltage_pushes_less():
    full, low = physics(DEEP), physics(DEEP, voltage=12.0)
    fast, slow = run(full, AHEAD, 1.0), run(low, AHEAD, 1.0)
    assert 0.0 < slow.velocity[0] < 0.9 * fast.velocity[0]
    assert slow.voltage == 12.0


@pytest.mark.parametrize(
    ("overrides", "match"),
    [
        (["vehicle=lrauv"], "rudder"),
        (["disturbance=delay"], r"disturbance\.delay"),
        (["disturbance=sensor"], r"disturbance\.sensor"),
    ],
)
def test_what_it_cannot_have_is_refused(overrides, match):
    with pytest.raises(ConfigError, match=match):
        physics(*overrides)


def test_thrusters_far_stronger_than_a_t200_need_their_own_curve():
    order = [f"thruster{i}" for i in range(8)]
    with pytest.raises(ConfigError, match="--thrust sheet"):
        physics("vehicle=rexrov", motors=order)
    state = run(physics("vehicle=rexrov", DEEP, motors=order, thrust="sheet"), (1600, *NEUTRAL[1:]), 0.2)
    assert np.linalg.norm(state.velocity) > 0.0
    with pytest.raises(ConfigError, match="--thrust t20"):
        physics(thrust="t20")
