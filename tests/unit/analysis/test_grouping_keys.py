"""Runs that were trained differently are never seeds of one agent."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from auvbench.analysis.labels import labels, usual, usual_sentence
from auvbench.analysis.load import agents, load
from auvbench.analysis.records import Agent, Problem
from auvbench.runs.identity import LATER
from tests.synthetic import reconfigure, write_experiment

Config = dict[str, Any]


def made(
    folder: Path, change: Callable[[Config, int], None], **grid: Any
) -> tuple[list[Agent], list[Problem]]:
    """Agents of a grid whose configurations were changed: `change` is handed each with its place in the grid."""
    for place, run in enumerate(write_experiment(folder / "grid", episodes=12, train_episodes=20, **grid)):
        config = yaml.safe_load((run / "config.yaml").read_text())
        change(config, place)
        (run / "config.yaml").write_text(yaml.safe_dump(config))
        reconfigure(run)
    runs, _ = load([folder])
    return agents(runs)


def seeds(found: list[Agent]) -> dict[str, list[int]]:
    return {agent.label: [run.seed for run in agent.runs] for agent in found}


def test_a_disturbance_that_varied_is_part_of_the_agent(tmp_path: Path) -> None:
    def disturb(config: Config, place: int) -> None:
        if place % 4 > 1:
            config["disturbance"] |= {"name": "moderate", "current": 0.3, "delay": 0.1}

    found, problems = made(tmp_path, disturb, algorithms=("ppo",), seeds=(0, 1, 2, 3))
    assert seeds(found) == {
        "PPO, trained with disturbance=moderate": [2, 3],
        "PPO, trained with disturbance=none": [0, 1],
    }
    assert found[0].key["disturbance"] == "moderate"
    assert problems == []


def test_budgets_are_not_pooled(tmp_path: Path) -> None:
    def budget(config: Config, place: int) -> None:
        config["train"]["total_steps"] = (300_000, 1_000_000)[place % 2]

    found, _ = made(tmp_path, budget, algorithms=("ppo", "sac"), seeds=(0, 1))
    assert seeds(found) == {
        "PPO 300k steps": [0],
        "PPO 1M steps": [1],
        "SAC 300k steps": [0],
        "SAC 1M steps": [1],
    }


def test_one_run_with_another_hyperparameter_stands_apart(tmp_path: Path) -> None:
    def discount(config: Config, place: int) -> None:
        config["launcher"]["workers"] = place  # changes nothing of what was learned
        if place == 1:
            config["algo"]["gamma"] = 0.9

    found, problems = made(tmp_path, discount, algorithms=("ppo", "pid"), seeds=(0, 1))
    assert seeds(found) == {"PID": [0], "PPO gamma=0.9": [1], "PPO gamma=0.99": [0]}
    assert problems == []


@pytest.mark.parametrize("key", ["noise", "disturbance"])
def test_what_only_training_meets_does_not_part_controllers(tmp_path: Path, key: str) -> None:
    def vary(config: Config, place: int) -> None:
        config[key]["name"] = ("one", "other")[place % 2]
        config["train"]["total_steps"] = 1000 * place

    found, _ = made(tmp_path, vary, algorithms=("pid", "random"), seeds=(0,))
    assert seeds(found) == {"PID": [0], "random": [0]}


def test_a_key_that_only_some_runs_have_parts_them(tmp_path: Path) -> None:
    def clip(config: Config, place: int) -> None:
        if place:
            config["algo"]["clip_range"] = 0.1

    found, _ = made(tmp_path, clip, algorithms=("ppo",), seeds=(0, 1))
    assert seeds(found) == {"PPO clip_range=0.1": [1], "PPO, no clip_range": [0]}


def test_what_three_of_four_learners_share_stands_below_the_table_once() -> None:
    keys = [{"algo": "ppo", "task.history": n, "disturbance": "moderate"} for n in (1, 1, 1, 4)]
    keys.append({"algo": "sac", "task.history": 1, "disturbance": "none"})
    keys.append({"algo": "pid", "task.history": None, "disturbance": None})
    for place, clip in enumerate((0.1, 0.2, 0.3, 0.1)):
        keys[place]["algo.clip_range"] = clip
    for key in keys[4:]:
        key["algo.clip_range"] = None
    learners = [True] * 5 + [False]
    trained = "trained with disturbance="
    assert labels(keys, learners) == [
        "PPO clip_range=0.1",
        "PPO clip_range=0.2",
        "PPO clip_range=0.3",
        "PPO history=4 clip_range=0.1",
        f"SAC, {trained}none",
        "PID",
    ]
    assert usual(keys, learners) == {"task.history": 1, "disturbance": "moderate"}
    assert usual_sentence(keys, learners) == [
        "Learners whose names do not say otherwise: history=1, disturbance=moderate."
    ]
    assert usual_sentence(keys[:3], learners[:3]) == []


def test_what_another_choice_has_is_not_said_to_be_unset() -> None:
    """Of simulators one alone has two hydrodynamics."""
    keys = [
        {"algo": "ppo", "simulator": simulator, "simulator.hydrodynamics": hydrodynamics}
        for simulator, hydrodynamics in (("fossen", None), ("gazebo", "corrected"), ("gazebo", "published"))
    ]
    trained = "PPO, trained in gazebo with hydrodynamics"
    said = ["PPO, trained in fossen", f"{trained}=corrected", f"{trained}=published"]
    assert labels(keys, [True] * 3) == said
    keys[1]["simulator.hydrodynamics"] = None  # of the same choice, one without
    assert labels(keys, [True] * 3)[1] == "PPO, trained in gazebo with no hydrodynamics"


def test_what_the_test_fixes_is_what_an_agent_was_trained_with(tmp_path: Path) -> None:
    def change(config: Config, place: int) -> None:
        config["task"]["goal_radius"] = (3.0, 0.5)[place % 2]

    found, _ = made(tmp_path, change, algorithms=("ppo",), seeds=(0, 1), frequencies=(10, 25))
    assert {agent.label for agent in found} == {
        f"PPO, trained at {f} Hz with goal_radius={r}" for f in (10, 25) for r in (3, 0.5)
    }


def test_a_frequency_that_each_run_was_tested_at_is_no_training_s(tmp_path: Path) -> None:
    keys = [{"algo": "ppo", "step.frequency": f} for f in (10.0, 25.0)]
    assert labels(keys, [True] * 2, frequency_fixed=False) == ["PPO 10 Hz", "PPO 25 Hz"]
    assert labels(keys, [True] * 2) == ["PPO, trained at 10 Hz", "PPO, trained at 25 Hz"]


def test_runs_of_a_controller_that_the_test_makes_alike_are_one_row(tmp_path: Path) -> None:
    def change(config: Config, place: int) -> None:
        config["task"]["goal_radius"] = (3.0, 0.5)[place % 2]
        config["disturbance"] |= {"name": ("none", "severe")[place // 2], "delay": 0.1 * (place // 2)}

    # Four folders of one PID, which `change` makes four runs.
    folder = tmp_path / "grid"
    for place in range(4):
        for run in write_experiment(folder / str(place), algorithms=("pid",), episodes=12):
            config = yaml.safe_load((run / "config.yaml").read_text())
            change(config, place)
            (run / "config.yaml").write_text(yaml.safe_dump(config))
            reconfigure(run)
    runs, _ = load([folder])
    assert len(runs) == 4
    found, problems = agents(runs)
    assert [(agent.label, len(agent.runs)) for agent in found] == [("PID", 4)]
    assert problems == []


@pytest.mark.parametrize(
    ("name", "title"),
    [
        ("mpc_tuned", "MPC, tuned"),
        ("recurrent_ppo_tuned", "RecurrentPPO, tuned"),
        ("sac_residual_tuned", "SAC added to PID, tuned"),
        ("crossq", "CrossQ"),
        ("ppo2", "ppo2"),
        ("mine", "mine"),
    ],
)
def test_an_agent_has_its_registry_s_title(name: str, title: str) -> None:
    assert labels([{"algo": name}], [True]) == [title]


def test_seeds_of_a_version_without_a_later_key_are_of_one_agent(tmp_path: Path) -> None:
    def since(config: Config, place: int) -> None:
        config["disturbance"].pop("waves", None)
        if place != 0:  # the first seed is of an earlier version
            config["disturbance"]["waves"] = {**LATER["disturbance.waves"], "height": (0.0, 0.9)[place == 2]}

    found, _ = made(tmp_path, since, algorithms=("ppo",), seeds=(0, 1, 2))
    assert seeds(found) == {
        "PPO, trained with waves.height=0": [0, 1],
        "PPO, trained with waves.height=0.9": [2],
    }
