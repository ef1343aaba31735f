"""docs/policies-as-files.md: the file that its block writes acts as the Stable-Baselines3 policy does."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import onnxruntime
import pytest
import torch
from stable_baselines3 import SAC

from tests.docs_blocks import ROOT, steps

PAGE = ROOT / "docs" / "policies-as-files.md"


@pytest.mark.slow
def test_the_file_of_a_ppo_policy_acts_as_the_policy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (block,) = [text for kind, text in steps(PAGE) if kind == "python" and "stable_baselines3" in text]
    names: dict[str, Any] = {}
    exec(compile(block.replace("learn(1024)", "learn(128)"), PAGE.name, "exec"), names)
    model = names["model"]
    observation = np.stack([model.observation_space.sample() for _ in range(20)])
    # Beyond its bounds the action is clipped.
    observation[10:] = 100.0 * np.sign(observation[10:])
    (action,) = onnxruntime.InferenceSession("ppo.onnx").run(None, {"observation": observation})
    expected, _ = model.predict(observation, deterministic=True)
    np.testing.assert_allclose(action, expected, atol=1e-5)
    assert np.unique(expected, axis=0).shape[0] > 10


@pytest.mark.slow
def test_the_line_on_sac_gives_its_mean_action() -> None:
    import auvbench  # noqa: F401  registers the environments

    assert "`torch.tanh(actor.mu(actor.latent_pi(observation)))`" in PAGE.read_text(encoding="utf-8")
    model = SAC("MlpPolicy", gymnasium.make("auvbench/Waypoint-v1"), buffer_size=10, device="cpu")
    observation = np.stack([model.observation_space.sample() for _ in range(20)])
    actor = model.policy.actor
    with torch.no_grad():
        action = torch.tanh(actor.mu(actor.latent_pi(torch.as_tensor(observation))))
    np.testing.assert_allclose(action, model.predict(observation, deterministic=True)[0], atol=1e-6)
