"""The time of an action is what the processor worked for it, not what went by on the wall."""

from __future__ import annotations

import time

import numpy as np
import pytest

from auvbench.config.compose import compose
from auvbench.config.validate import train_config
from auvbench.evaluation import inference


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


@pytest.mark.parametrize("computes", [False, True])
def test_what_an_action_waits_for_does_not_count(computes, monkeypatch):
    monkeypatch.setattr(inference, "ACTIONS", 30)
    found = inference.measure(Slow(0.02, computes), train_config(compose("train", ["algo=pid"])))
    assert found["clock"] == "processor"
    if computes:
        assert found["median_ms"] >= 20.0
    else:
        assert found["median_ms"] < 5.0
