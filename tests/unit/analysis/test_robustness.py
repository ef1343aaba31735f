"""Findings about robustness: which condition costs most, which costs nothing that is seen, who bears it best."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from auvbench.analysis.findings import costliest_condition
from auvbench.analysis.load import agents, load
from auvbench.analysis.ranking import rank
from auvbench.analysis.records import Agent, Finding
from tests.synthetic import TRANSFER, write_experiment

CONDITIONS = ("nominal", "current=0.25", "current=1", "drag=0.7", "dead-thruster")


def found(folder: Path, protocol: str = "robustness") -> tuple[list[Agent], Finding | None]:
    runs, _ = load([folder], protocol)
    grouped, _ = agents(runs, protocol=protocol)
    return grouped, costliest_condition(rank(grouped, protocol=protocol), grouped)


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
    grouped, finding = found(grid)
    assert finding is not None
    assert finding.text.startswith("Of 4 conditions, current 1 m/s costs most success: -")
    assert len(finding.agents) == 3, "random has nothing to lose"
    losses = {}
    for agent in grouped:
        if agent.label != "random":
            of_agent = []
            for run in agent.runs:
                frame = pd.read_csv(run.directory / "evaluations" / "robustness" / "episodes.csv")
                rate = (frame["outcome"] == "success").groupby(frame["condition"]).mean()
                of_agent.append(rate["current=1"] - rate["nominal"])
            losses[agent.label] = sum(of_agent) / len(of_agent)
    assert finding.estimate is not None
    assert finding.estimate.value == pytest.approx(sum(losses.values()) / len(losses))
    assert f"({max(losses, key=lambda label: losses[label])}) to" in finding.text
    assert finding.text.endswith(f"({min(losses, key=lambda label: losses[label])}).")


def test_a_protocol_with_one_condition_has_nothing_to_say(grid: Path) -> None:
    assert found(grid, "test")[1] is None


def test_transfer_is_told_alike(tmp_path: Path) -> None:
    write_experiment(tmp_path, algorithms=("pid",), episodes=60, protocols={"transfer": TRANSFER})
    finding = found(tmp_path, "transfer")[1]
    assert finding is not None
    assert "vehicle bluerov2-wu2018 costs most success" in finding.text
    assert finding.agents == ("PID",)
