"""Findings about robustness: which condition costs most, which costs nothing that is seen, who bears it best."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from auvbench.analysis import robustness as module
from auvbench.analysis.load import agents, load
from auvbench.analysis.model import Agent, Finding, Ranking
from auvbench.analysis.ranking import rank
from auvbench.analysis.robustness import robustness
from tests.synthetic import TRANSFER, write_experiment

CONDITIONS = ("nominal", "current=0.25", "current=1", "drag=0.7", "dead-thruster")


def found(folder: Path, protocol: str = "robustness") -> tuple[Ranking, list[Agent], list[Finding]]:
    runs, _ = load([folder], protocol)
    grouped, _ = agents(runs, protocol=protocol)
    ranking = rank(grouped, protocol=protocol)
    return ranking, grouped, robustness(ranking, grouped)


@pytest.fixture(scope="module")
def grid(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "grid"
    write_experiment(
        folder,
        algorithms=("ppo", "sac", "pid", "random"),
        seeds=(0, 1, 2),
        episodes=80,
        protocols={"robustness": CONDITIONS, "test": ("nominal",)},
        train_episodes=20,
    )
    return folder


def test_the_costliest_condition_and_what_it_costs(grid: Path) -> None:
    _, grouped, findings = found(grid)
    first = findings[0]
    assert first.text.startswith("Of 4 conditions, current 1 m/s costs most success: -")
    assert "averaged over 3 agents" in first.text  # random has nothing to lose
    losses = []
    for agent in grouped:
        if agent.label != "random":
            for_agent = []
            for run in agent.runs:
                frame = pd.read_csv(run.directory / "evaluations" / "robustness" / "episodes.csv")
                rate = (frame["outcome"] == "success").groupby(frame["condition"]).mean()
                for_agent.append(rate["current=1"] - rate["nominal"])
            losses.append(sum(for_agent) / len(for_agent))
    value = float(first.text.partition("success: ")[2].partition(" points")[0])
    assert value == pytest.approx(100 * sum(losses) / len(losses), abs=0.6)
    assert "4 conditions together" in first.statistic


def test_conditions_without_a_resolved_loss_are_named_with_what_they_may_cost(grid: Path) -> None:
    texts = [finding.text for finding in found(grid)[2]]
    (harmless,) = (text for text in texts if text.startswith("No loss is resolved under"))
    assert "drag × 0.7" in harmless
    assert "current 1 m/s" not in harmless
    assert "points at most" in harmless


def test_who_is_best_under_the_costliest_condition_is_said(grid: Path) -> None:
    ranking, grouped, findings = found(grid)
    by_label = {a.label: {c.name: c.success[a.label].value for c in ranking.conditions} for a in grouped}
    best = max(by_label, key=lambda label: by_label[label]["current=1"])
    assert best in findings[-1].text
    assert f"{100 * by_label[best]['current=1']:.1f} %" in findings[-1].text


def of(share: float, seeds: int = 1) -> np.ndarray:
    """(seeds, 40) with so many successes, the first ones."""
    return np.tile(np.arange(40) < round(40 * share), (seeds, 1)).astype(float)


@pytest.mark.parametrize(
    ("shares", "said"),
    [
        (
            {"PID": (1.0, 0.5), "PPO": (1.0, 1.0), "SAC": (1.0, 1.0)},
            "PPO and SAC have the most success both undisturbed and under current 1 m/s (100.0 %); "
            "with as much undisturbed, PID has 50.0 %.",
        ),
        (
            {"PID": (1.0, 0.5), "PPO": (0.9, 0.4), "SAC": (0.9, 0.4)},
            "PID has the most success both undisturbed and under current 1 m/s (50.0 %).",
        ),
        (
            {"PID": (1.0, 0.5), "PPO": (1.0, 0.6), "SAC": (0.9, 0.8)},
            "Undisturbed PID and PPO have the most success, under current 1 m/s SAC: 80.0 % against 60.0 % of PPO (+20 points",
        ),
        (
            {"PID": (1.0, 0.5), "PPO": (0.9, 0.6), "SAC": (0.9, 0.8)},
            "Undisturbed PID has the most success, under current 1 m/s SAC: 80.0 % against 50.0 % (+30 points",
        ),
    ],
)
def test_agents_that_share_the_most_success_are_all_named(grid: Path, monkeypatch, shares, said) -> None:
    ranking, grouped, _ = found(grid)
    rates = {
        label: {"nominal": of(calm, seeds := 1 if label == "PID" else 3), "current=1": of(there, seeds)}
        for label, (calm, there) in shares.items()
    }
    by_name = {agent.label.partition(" ")[0]: agent.label for agent in grouped}
    known = {by_name[name]: found for name, found in rates.items()}
    monkeypatch.setattr(module, "rates_by_condition", lambda agent, _: known.get(agent.label, {}))
    text = robustness(ranking, grouped)[-1].text
    for name, label in by_name.items():
        text = text.replace(label, name)
    assert text.startswith(said)


def test_a_protocol_with_one_condition_has_nothing_to_say(grid: Path) -> None:
    assert found(grid, "test")[2] == []


def test_transfer_is_told_alike(tmp_path: Path) -> None:
    write_experiment(tmp_path, algorithms=("pid",), episodes=60, protocols={"transfer": TRANSFER})
    findings = found(tmp_path, "transfer")[2]
    assert "vehicle bluerov2-wu2018 costs most success" in findings[0].text
    assert "for PID" in findings[0].text
