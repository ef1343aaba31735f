"""The time of an action is what the processor worked for it, not what went by on the wall."""

from __future__ import annotations

import time

import numpy as np
import pytest

from auvbench import cli
from auvbench.config.compose import compose
from auvbench.config.validate import train_config
from auvbench.errors import AuvbenchWarning
from auvbench.evaluation import evaluate, rollout
from auvbench.evaluation.evaluate import read_summary
from tests.unit.runs.test_damage import frozen


class Slow:
    """Stays where it is, after `seconds` of waiting or of computing."""

    def __init__(self, seconds: float, computes: bool) -> None:
        self.seconds, self.computes = seconds, computes

    def reset(self, episodes: np.ndarray) -> None:
        pass

    def act(self, observation: np.ndarray) -> np.ndarray:
        if not self.computes:
            time.sleep(self.seconds)
        else:
            until = time.process_time() + self.seconds
            while time.process_time() < until:
                pass
        return np.zeros((1, 6))


@pytest.mark.slow
@pytest.mark.parametrize("computes", [False, True])
def test_what_an_action_waits_for_does_not_count(computes, monkeypatch):
    monkeypatch.setattr(rollout, "ACTIONS", 30)
    found = rollout.time_actions(Slow(0.02, computes), train_config(compose("train", ["algo=pid"])))
    assert found["clock"] == "processor"
    if computes:
        assert found["median_ms"] >= 20.0
    else:
        assert found["median_ms"] < 5.0


@pytest.mark.slow
def test_an_action_longer_than_the_limit_is_timed(monkeypatch):
    monkeypatch.setattr(rollout, "SECONDS", 0.05)
    found = rollout.time_actions(Slow(0.1, computes=True), train_config(compose("train", ["algo=pid"])))
    assert found["actions"] == 1
    assert found["median_ms"] >= 100.0


@pytest.mark.slow
def test_a_failed_measurement_is_null_and_keeps_the_rows(tmp_path, monkeypatch, capsys):
    def fail(*_):
        raise IndexError("no time")

    monkeypatch.setattr(evaluate, "time_actions", fail)
    runs = [frozen(tmp_path, "algo=pid", f"seed={seed}") for seed in range(2)]
    with pytest.warns(AuvbenchWarning, match="no time"):
        assert cli.main(["evaluate", str(tmp_path), "protocol.episodes=2", "--workers", "1"]) == 0
    for run in runs:
        assert read_summary(run, "test")["inference"] is None
        assert len((run.evaluation("test") / "episodes.csv").read_text().splitlines()) == 3
    capsys.readouterr()
    assert cli.main(["report", str(tmp_path), "--columns", "action_ms"]) == 0
    assert "nan" not in capsys.readouterr().out


@pytest.mark.slow
def test_the_rows_are_there_before_the_measurement(tmp_path, monkeypatch):
    run = frozen(tmp_path, "algo=pid")
    there = []
    monkeypatch.setattr(evaluate, "time_actions", lambda *_: there.append(is_there(run)))
    assert cli.main(["evaluate", str(run.path), "protocol.episodes=2", "--workers", "1"]) == 0
    assert there == [True]


def is_there(run):
    return read_summary(run, "test") is not None and (run.evaluation("test") / "episodes.csv").is_file()
