"""The controllers that know the vehicle's equations: LQR, sliding mode, MPC and the filter under it."""

from __future__ import annotations

import numpy as np
import pytest

from auvbench.agents.classical import lqr
from auvbench.envs.batch import Batch
from auvbench.errors import ConfigError
from auvbench.evaluation.rollout import roll_out
from auvbench.registry import AGENTS, resolve
from auvbench.vehicles import sheet
from tests import configs

THRUSTERS = (
    "bluerov2",
    "bluerov2_realistic_inertia",
    "bluerov2_wu2018",
    "bluerov2_heavy",
    "bluerov2_heavy_wu2018",
    "rexrov",
)


def controller(algo: str, *overrides: str):
    config = configs.training(f"algo={algo}", *overrides)
    return config, resolve(AGENTS[config.algo.agent].factory)(config, sheet.load(config.vehicle))


def records(algo: str, episodes: int, *overrides: str, batch: int = 500):
    config, agent = controller(algo, *overrides)
    rows = np.arange(episodes)
    agent.reset(rows)
    return roll_out(config, agent, episodes=rows, seed=123, batch=batch).records


def success(rows) -> float:
    return float(np.mean([row["outcome"] == "success" for row in rows]))


# Where they fall behind PID: the gains are the ones for the BlueROV2.
LEAST = {
    ("lqr", "bluerov2_heavy"): 0.6,
    ("smc", "bluerov2_heavy_wu2018"): 0.75,
    ("adrc", "bluerov2_heavy_wu2018"): 0.75,
}


@pytest.mark.slow
@pytest.mark.parametrize("vehicle", THRUSTERS)
@pytest.mark.parametrize("algo", ["lqr", "smc", "adrc"])
def test_they_fly_every_vehicle_with_thrusters(algo, vehicle):
    assert success(records(algo, 60, f"vehicle={vehicle}")) >= LEAST.get((algo, vehicle), 0.95)


@pytest.mark.slow
@pytest.mark.parametrize("vehicle", THRUSTERS)
@pytest.mark.parametrize("algo", ["pid", "lqr", "smc", "adrc"])
def test_they_hold_a_station_and_its_yaw_with_every_vehicle(algo, vehicle):
    """bluerov2_realistic_inertia damps its turning ten times as much as its inertia resists it."""
    assert success(records(algo, 20, "task=station_keeping", f"vehicle={vehicle}")) == 1.0


@pytest.mark.parametrize("algo", ["lqr", "smc", "adrc"])
def test_they_hold_against_a_current(algo):
    assert success(records(algo, 60, "disturbance.current.speed=0.5")) >= 0.95


@pytest.mark.parametrize("algo", ["lqr", "smc", "adrc", "mpc"])
def test_fins_are_refused_by_name(algo):
    with pytest.raises(ConfigError, match=r"vehicle=lrauv.*rudder"):
        controller(algo, "vehicle=lrauv")


@pytest.mark.parametrize(("algo", "task"), [("pid", "waypoint"), ("alos", "path_following")])
def test_fins_refuse_an_integral_of_the_heading(algo, task):
    with pytest.raises(ConfigError, match=r"algo.heading_integral_time=5: not available for vehicle=lrauv"):
        controller(algo, f"task={task}", "vehicle=lrauv", "algo.heading_integral_time=5")


@pytest.mark.slow
@pytest.mark.parametrize("algo", ["lqr", "smc", "mpc"])
def test_rows_do_not_depend_on_the_batch(algo):
    together = records(algo, 4, "task.max_steps=40")
    alone = records(algo, 4, "task.max_steps=40", batch=1)
    assert together == alone


@pytest.mark.parametrize("speed", [0.5, 1.4])
def test_the_linear_quadratic_loop_is_stable(speed):
    vehicle = sheet.load("bluerov2")
    config, agent = controller("lqr", f"algo.cruise_speed={speed}")
    A, B = lqr.cruise_plant(vehicle, speed)
    closed = np.linalg.eigvals(A - B @ lqr.lqr_gain(vehicle, config.algo, agent.dt))
    assert closed.real.max() < -0.02


@pytest.mark.parametrize("name", ["bluerov2", "bluerov2_gz_sim_8_12", "bluerov2_gz_sim_8_11"])
def test_the_cruise_plant_is_the_slope_of_the_simulated_acceleration(name):
    """Munk's moment among it: sway and yaw at speed are coupled by added mass."""
    vehicle = sheet.load(name)
    A, _ = lqr.cruise_plant(vehicle, 1.0)
    # With roll and pitch held: their rows and columns of M are left out.
    M = vehicle.M[np.ix_(lqr.CONTROLLED, lqr.CONTROLLED)]
    slope = M @ A[np.ix_([0, 1, 2, 4], [0, 1, 2, 4])]
    # d N / d v = (X_udot - Y_vdot) u of the rigid and the added mass, moved by the centre of gravity.
    added = vehicle.M_A
    assert slope[0, 0] == pytest.approx(-(25.15 + 2 * 33.8))
    munk = added[1, 1] - added[0, 0]
    expected = {"bluerov2": -munk, "bluerov2_gz_sim_8_12": munk, "bluerov2_gz_sim_8_11": -added[0, 0]}[name]
    assert slope[3, 1] == pytest.approx(expected, rel=1e-6)
    by_heave = -added[2, 2] if name == "bluerov2_gz_sim_8_11" else 0.0
    assert slope[3, 2] == pytest.approx(by_heave, rel=1e-6, abs=1e-6)


def test_sliding_mode_s_gain_stays_within_its_bounds():
    config, agent = controller("smc")
    agent.reset(np.arange(50))
    rng = np.random.default_rng(0)
    for _ in range(50):
        action = agent.act(rng.normal(0.0, 20.0, (50, 10)).astype(np.float32))
        assert np.abs(action).max() <= 1.0
    assert agent.switching.min() >= config.algo.switching_gain
    assert agent.switching.max() <= config.algo.largest_gain
    assert agent.switching.max() > config.algo.switching_gain


def test_the_observer_of_adrc_finds_a_constant_force_and_the_law_cancels_it():
    _, agent = controller("adrc", "algo.bandwidth=1", "algo.observer_bandwidth=2")
    agent.reset(np.arange(2))
    wanted, velocity = np.array([[0.5, 0.0, -0.2], [0.0, 0.0, 0.0]]), np.zeros((2, 3))
    pushes = np.array([[20.0, -10.0, 5.0], [0.0, 0.0, 0.0]])
    scale = np.ones(2)
    for _ in range(300):
        wrench = agent.law(wanted, velocity)
        agent.after(wanted - velocity, scale)
        drag = agent._drag(velocity)
        velocity = velocity + agent.dt * (wrench[:, :3] - drag + pushes) / agent.inertias[:3]
    assert velocity == pytest.approx(wanted, abs=1e-6)
    assert agent.rest[:, :3] * agent.inertias[:3] == pytest.approx(pushes, abs=1e-4)


def test_the_observer_of_adrc_does_not_wind_up_while_thrusters_saturate():
    _, agent = controller("adrc")
    agent.reset(np.arange(1))
    wanted, velocity, share = np.array([[5.0, 0.0, 0.0]]), np.zeros((1, 3)), np.full(1, 0.3)
    lift = np.array([0.0, 0.0, agent.lift])
    for _ in range(200):
        wrench = agent.law(wanted, velocity)[:, :3]
        agent.after(wanted - velocity, share)
        applied = share * (wrench - lift) + lift
        damping = agent.vehicle.linear_damping[:3] + agent.vehicle.quadratic_damping[:3] * np.abs(velocity)
        mass = agent.inertias[:3] + agent.dt * damping
        velocity = (agent.inertias[:3] * velocity + agent.dt * applied) / mass
    assert np.abs(agent.rest).max() < 1e-9


class TestMPC:
    @pytest.fixture(autouse=True)
    def _casadi(self):
        pytest.importorskip("casadi")

    @pytest.mark.slow
    def test_it_arrives_sooner_than_pid(self):
        mpc, pid = records("mpc", 6), records("pid", 6)
        assert success(mpc) == success(pid) == 1.0
        assert np.mean([r["steps"] for r in mpc]) < np.mean([r["steps"] for r in pid])

    @pytest.mark.parametrize("vehicle", ["bluerov2_heavy", "rexrov"])
    @pytest.mark.slow
    def test_it_flies_other_vehicles(self, vehicle):
        assert success(records("mpc", 3, f"vehicle={vehicle}")) == 1.0

    def test_a_plan_of_nan_is_simulated_anew(self):
        config, agent = controller("mpc")
        agent.reset(np.arange(1))
        observation = Batch(config, 1, seed=3).reset()
        agent.act(observation)
        agent.plans[0].X[:] = np.nan
        agent.act(observation)
        assert agent.notes()["failed_solves"] == 0
        assert np.isfinite(agent.plans[0].X).all()

    def test_a_failed_solve_keeps_the_plan_and_is_counted(self, monkeypatch):
        config, agent = controller("mpc")
        batch = Batch(config, 1, seed=3, test=True, autoreset=False)
        agent.reset(np.arange(1))
        observation = batch.reset()
        for _ in range(5):
            observation = batch.step(agent.act(observation)).observation
        assert agent.notes()["failed_solves"] == 0
        before = agent.plans[0].U.copy()
        monkeypatch.setattr(agent.program, "improve", lambda *_: False)
        action = agent.act(observation)
        assert agent.notes()["failed_solves"] == 1
        moved = before.copy()
        moved[:, :-1] += agent.dt / agent.program.interval * np.diff(before, axis=1)
        np.testing.assert_array_equal(action[0], agent.vehicle.action(moved[:, 0]))

    def test_the_filter_finds_attitude_velocity_and_current_from_noisy_readings(self):
        config, agent = controller(
            "mpc", "disturbance.current.speed=0.4", "disturbance.current.direction=0.0"
        )
        batch = Batch(config, 4, seed=5, test=True, autoreset=False)
        agent.reset(np.arange(4))
        observer, observation = agent.observer, batch.reset()
        rng = np.random.default_rng(0)
        action = np.zeros((4, 6))
        for k in range(150):
            observer.update(observation.astype(float), np.arange(4))
            if k % 10 == 0:
                action = rng.uniform(-0.6, 0.6, (4, 6))
            observation = batch.step(action).observation
        observer.update(observation.astype(float), np.arange(4))
        simulator = batch.simulator
        assert np.abs(observer.current[:, 0] - 0.4).max() < 0.12
        assert np.abs(observer.state[:, 7:10] - simulator.velocity[:, :3]).max() < 0.2
        # The world's z axis in body axes: roll and pitch, which no sensor tells.
        up = [
            2 * (q[:, 1] * q[:, 3] - q[:, 0] * q[:, 2])
            for q in (observer.state[:, 3:7], simulator.pose[:, 3:])
        ]
        assert np.abs(up[0] - up[1]).max() < 0.08

    def test_depth_limits_are_kept(self):
        """A waypoint just under the surface: the plan may not rise above the margin on its way."""
        overrides = ["task.waypoint_low=[10,0,-1.5]", "task.waypoint_high=[12,1,-1.2]"]
        assert all(row["depth_margin_m"] > 0.0 for row in records("mpc", 2, *overrides))


@pytest.mark.parametrize("task", ["waypoint", "docking"])
def test_a_filter_that_has_lost_its_vehicle_starts_anew(task):
    pytest.importorskip("casadi")
    config, agent = controller("mpc", "vehicle=rexrov", f"task={task}")
    observation = Batch(config, 1, seed=0).reset()
    agent.reset(np.arange(1))
    agent.act(observation)
    state = agent.observer.state.copy()
    agent.observer.state[0, 7:13] = 1e60
    agent.observer.current[0] = 1e60
    assert np.isfinite(agent.act(observation)).all()
    assert agent.observer.state == pytest.approx(state)
