"""A damaged model never steers a vehicle: each kind of damage is one line."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from omegaconf import OmegaConf
from stable_baselines3.common.policies import ActorCriticPolicy

from auvbench.agents.learned import trained_policy as forward
from auvbench.agents.learned.trained_policy import LearnedPolicy, _policy
from auvbench.config.compose import typed
from auvbench.errors import RunError
from auvbench.vehicles import sheet
from tests import configs

Weights = dict[str, Any]
Arrays = dict[str, Any]
CONFIG = typed(OmegaConf.create(configs.plain("algo=ppo")))
VEHICLE = sheet.load(CONFIG.vehicle)
N_U = len(VEHICLE.actuators)


def written(folder: Path, weights: Weights | None = None, arrays: Arrays | None = None) -> Path:
    sound = dict(_policy(CONFIG, VEHICLE).state_dict())
    torch.save(sound if weights is None else weights, folder / "policy.pt")
    np.savez(folder / "normalisation.npz", **(statistics() if arrays is None else arrays))
    return folder


def statistics() -> Arrays:
    return {
        "observation_mean": np.zeros(4 + N_U),
        "observation_variance": np.ones(4 + N_U),
        "observation_count": np.asarray(10.0),
        "epsilon": np.asarray(1e-8),
        "clip_observations": np.asarray(10.0),
    }


def test_a_sound_model_acts(tmp_path: Path) -> None:
    policy = LearnedPolicy(CONFIG, written(tmp_path), VEHICLE)
    assert policy.act(np.zeros((3, 4 + N_U), dtype=np.float32)).shape == (3, N_U)


@pytest.mark.slow
def test_loading_a_model_does_not_import_torchs_compiler(tmp_path: Path) -> None:
    """The first optimizer of a process imports it; a test has no use for an optimizer."""
    code = (
        "import sys\n"
        "from pathlib import Path\n"
        "from tests.unit.agents.test_trained import CONFIG, VEHICLE, LearnedPolicy\n"
        "LearnedPolicy(CONFIG, Path(sys.argv[1]), VEHICLE)\n"
        "sys.exit('torch._dynamo' in sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code, str(written(tmp_path))], check=True)


def changed(value: float) -> Callable[[Weights], None]:
    def harm(weights: Weights) -> None:
        weights["action_net.weight"].view(-1)[5] = value

    return harm


def put(name: str, value: Any) -> Callable[[dict[str, Any]], None]:
    return lambda holder: holder.update({name: value})


WEIGHTS = [
    (changed(float("inf")), "action_net.weight contains a number that is not finite"),
    (changed(float("nan")), "action_net.weight contains a number that is not finite"),
    (put("action_net.weight", torch.zeros(())), r"action_net.weight has shape \(\), expected \(6, "),
    (put("action_net.bias", torch.zeros(7)), r"action_net.bias has shape \(7,\), expected \(6,\)"),
    (put("action_net.bias", torch.zeros(6, dtype=torch.float64)), "has type torch.float64, expected"),
    (put("action_net.bias", 3.0), "action_net.bias is a float, not a tensor"),
    (lambda weights: weights.pop("log_std"), "log_std is missing"),
    (put("more", torch.zeros(1)), "more is not part of the network"),
]


@pytest.mark.parametrize(("harm", "message"), WEIGHTS)
def test_weights(tmp_path: Path, harm: Callable[[Weights], object], message: str) -> None:
    weights = dict(_policy(CONFIG, VEHICLE).state_dict())
    harm(weights)
    with pytest.raises(RunError, match=message) as caught:
        LearnedPolicy(CONFIG, written(tmp_path, weights), VEHICLE)
    assert "\n" not in str(caught.value)


STATISTICS = [
    (lambda arrays: arrays.pop("epsilon"), "epsilon is missing"),
    (put("epsilon", np.asarray(0.0)), "epsilon is not positive"),
    (put("epsilon", np.full(3, 1e-8)), r"epsilon has shape \(3,\), expected \(\)"),
    (put("observation_mean", np.asarray(1.0)), r"observation_mean has shape \(\), expected \(10,\)"),
    (put("observation_variance", np.ones(9)), r"observation_variance has shape \(9,\)"),
    (put("observation_variance", -np.ones(10)), "observation_variance contains a negative number"),
    (put("observation_mean", np.full(10, np.nan)), "observation_mean contains a number that is not finite"),
    (put("observation_mean", np.zeros(10, dtype=np.int64)), "observation_mean has type int64"),
    (put("clip_observations", np.asarray(np.inf)), "clip_observations contains a number that is not finite"),
]


@pytest.mark.parametrize(("harm", "message"), STATISTICS)
def test_statistics(tmp_path: Path, harm: Callable[[Arrays], object], message: str) -> None:
    arrays = statistics()
    harm(arrays)
    with pytest.raises(RunError, match=message) as caught:
        LearnedPolicy(CONFIG, written(tmp_path, None, arrays), VEHICLE)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["policy.pt", "normalisation.npz"])
@pytest.mark.parametrize("content", [b"", b"PK", b"\x00" * 4096, b"text"])
def test_files_that_are_no_archives_at_all(tmp_path: Path, name: str, content: bytes) -> None:
    (written(tmp_path) / name).write_bytes(content)
    with pytest.raises(RunError, match=f"{name}: the .* cannot be read") as caught:
        LearnedPolicy(CONFIG, tmp_path, VEHICLE)
    assert "\n" not in str(caught.value)


def configured(algo: str) -> Any:
    plain = configs.plain(f"algo={algo}")
    return typed(OmegaConf.create(plain))


def test_a_running_variance_is_not_negative(tmp_path: Path) -> None:
    config = configured("crossq")
    weights = dict(_policy(config, VEHICLE).state_dict())
    written(tmp_path, weights)
    LearnedPolicy(config, tmp_path, VEHICLE)
    weights["actor.latent_pi.0.ra_var"].view(-1)[3] = -1.0
    written(tmp_path, weights)
    with pytest.raises(RunError, match=r"actor.latent_pi.0.ra_var contains a negative number"):
        LearnedPolicy(config, tmp_path, VEHICLE)


@pytest.mark.parametrize("algo", ["tqc", "crossq", "trpo", "recurrent_ppo"])
def test_an_episode_acts_the_same_beside_any_others(algo: str, tmp_path: Path) -> None:
    """Weights far from zero: whatever depends on the place in the batch would show."""
    config = configured(algo)
    policy = _policy(config, VEHICLE)
    generator = torch.Generator().manual_seed(3)
    with torch.no_grad():
        for tensor in policy.parameters():
            scale = tensor.shape[-1] ** -0.5 if tensor.ndim > 1 else 0.3
            tensor.copy_(torch.randn(tensor.shape, generator=generator) * scale)
    written(tmp_path, dict(policy.state_dict()))
    observations = np.random.default_rng(0).normal(0, 2, (12, 150, 4 + N_U)).astype(np.float32)
    whole = LearnedPolicy(config, tmp_path, VEHICLE)
    whole.reset(np.arange(150))
    expected = np.stack([whole.act(step) for step in observations], axis=1)
    assert len(np.unique(expected)) > 1000
    for rows in (slice(0, 1), slice(149, 150), slice(5, 12), slice(61, 131)):
        policy_of_some = LearnedPolicy(config, tmp_path, VEHICLE)
        policy_of_some.reset(np.arange(150)[rows])
        found = np.stack([policy_of_some.act(step[rows]) for step in observations], axis=1)
        np.testing.assert_array_equal(found, expected[rows])


def test_a_recurrent_policy_forgets_where_an_episode_begins(tmp_path: Path) -> None:
    config = configured("recurrent_ppo")
    written(tmp_path, dict(_policy(config, VEHICLE).state_dict()))
    policy = LearnedPolicy(config, tmp_path, VEHICLE)
    observation = np.random.default_rng(1).normal(0, 2, (3, 4 + N_U)).astype(np.float32)
    policy.reset(np.arange(3))
    first, second = policy.act(observation), policy.act(observation)
    assert not np.array_equal(first, second), "it remembers"
    policy.reset(np.arange(3))
    np.testing.assert_array_equal(policy.act(observation), first)


@pytest.mark.parametrize("net_arch", [[8], [10, 64], [9, 10]])
def test_actions_do_not_depend_on_the_row(net_arch):
    torch.manual_seed(0)
    spaces = gymnasium.spaces.Box(-1.0, 1.0, (10,)), gymnasium.spaces.Box(-1.0, 1.0, (6,))
    policy = ActorCriticPolicy(*spaces, lambda _: 1e-3, net_arch=net_arch)
    policy.set_training_mode(False)
    act = forward.forward_of(policy)
    act.reset(forward.ROWS)
    with torch.no_grad():
        for row in torch.rand(5, 10):
            actions = act(0, row.repeat(forward.ROWS, 1))
            assert torch.equal(actions, actions[:1].expand_as(actions))
    # What was hung into the network for the pass is gone: a policy that is being trained stays as it is.
    assert not any(module._forward_pre_hooks for module in policy.modules())
