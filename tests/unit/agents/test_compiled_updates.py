"""Compiled updates are those of Stable-Baselines3, up to rounding."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import sb3_contrib
import stable_baselines3
import torch
from stable_baselines3.common.logger import Logger

from auvbench.agents.learned import compiled
from auvbench.agents.learned.compiled.product import product
from tests.soak.learning import Case


@pytest.mark.parametrize("m", [1, 5, 12, 37])
@pytest.mark.parametrize("n", [1, 16, 33, 70])
def test_products_are_those_of_numpy(m: int, n: int) -> None:
    k = 19
    rng = np.random.default_rng(0)
    a, b = rng.standard_normal((m, k), dtype=np.float32), rng.standard_normal((k, n), dtype=np.float32)
    expected = a.astype(np.float64) @ b
    for left, left_strides in ((a, (k, 1)), (a.T, (1, m))):
        for right, right_strides in ((b, (n, 1)), (b.T, (1, k))):
            found = np.full((m, n), np.nan, np.float32)
            flat = np.ascontiguousarray(left).reshape(-1), np.ascontiguousarray(right).reshape(-1)
            product(flat[0], *left_strides, flat[1], *right_strides, found.reshape(-1), m, n, k)
            np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-5)


COMMON = {"batch_size": 48, "buffer_size": 4000, "learning_starts": 400}
CASES: dict[str, tuple[Any, Any, dict[str, Any], dict[str, Any]]] = {
    "sac": (stable_baselines3.SAC, compiled.SAC, {}, {}),
    "sac, odd": (
        stable_baselines3.SAC,
        compiled.SAC,
        {"ent_coef": 0.2, "target_update_interval": 3, "tau": 0.3},
        {"net_arch": [37, 50, 21], "n_critics": 3},
    ),
    "sac, returns of 5 steps": (stable_baselines3.SAC, compiled.SAC, {"n_steps": 5, "gamma": 0.9}, {}),
    "sac, linear": (stable_baselines3.SAC, compiled.SAC, {}, {"net_arch": []}),
    "td3": (stable_baselines3.TD3, compiled.TD3, {"target_policy_noise": 0.4, "policy_delay": 2}, {}),
    "ddpg": (stable_baselines3.DDPG, compiled.DDPG, {}, {}),
    "tqc": (sb3_contrib.TQC, compiled.TQC, {"top_quantiles_to_drop_per_net": 2}, {"n_quantiles": 7}),
    "crossq": (sb3_contrib.CrossQ, compiled.CrossQ, {"policy_delay": 2}, {"net_arch": [40, 24]}),
    "crossq, renormalised": (
        sb3_contrib.CrossQ,
        compiled.CrossQ,
        {"policy_delay": 1},
        {"net_arch": {"pi": [40], "qf": [32, 24]}, "renorm_warmup_steps": 2, "batch_norm_momentum": 0.3},
    ),
    "crossq, linear": (sb3_contrib.CrossQ, compiled.CrossQ, {"policy_delay": 1}, {"net_arch": []}),
}


def pair(name: str) -> list[Any]:
    """SB3's learner and the compiled one with the same weights and the same transitions."""
    torch.set_num_threads(1)
    *kinds, options, network = CASES[name]
    found = []
    for kind in kinds:
        model, _ = Case(kind, 8, {**COMMON, **options}, network={"net_arch": [40, 24], **network}).build(5)
        model.set_logger(Logger(None, []))
        model.learn(400)
        found.append(model)
    np.testing.assert_array_equal(*(model.replay_buffer.observations for model in found))
    return found


def update(model: Any, steps: int) -> dict[str, Any]:
    torch.manual_seed(7)
    np.random.seed(7)  # noqa: NPY002
    model.train(gradient_steps=steps, batch_size=48)
    return dict(model.logger.name_to_value)


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_an_update_is_that_of_sb3(name: str) -> None:
    theirs, ours = pair(name)
    before = {key: value.clone() for key, value in ours.policy.state_dict().items()}
    for steps in (1, 6):
        logged = update(theirs, steps)
        assert update(ours, steps) == pytest.approx(logged, rel=1e-4, abs=1e-5)
        weights = theirs.policy.state_dict()
        for key, value in ours.policy.state_dict().items():
            torch.testing.assert_close(value, weights[key], rtol=1e-4, atol=2e-5, msg=key)
        # Adam's moments are running means of gradients.
        for one, other in zip(optimizers(theirs), optimizers(ours), strict=True):
            for parameter, state in one.items():
                for key in ("exp_avg", "exp_avg_sq", "step"):
                    like = state[key].double()
                    scale = float(like.abs().max()) + 1e-12
                    error = float((other[parameter][key].double() - like).abs().max())
                    assert error < 1e-4 * scale, (key, parameter)
    assert any(not torch.equal(before[key], value) for key, value in ours.policy.state_dict().items())


def optimizers(model: Any) -> list[dict[int, dict[str, torch.Tensor]]]:
    found = [model.critic.optimizer, model.actor.optimizer, getattr(model, "ent_coef_optimizer", None)]
    states = [one.state_dict()["state"] for one in found if one is not None]
    return [{k: v for k, v in state.items() if float(v["step"])} for state in states]


@pytest.mark.slow
def test_a_policy_that_is_tested_in_between_is_the_trained_one() -> None:
    """The arrays of the updates are the memory of the networks."""
    _, ours = pair("sac")
    observation = np.ones((3, *ours.observation_space.shape), np.float32)
    before = ours.predict(observation, deterministic=True)[0]
    update(ours, 5)
    after = ours.predict(observation, deterministic=True)[0]
    assert not np.array_equal(before, after)
    state = {key: torch.zeros_like(value) for key, value in ours.policy.state_dict().items()}
    ours.policy.load_state_dict(state)
    assert not ours._actor.values.any()
    assert not ours._target.values.any()
