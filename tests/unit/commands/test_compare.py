"""`auvbench compare`: two agents side by side, with the report's statistics."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from auvbench import cli
from auvbench.analysis import side_by_side
from auvbench.analysis.records import Agent
from auvbench.errors import ReportError
from tests import synthetic


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    synthetic.write_experiment(tmp_path / "outputs" / "made", seeds=(0, 1, 2), episodes=40)
    return tmp_path / "outputs" / "made"


def found(folder: Path, name: str) -> Agent:
    return side_by_side.find_agent(name, folder, "test", None)


def energy(folder: Path, algorithm: str) -> float:
    """Return the energy of the typical training."""
    files = folder.glob(f"{algorithm}-*/evaluations/test/episodes.csv")
    return float(np.median([pd.read_csv(file)["energy_J"].mean() for file in files]))


def test_a_difference_is_that_of_the_files_and_turns_with_the_order(folder: Path) -> None:
    pair = [found(folder, "pid"), found(folder, "PPO")]
    forth = {one.measure.name: one for one in side_by_side.differences(pair, 0.95)}
    back = {one.measure.name: one for one in side_by_side.differences(pair[::-1], 0.95)}
    one, other = forth["mean_energy_J"], back["mean_energy_J"]
    assert one.difference.value == pytest.approx(energy(folder, "ppo") - energy(folder, "pid"))
    assert other.difference.value == pytest.approx(-one.difference.value)
    assert (other.difference.low, other.difference.high) == pytest.approx(
        (-one.difference.high, -one.difference.low), nan_ok=True
    )
    assert one.better + other.better == 1 or {one.better, other.better} == {-1}
    assert "par1_time_s" in forth
    assert "mean_steps" not in {d.measure.name for d in side_by_side.differences(pair, 0.95, every=True)}


def test_an_agent_is_not_better_than_itself(folder: Path) -> None:
    agent = found(folder, "SAC")
    for one in side_by_side.differences([agent, agent], 0.95):
        assert one.difference.value == 0
        assert one.better == -1


def test_runs_that_differ_in_the_seed_alone_are_told_apart_by_their_paths(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first, second = sorted(path.name for path in folder.glob("ppo-*"))[:2]
    names = [str(folder / first), str(folder / second)]
    pair = side_by_side.with_distinct_labels([found(folder, name) for name in names], names)
    assert [agent.label for agent in pair] == [f"PPO ({first})", f"PPO ({second})"]
    assert side_by_side.settings(pair) == []
    assert cli.main(["compare", *names, "--out", str(folder / "compare")]) == 0
    assert re.search(r"wrote .*training_success\.png", capsys.readouterr().out)


def test_the_keys_that_differ(folder: Path) -> None:
    assert ("algo", "pid", "ppo") in side_by_side.settings([found(folder, "pid"), found(folder, "PPO")])


def test_agents_that_met_other_scenarios_have_no_difference(folder: Path) -> None:
    synthetic.write_experiment(folder.parent / "other", algorithms=("pid",), vehicle="rexrov", episodes=40)
    pair = [found(folder, "pid"), found(folder, str(folder.parent / "other"))]
    with pytest.raises(ReportError, match="met different scenarios"):
        side_by_side.differences(pair, 0.95)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["pid", "pdi", "--in", "outputs/made"], "did you mean 'PID'"),
        (["outputs/made", "pid"], "name two of them"),
        (["pid", "ppo", "--in", "output"], "did you mean outputs"),
        (["outputs/made/pid-*", "ppo", "--in", "output"], "pid-*: is not a run or folder"),
        (["pid", "ppo", "--confidence", "2"], "from 0.5 to 0.999"),
        (["pid"], "SECOND"),
        (["pid", "pid", "--in", "outputs/made"], "the same runs"),
    ],
)
def test_a_mistake_names_what_is_right(
    folder: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], words: str
) -> None:
    assert cli.main(["compare", *arguments]) == 2
    assert words in capsys.readouterr().err


def test_the_labels_that_are_listed_are_taken(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    synthetic.write_experiment(folder, algorithms=("ppo",), reward_k=(1.0, 40.0), seeds=(0, 1), episodes=40)
    assert cli.main(["compare", "PPO K=1", "PPO K=4", "--in", str(folder)]) == 2
    assert "did you mean 'PPO K=40'" in capsys.readouterr().err
    assert cli.main(["compare", "PPO K=1", "PPO K=40", "--in", str(folder)]) == 0
    assert cli.main(["compare", "algo=ppo", "pid", "--in", str(folder)]) == 2
    assert "--where algo=ppo" in capsys.readouterr().err


def test_more_episodes_narrow_the_interval(tmp_path: Path) -> None:
    widths = []
    for episodes in (20, 320):
        folder = tmp_path / str(episodes)
        synthetic.write_experiment(folder, algorithms=("pid", "random"), episodes=episodes)
        pair = [found(folder, "pid"), found(folder, "random")]
        (one,) = (d for d in side_by_side.differences(pair, 0.95) if d.measure.name == "mean_energy_J")
        widths.append(one.difference.high - one.difference.low)
    assert np.divide(*widths) > 2
