"""examples/privileged_critic.py: the critic sees more than the policy, and auvbench tests the file that it writes."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from auvbench.cli import main
from auvbench.envs import sb3
from auvbench.policies import exported
from tests.waiting import LIMIT

pytestmark = pytest.mark.slow
EXAMPLE = Path(__file__).parents[2] / "examples" / "privileged_critic.py"


def test_the_critic_sees_the_drawn_vehicle_and_the_policy_does_not() -> None:
    spec = importlib.util.spec_from_file_location("privileged_critic", EXAMPLE)
    assert spec is not None
    assert spec.loader is not None
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    environment = example.Privileged(sb3.make(4, seed=3, overrides=example.TASK))
    first = environment.reset()
    factors = first[:, -example.PRIVILEGED :]
    assert len(np.unique(factors, axis=0)) == 4
    # Within an episode vehicle and current stay as they were drawn.
    np.testing.assert_array_equal(environment.step(np.zeros((4, 6)))[0][:, -example.PRIVILEGED :], factors)

    policy = example.AsymmetricPolicy(
        environment.observation_space,
        environment.action_space,
        lambda _: 1e-3,
        share_features_extractor=False,
    )
    other = first.copy()
    other[:, -example.PRIVILEGED :] += 1.0
    seen, changed = torch.from_numpy(first), torch.from_numpy(other)
    with torch.no_grad():
        assert torch.equal(policy._predict(seen, True), policy._predict(changed, True))
        assert not torch.allclose(policy.predict_values(seen), policy.predict_values(changed))


def test_its_file_is_tested_like_any_agent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("onnxruntime")
    monkeypatch.chdir(tmp_path)
    subprocess.run([sys.executable, EXAMPLE, "mine.onnx", "--steps", "4096"], check=True, timeout=LIMIT)
    assert exported.load("mine.onnx").n_observations == 19
    typed = ("algo=onnx", "algo.path=mine.onnx", "vehicle=bluerov2_realistic_inertia", "task=waypoint_state")
    assert main(["train", *typed]) == 0
    assert main(["evaluate", "outputs", "protocol.episodes=4"]) == 0
