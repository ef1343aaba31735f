"""Model-based learning: what the ensemble learns, where predicted plans lead, what they earn, and what is refused."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from auvbench import cli
from auvbench.agents.learned.ensemble import Ensemble, fit
from auvbench.agents.learned.imagined import MOTION, Prediction, Returns, followed, moved
from auvbench.agents.learned.pets import PETSLearner, Plans, Transitions
from auvbench.envs.batch import Batch
from auvbench.evaluation.rollout import roll_out
from auvbench.tasks import rewards
from auvbench.tasks.observation_spec import observation_spec
from auvbench.vehicles import sheet
from tests import configs

DEFAULT = ("algo=pets", "vehicle=bluerov2_2026", "task=waypoint_state")
STATION = ("algo=pets", "vehicle=bluerov2_2026", "task=station_keeping")


def flight(
    *overrides: str, steps: int = 40
) -> tuple[Any, Any, list[np.ndarray], list[np.ndarray], list[float]]:
    """Return configuration, observation spec, observations (n_obs,), actions and rewards of a flight without noise."""
    config = configs.training(*overrides, "noise=none")
    batch = Batch(config, 1, seed=4, validation=True, autoreset=False)
    spec = observation_spec(config.task, batch.vehicle.actuators)
    rng, action = np.random.default_rng(0), np.zeros((1, len(batch.vehicle.actuators)))
    observations, actions, rewards = [batch.reset()[0].copy()], [], []
    for _ in range(steps):
        action = np.clip(0.8 * action + rng.normal(0.0, 0.4, action.shape), -1.0, 1.0)
        result = batch.step(action)
        observations.append(result.observation[0].copy())
        actions.append(action[0].astype(np.float32))
        rewards.append(float(result.reward[0]))
    return config, spec, observations, actions, rewards


def motions(spec: Any, observations: list[np.ndarray]) -> torch.Tensor:
    columns = np.concatenate([np.arange(spec.size)[spec[block]] for block in MOTION])
    return torch.from_numpy(np.array(observations)[:, columns])


def test_motions_lead_where_the_vehicle_went() -> None:
    """A station does not move: the change of the error, in the level axes of the start, is the displacement."""
    _, spec, observations, _, _ = flight(*STATION)
    displacement, turn = moved(motions(spec, observations), 0.1)
    yaw = spec["yaw_error"].start
    went = -np.unwrap([row[yaw] for row in observations]) + observations[0][yaw]
    np.testing.assert_allclose(turn.numpy(), went[1:], atol=0.02)
    aim = torch.from_numpy(np.append(observations[0][spec["position_error"]], observations[0][yaw]))
    for k in range(40):
        aim = followed(aim, motions(spec, observations[k : k + 2]), 0.1)
    reading = observations[40]
    np.testing.assert_allclose(aim, [*reading[spec["position_error"]], reading[yaw]], atol=0.05)
    for k in (9, 39):
        x, y, z = observations[k + 1][spec["position_error"]]
        c, s = np.cos(went[k + 1]), np.sin(went[k + 1])
        error = np.array([c * x - s * y, s * x + c * y, z])
        expected = observations[0][spec["position_error"]] - error
        np.testing.assert_allclose(displacement[k].numpy(), expected, atol=0.03)
    moves = np.linalg.norm(expected), abs(went[-1])
    assert min(moves) > 0.3, "the flight must go somewhere"


@pytest.mark.parametrize("overrides", [DEFAULT, STATION])
def test_a_predicted_step_earns_the_task_s_reward(overrides: tuple[str, ...]) -> None:
    config, spec, observations, actions, rewards = flight(
        *overrides, "algo.gamma=1", "algo.terminal_weight=1", steps=30
    )
    returns = Returns(config)
    states, previous = motions(spec, observations), spec["previous_action"]
    earned = []
    for k, action in enumerate(actions):
        reading, pair = torch.from_numpy(observations[k]), states[k : k + 2, None, None]
        aim = torch.cat([reading[spec["position_error"]], reading[spec["yaw_error"]]])
        earned.append(float(returns(aim, reading[previous], torch.from_numpy(action)[None, None], pair)))
    np.testing.assert_allclose(earned, rewards, atol=0.01)
    assert np.ptp(rewards) > 0.05, "the rewards must differ"


@pytest.mark.parametrize("name", ["goal", "exponential"])
def test_other_rewards_are_the_task_s_formulas(name: str) -> None:
    """The formulas of `tasks.rewards`, as plain functions."""
    config = configs.training(*DEFAULT, f"reward={name}")
    rng = np.random.default_rng(3)
    for _ in range(5):
        to_go, yaw_error = rng.uniform(3.1, 6.0), rng.uniform(-3.0, 3.0)
        action, previous = rng.uniform(-1.0, 1.0, (2, 6))
        e = SimpleNamespace(outcome=-1, to_go=to_go, yaw_error=yaw_error)
        v = SimpleNamespace(action=action, previous=previous)
        expected = getattr(rewards, name)(e, v, config.reward)
        distance, off, ones = torch.tensor([[[to_go]]]), torch.tensor([[[yaw_error]]]), torch.ones(1, 1, 1)
        effort, change = np.square(action).mean() * ones, np.square(action - previous).mean() * ones
        found = Returns(config)._steps(distance, distance, off, effort, change)
        assert float(found) == pytest.approx(expected, abs=1e-5)


def test_the_end_of_an_episode_ends_the_return() -> None:
    """A plan that reaches the waypoint earns the reward of success once, and nothing afterwards."""
    returns = Returns(configs.training(*DEFAULT, "algo.gamma=0.9"))
    states = torch.zeros(11, 1, 1, 9)
    states[..., 8] = -1.0
    states[..., 0] = 2.5  # m/s ahead: within 3 m after the third step
    aim = torch.tensor([3.5, 0.0, 0.0, 0.0])
    earned = float(returns(aim, torch.zeros(6), torch.zeros(10, 1, 6), states))
    approach = [np.exp(-(3.5 - 0.25 * k) / 20.0) for k in (1, 2)]
    assert earned == pytest.approx(approach[0] + 0.9 * approach[1] + 0.81 * 500.0, rel=1e-5)


def test_readings_are_averaged_over_time() -> None:
    config = configs.training(*DEFAULT, "algo.members=1", "algo.net_arch=[4]")
    agent = PETSLearner(config, sheet.load(config.vehicle))
    spec = observation_spec(config.task, sheet.load(config.vehicle).actuators)
    plans, rng = Plans(np.array([0]), 0, 5, 6), np.random.default_rng(1)
    true, errors = np.array([4.0, -2.0, 1.0]), []
    for step in range(60):
        plans.steps[0] = step
        reading = spec.pack(
            position_error=true + 0.2 * rng.choice([-1.0, 1.0], 3), yaw_error=0.0, velocity=[0.0] * 3,
            angular_velocity=[0.0] * 3, gravity=[0.0, 0.0, -1.0], previous_action=[0.0] * 6,
        )  # fmt: skip
        agent._estimate(reading, plans, 0)
        errors.append(np.abs(plans.aims[0, :3] - true).mean())
    assert errors[0] == pytest.approx(0.2, rel=1e-4)
    assert np.mean(errors[10:]) < 0.07, "the last ten readings leave a quarter of the error"


def test_an_ensemble_learns_mean_and_spread_and_knows_them_in_rollouts() -> None:
    rng, torch_threads = np.random.default_rng(1), torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        rows = rng.normal(0.0, [2.0] * 9 + [1.0] * 4, (2000, 13)).astype(np.float32)
        change = 0.3 * rows[:, :9] @ rng.normal(size=(9, 9)).astype(np.float32) / 3.0 + rows[:, 11:12]
        noise = 0.05 * rng.normal(size=change.shape).astype(np.float32)
        ensemble = Ensemble(3, 13, 9, [32], seed=2)
        optimizer = torch.optim.AdamW(ensemble.parameters(), lr=3e-3)
        for _ in range(2):
            fit(ensemble, optimizer, rows, change + noise, steps=600, batch=64, generator=rng)
        motion, actions = torch.from_numpy(rows[0, :9]), torch.from_numpy(rows[:1, None, 11:])
        still = Prediction(ensemble).roll_out(
            motion, torch.from_numpy(rows[0, 9:11]), actions, torch.zeros(1, 3, 1, 9)
        )
        np.testing.assert_allclose(still[1].mean(dim=(0, 1)), rows[0, :9] + change[0], atol=0.15)
        drawn = Prediction(ensemble).roll_out(
            motion, torch.from_numpy(rows[0, 9:11]), actions, torch.ones(1, 3, 1, 9)
        )
        spread = (drawn - still)[1].mean()
        assert 0.03 < spread < 0.15, f"noise of 0.05 gave a deviation of {spread}"
    finally:
        torch.set_num_threads(torch_threads)


def test_the_memory_has_the_last_observation_of_an_episode() -> None:
    config = configs.training(*DEFAULT, "task.max_steps=3", "task.time_limit=null")
    batch = Batch(config, 2, seed=1)
    memory, before = Transitions(4, 2, batch.task.observation.shape[1], 6), batch.reset().copy()
    for k in range(5):
        result = batch.step(np.full((2, 6), 0.1))
        memory.add(before, batch.acted.astype(np.float32), result)
        if k == 2:
            np.testing.assert_array_equal(memory.next_observations[2], result.final_observation)
            assert (memory.next_observations[2] != result.observation).any()
            assert memory.dones[2].all()
            assert memory.timeouts[2].all()
        before = result.observation.copy()
    assert memory.full
    assert memory.pos == 1
    assert [len(part) for part in memory.all()] == [8, 8, 8]


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        (
            ("task=docking",),
            "task=docking: algo=pets cannot compute its reward from the observation; use waypoint",
        ),
        (("task=waypoint",), "task.position_frame=world: algo=pets needs body"),
        (("task.observation=[position_error,yaw_error,previous_action]",), "does not observe velocity"),
        (("task=station_keeping", "reward=marinegym_hover"), "reward.name=marinegym_hover: algo=pets cannot"),
        (("algo.net_arch=[]",), "algo.net_arch"),
        (("algo.buffer_size=100",), "algo.buffer_size"),
        (("algo.members=0",), "algo.members"),
    ],
)
def test_what_cannot_be_planned_is_refused_in_one_line(
    overrides: tuple[str, ...], said: str, tmp_path: Any, monkeypatch: Any, capsys: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.main(["train", "algo=pets", "train.total_steps=100", *overrides]) == 2
    lines = [line for line in capsys.readouterr().err.splitlines() if not line.startswith("note:")]
    assert len(lines) == 1
    assert said in lines[0]
    assert not (tmp_path / "outputs").exists()


@pytest.mark.slow
def test_a_thousand_steps_suffice_for_waypoints() -> None:
    config = configs.training(*DEFAULT, "seed=5")
    batch = Batch(config, 1)
    agent = PETSLearner(config, sheet.load(config.vehicle))

    class Session:
        total_steps = 1000

        def __getattr__(self, name: str) -> Any:
            return lambda *arguments: 0

    agent.learn(batch, config, Session())
    records = roll_out(
        config, agent, episodes=np.arange(10), seed=6, batch=10, scenarios="validation"
    ).records
    assert sum(record["outcome"] == "success" for record in records) >= 9
