"""Model predictive path integral control: its draws, rollouts, costs and weights, and the plan that it keeps."""

from __future__ import annotations

import numpy as np
import pytest

from auvbench import cli
from auvbench.agents.classical import sampling
from auvbench.agents.classical.mppi import MPPIController
from auvbench.agents.classical.sampling import AIM, NODES, Sampler, charge, weights
from auvbench.dynamics import frames
from auvbench.envs.batch import Batch
from auvbench.simulators.fossen import FossenSimulator
from auvbench.tasks.observation_spec import observation_spec
from auvbench.vehicles import sheet
from tests import configs

pytest.importorskip("casadi")

FEW = ("algo=mppi", "algo.samples=32")
KEY = (5, 3, 2, 0)


def sampler_of(vehicle: str, *overrides: str, turns: bool = False) -> Sampler:
    config = configs.training(*FEW, f"vehicle={vehicle}", *overrides)
    return Sampler(sheet.load(vehicle), config.algo, turns)


def drawn(sampler: Sampler, plan: np.ndarray, key: tuple[int, int, int, int] = KEY) -> np.ndarray:
    """Return the thrusts (NODES, n, n_u) of samples about a plan."""
    sampler.draw(plan, key)
    return sampler.thrusts.copy()


def aims_at(*position: float) -> np.ndarray:
    aims = np.zeros(NODES, AIM)
    aims["position"], aims["course"] = position, (1.0, 0.0)
    aims["low"], aims["high"] = -np.inf, np.inf
    return aims.view(np.float64).reshape(NODES, -1)


def controller(*overrides: str) -> MPPIController:
    config = configs.training(*FEW, *overrides)
    return MPPIController(config, sheet.load(config.vehicle))


@pytest.fixture(scope="module")
def readings() -> list[np.ndarray]:
    """Return observations (3, n_obs) of some steps under small thrusts."""
    batch = Batch(configs.training(), 3, seed=4, validation=True, autoreset=False)
    steps = [batch.reset().copy()]
    rng = np.random.default_rng(0)
    for _ in range(4):
        steps.append(batch.step(rng.uniform(-0.3, 0.3, (3, 6))).observation.copy())
    return steps


def flown(agent: MPPIController, readings: list[np.ndarray], rows: list[int]) -> np.ndarray:
    agent.reset(np.array(rows))
    return np.array([agent.act(reading[rows]) for reading in readings])


def test_weights_are_those_of_the_formula():
    rng = np.random.default_rng(1)
    cost, control = rng.uniform(50.0, 90.0, 9), rng.normal(size=9)
    gap = sorted(cost)[4] - min(cost)
    expected = np.exp(-cost / (0.2 * gap) - 0.7 * control)
    np.testing.assert_allclose(weights(cost, control, 0.2, 0.7), expected / expected.sum(), rtol=1e-12)


def test_a_sample_without_a_finite_cost_has_no_weight():
    cost = np.array([3.0, np.nan, 1.0, np.inf, 2.0])
    weight = weights(cost, np.zeros(5), 1.0, 0.0)
    expected = np.exp([-2.0, -1.0, 0.0])  # the median of the finite costs is 1 above the least
    np.testing.assert_allclose(weight[[0, 4, 2]], expected / expected.sum(), rtol=1e-12)
    assert weight[1] == weight[3] == 0.0
    assert weights(np.full(3, np.nan), np.zeros(3), 1.0, 0.0) is None
    np.testing.assert_allclose(weights(np.ones(4), np.zeros(4), 1.0, 0.0), 0.25)


@pytest.mark.parametrize("vehicle", ["bluerov2_2026", "rexrov"])
def test_a_rollout_is_the_simulator_s(vehicle):
    """The same bits with the same substep; within 1 cm after the horizon of the simulator's own substep of 0.01 s."""
    sampler = sampler_of(vehicle)
    drawn(sampler, np.zeros((NODES, len(sampler.low))))
    state = np.zeros(13)
    state[3:7] = 0.5, 0.5, -0.5, 0.5
    state[7:] = 0.3, -0.2, 0.1, 0.1, -0.1, 0.2
    current = np.array([0.3, -0.2, 0.0])
    applied, lags = np.zeros(len(sampler.low)), sampler.model.actuators[0].copy()
    sampler.roll_out(state, lags, current, applied, aims_at(1.0, 2.0, 3.0))
    for step, tolerance in ((sampler.model.max_step, 0.0), (0.01, 0.01)):
        simulator = FossenSimulator(sheet.load(vehicle), 1, max_step=step)
        simulator.reset(np.array([0]), state[:7], state[7:])
        simulator.set_current(current)
        for k in range(NODES):
            simulator.step(sampler.commands[k, 7:8], sampler.interval)
        np.testing.assert_allclose(sampler.model.pose[7, :3], simulator.pose[0, :3], rtol=0, atol=tolerance)
        if not tolerance:
            np.testing.assert_array_equal(sampler.model.velocity[7], simulator.velocity[0])


def test_samples_are_the_plan_and_pairs_about_it():
    sampler = sampler_of("bluerov2_2026", "algo.noise=0.05", "algo.samples=33")
    plan = np.random.default_rng(2).uniform(-5.0, 5.0, (NODES, 6))
    thrusts = drawn(sampler, plan)
    np.testing.assert_array_equal(thrusts[:, 0], plan)
    np.testing.assert_allclose(thrusts[:, 1::2] + thrusts[:, 2::2], 2.0 * plan[:, None] * np.ones((1, 16, 1)))
    np.testing.assert_allclose(sampler.control[1::2], -sampler.control[2::2])
    # The commands give the thrusts, up to the grid of the table next to the dead zone.
    np.testing.assert_allclose(sheet.load("bluerov2_2026").force(sampler.commands), thrusts, atol=0.25)


def test_the_noise_has_its_deviation_and_its_time_constant():
    sampler = sampler_of("bluerov2_2026", "algo.samples=4096", "algo.noise=0.05", "algo.correlation=0.8")
    noise = drawn(sampler, np.zeros((NODES, 6)))[:, 1::2] @ sampler.unmix.T  # standard normal along each axis
    assert noise.shape[2] == 5, "a BlueROV2 cannot pitch by its thrusters"
    np.testing.assert_allclose(noise.std(axis=(0, 1)), 1.0, atol=0.03)
    along = (noise[1:] * noise[:-1]).mean(axis=(0, 1))
    np.testing.assert_allclose(along, np.exp(-sampler.interval / 0.8), atol=0.03)
    assert np.abs(np.corrcoef(noise.reshape(-1, 5).T) - np.eye(5)).max() < 0.03


def test_the_control_cost_is_that_of_the_noise_s_covariance():
    """u' Sigma^-1 (v - u) by inverting Sigma itself."""
    sampler = sampler_of("bluerov2_2026", "algo.noise=0.05")
    plan = np.random.default_rng(3).uniform(-5.0, 5.0, (NODES, 2)) @ sampler.mix.T[[0, 2]] / 20.0
    noise = (drawn(sampler, plan) - plan[:, None])[:, 1] @ sampler.unmix.T
    steps = np.abs(np.subtract.outer(np.arange(NODES), np.arange(NODES)))
    Sigma = np.exp(-steps * sampler.interval / sampler.algo.correlation)
    expected = np.sum((plan @ sampler.unmix.T) * np.linalg.solve(Sigma, noise))
    assert sampler.control[1] == pytest.approx(expected)


@pytest.mark.parametrize("which", range(4))
def test_draws_depend_on_seed_episode_step_and_iteration(which):
    sampler, plan = sampler_of("bluerov2_2026"), np.zeros((NODES, 6))
    other = tuple(number + (place == which) for place, number in enumerate(KEY))
    first = drawn(sampler, plan)
    assert not np.array_equal(drawn(sampler, plan, other), first)
    np.testing.assert_array_equal(drawn(sampler, plan), first)


@pytest.mark.parametrize("turns", [False, True])
def test_the_cost_of_a_node_is_that_of_the_formula(turns):
    sampler = sampler_of("bluerov2_2026", turns=turns)
    rng, n = np.random.default_rng(4), 5
    pose, velocity, force = rng.normal(size=(n, 7)), rng.normal(size=(n, 6)), rng.normal(size=(n, 6))
    pose[:, 3:] /= np.linalg.norm(pose[:, 3:], axis=1, keepdims=True)
    before, cost = rng.normal(size=(n, 6)), np.ones(n)
    aim = np.array([0.5, 0.2, -0.1, np.cos(0.3), np.sin(0.3), -0.4, 0.6])
    algo, shares = sampler.algo, force * sampler.shares
    away = np.linalg.norm(pose[:, :3] - aim[:3], axis=1)
    expected = 1.0 + algo.terminal_weight * away**2 / np.maximum(away, 1.0)
    expected += algo.spin_weight * (velocity[:, 3 : 5 if turns else 6] ** 2).sum(axis=1)
    expected += sampling.DEPTH_PRICE * (np.maximum(-0.4 - pose[:, 2], 0) + np.maximum(pose[:, 2] - 0.6, 0))
    expected += algo.effort_weight * (shares**2).sum(axis=1)
    expected += algo.change_weight * ((shares - before) ** 2).sum(axis=1)
    if turns:
        off = np.angle(np.exp(1j * (frames.yaw(pose[:, 3:]) - 0.3)))
        lean = np.array([frames.rotation(q)[:2, 2] for q in pose[:, 3:]])
        expected += sampling.YAW_WEIGHT * off**2 + sampling.TILT_WEIGHT * (lean**2).sum(axis=1)
    charge(pose, velocity, force, sampler.shares, before, aim, sampler.prices[1], cost)
    np.testing.assert_allclose(cost, expected)
    np.testing.assert_array_equal(before, shares)


def test_an_iteration_lowers_the_cost_of_a_plan():
    sampler, plan, lags = sampler_of("bluerov2_2026", "algo.samples=128"), np.zeros((NODES, 6)), np.zeros(6)
    state = np.array([0.0, 0.0, 0.0, 1.0, *np.zeros(9)])
    costs = []
    for iteration in range(6):
        assert sampler.improve(
            plan, state, lags, np.zeros(3), np.zeros(6), aims_at(6.0, 2.0, 1.0), (0, 0, 0, iteration)
        )
        costs.append(sampler.cost[0])
    assert costs[-1] < 0.95 * costs[0]


def test_an_episode_s_actions_do_not_depend_on_the_other_rows(readings):
    together = flown(controller(), readings, [0, 1, 2])
    for row in range(3):
        np.testing.assert_array_equal(flown(controller(), readings, [row])[:, 0], together[:, row])
    np.testing.assert_array_equal(flown(controller(), readings, [2, 0]), together[:, [2, 0]])
    assert not np.array_equal(flown(controller("seed=43"), readings, [0])[:, 0], together[:, 0])


def test_the_model_is_the_sheet_s_vehicle_and_not_the_drawn_one(readings):
    drawn_vehicles = flown(controller("disturbance=severe"), readings, [0])
    np.testing.assert_array_equal(flown(controller(), readings, [0]), drawn_vehicles)


def test_its_memory_goes_on_with_the_same_bits(readings):
    whole = flown(controller(), readings, [0, 1])
    first, second = controller(), controller()
    flown(first, readings[:3], [0, 1])
    second.reset(np.array([7, 8]))
    for name, array in second.memory().items():
        array[...] = first.memory()[name]
    for k in (3, 4):
        np.testing.assert_array_equal(second.act(readings[k][:2]), whole[k])


def test_a_plan_is_advanced_and_stays_when_no_sample_is_finite(readings, monkeypatch):
    agent = controller("algo.horizon=4.8")  # nodes of 0.2 s
    flown(agent, readings[:2], [0])
    before = agent.plans[0].copy()
    monkeypatch.setattr(agent.sampler, "roll_out", lambda *_: agent.sampler.cost.fill(np.nan))
    action = agent.act(readings[2][:1])
    moved = before.copy()
    moved[:-1] += 0.5 * np.diff(before, axis=0)
    np.testing.assert_allclose(agent.plans[0], moved)
    np.testing.assert_array_equal(action[0], agent.vehicle.action(agent.plans[0, 0]))
    assert agent.notes()["plans"] == 3
    assert agent.notes()["failed_plans"] == 1


def test_lags_follow_the_observed_actions(readings):
    agent = controller("vehicle=rexrov")
    agent.reset(np.array([0]))
    simulator = FossenSimulator(agent.vehicle, 1, max_step=0.1)
    agent._follow_lags(0, True, np.zeros(8))
    for step in range(3):
        command = np.full(8, 0.2 * (step + 1))
        simulator.step(command[None], 0.1)
        agent._follow_lags(0, False, command)
    np.testing.assert_array_equal(agent.actuators, simulator.actuators)


def test_on_a_map_it_aims_at_the_point_of_the_way():
    config = configs.training(*FEW, "task=transit_map", "vehicle=bluerov2_2026")
    agent = MPPIController(config, sheet.load(config.vehicle))
    agent.reset(np.array([0]))
    agent.observer.state[0, :3] = 10.0, 20.0, 30.0
    agent.observer.state[0, 3:7] = np.cos(np.pi / 4), 0.0, 0.0, np.sin(np.pi / 4)  # to the north
    spec = observation_spec(config.task, agent.vehicle.actuators)
    reading = np.zeros(spec.size)
    reading[spec["way"]] = 1.0, 0.5, 0.2
    aims = agent._aims(0, reading).view(AIM)[:, 0]
    np.testing.assert_allclose(aims["position"], np.tile([9.5, 21.0, 30.2], (NODES, 1)), atol=1e-12)


def test_depth_limits_are_those_of_the_task(readings):
    agent = controller()
    flown(agent, readings[:1], [0])
    z = agent.observer.state[0, 2]
    np.testing.assert_allclose(agent.depth[0] - z, [-60.0 + 20.0 + 0.7, -1.0 + 20.0 - 0.7])


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("vehicle=lrauv", "rudder"),
        ("algo.samples=8", "algo.samples=8"),
        ("algo.samples=100000", "65536"),
        ("algo.temperature=0", "algo.temperature"),
    ],
)
def test_what_it_cannot_do_is_refused_in_one_line(override, words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["train", "algo=mppi", override]) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1
