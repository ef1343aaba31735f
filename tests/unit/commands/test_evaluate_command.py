"""`auvbench evaluate` on a folder in which some runs are not complete."""

from __future__ import annotations

import json
import signal
from pathlib import Path
from typing import Any

import pytest

from auvbench import cli
from auvbench.agents.classical.random import RandomAgent
from tests import fake_training
from tests.unit.runs.test_damage import frozen

FEW = "protocol.episodes=2"


@pytest.fixture
def outputs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Path:
    monkeypatch.chdir(tmp_path)
    for vehicle in ("bluerov2", "rexrov"):
        assert cli.main(["train", "algo=pid", f"vehicle={vehicle}", "train.progress=false"]) == 0
    for number in range(54):
        fake_training.make(tmp_path / "outputs" / "default" / f"ppo-{number}")
    fake_training.make(tmp_path / "outputs" / "default" / "sac").update_manifest(state="failed")
    capsys.readouterr()
    return tmp_path / "outputs"


@pytest.mark.slow
def test_what_can_be_evaluated_is_and_the_rest_is_one_line(
    outputs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["evaluate", "outputs", FEW, "--workers", "1"]) == 0
    captured = capsys.readouterr()
    assert len([line for line in captured.out.splitlines() if "success" in line]) == 2
    # A first use of the machine compiles, and says so.
    told = [line for line in captured.err.splitlines() if "auvbench: compiling" not in line]
    assert told == [
        "auvbench: 55 runs are incomplete and left out (54 pending, 1 failed); "
        "finish with auvbench resume outputs/default"
    ]
    assert len(list(outputs.glob("*/*/evaluations/test/summary.json"))) == 2
    assert cli.main(["evaluate", "outputs", FEW]) == 0
    out = capsys.readouterr().out
    assert out.splitlines()[0].startswith("2 runs are already tested by protocol test")
    assert cli.main(["report", "outputs", "--no-figures"]) == 0, "the two in one line, as the help says"


@pytest.mark.slow
def test_where_nothing_is_complete_it_says_what_finishes(
    outputs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["evaluate", "outputs/default/ppo-3"]) == 2
    err = capsys.readouterr().err
    assert "nothing to evaluate: 1 run is incomplete" in err
    assert "finish with auvbench resume outputs/default/ppo-3" in err


@pytest.mark.slow
def test_where_chooses_runs(outputs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["evaluate", "outputs", FEW, "--where", "vehicle=rexrov"]) == 0
    (summary,) = outputs.glob("*/*/evaluations/test/summary.json")
    assert "rexrov" in json.loads(summary.read_text())["run"]
    assert cli.main(["evaluate", "outputs", "--where", "vehicle=rexrv"]) == 2
    assert "did you mean 'rexrov'?" in capsys.readouterr().err


def test_the_configuration_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["evaluate", "protocol=thesis", "--cfg", "job"]) == 0
    assert "episodes: 200" in capsys.readouterr().out
    assert cli.main(["evaluate", "--cfg", "hydra"]) == 2


@pytest.mark.slow
@pytest.mark.parametrize("swallows", [True, False])
def test_an_agent_that_swallows_an_interruption_does_not_hide_it(
    swallows: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """CasADi makes a NotImplementedError of an exception that a signal raises within a conversion."""
    act = RandomAgent.act

    def interrupted(self: RandomAgent, observation: Any) -> Any:
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            if not swallows:
                raise NotImplementedError from None
        return act(self, observation)

    monkeypatch.setattr(RandomAgent, "act", interrupted)
    for seed in range(2):
        frozen(tmp_path, "algo=random", f"seed={seed}", "task.max_steps=5")
    assert cli.main(["evaluate", str(tmp_path), FEW, "--workers", "1"]) == 128 + signal.SIGINT
    assert "2 runs are tested and saved" in capsys.readouterr().err
    assert len(list(tmp_path.glob("*/*/evaluations/test"))) == int(swallows)
