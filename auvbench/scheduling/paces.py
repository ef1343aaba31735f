"""What to expect of a run before it has shown its pace: measured costs of a step, and this machine's measure of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple


class Cost(NamedTuple):
    """Processor time in seconds."""

    collecting: float
    """of an environment step with everything but learning"""
    gradient: float
    """of a gradient step"""


COSTS: dict[str, Cost] = {
    "ppo": Cost(2.5e-05, 8.6e-04),  # some 30,000 steps/s with the preset's settings
    "sac": Cost(7.8e-05, 2.7e-03),  # 1,300
    "ddpg": Cost(4.8e-05, 1.8e-03),  # 2,000
    "td3": Cost(1.8e-05, 2.1e-03),  # 1,800
    "tqc": Cost(7.8e-05, 3.5e-03),  # 1,000
    "crossq": Cost(7.8e-05, 5.7e-03),  # 660
    "trpo": Cost(2.5e-05, 1.2e-03),  # 27,000
    "recurrent_ppo": Cost(2.1e-05, 6.7e-03),  # 19,000
    "ppo_residual": Cost(4.1e-05, 8.6e-04),  # 20,000
    "sac_residual": Cost(9.4e-05, 2.7e-03),  # 1,300
    "ppo_thesis": Cost(3.3e-04, 8.9e-04),  # 2,100
    "sac_thesis": Cost(2.3e-04, 7.3e-03),  # 130
    "ddpg_thesis": Cost(9.2e-05, 6.2e-03),  # 160
}
"""By the name of the preset, for one core of a 2-core cloud machine (AMD EPYC, 2.6 GHz).

Ratios within on-policy and within off-policy learners: `python -m benchmarks.paces`, processor time on a busy machine;
scaled so that ppo and sac have the paces that `make bench` measured on an idle one (docs/performance.md). Those of tqc,
crossq, trpo, recurrent_ppo and the residual learners are ppo's and sac's times the ratio of processor times of a rollout and
of an update, measured side by side.
"""

ALIKE = {
    name: name
    for name in (
        *("ppo", "sac", "ddpg", "td3", "tqc", "crossq", "trpo", "recurrent_ppo"),
        *("ppo_residual", "sac_residual"),
    )
}
"""The preset whose costs stand for another one of the same agent."""


def gradient_steps(algo: Mapping[str, Any]) -> float:
    """Gradient steps per environment step of an algorithm's configuration.

    >>> gradient_steps({"n_epochs": 10, "batch_size": 1000}), gradient_steps(
    ...     {"gradient_steps": 8, "train_freq": 1, "n_envs": 32}
    ... )
    (0.01, 0.25)
    """
    passes = algo.get("n_epochs", algo.get("n_critic_updates"))
    if passes is not None:
        return float(passes) / float(algo["batch_size"])
    if "gradient_steps" not in algo:
        return 0.0
    collected = float(algo["train_freq"]) * float(algo["n_envs"])
    steps = float(algo["gradient_steps"])
    return 1.0 if steps < 0 else steps / collected


def prior(algo: Mapping[str, Any]) -> float | None:
    """Steps per second that a run of this configuration of `algo` makes on the machine of `COSTS`.

    None for what was not measured, such as somebody's own algorithm.
    """
    name = str(algo.get("name"))
    cost = COSTS.get(name) or COSTS.get(ALIKE.get(str(algo.get("agent")), ""))
    if cost is None:
        return None
    try:
        return 1.0 / (cost.collecting + cost.gradient * gradient_steps(algo))
    except (KeyError, TypeError, ValueError, ZeroDivisionError):  # a configuration that was edited
        return None


def telling_from(algo: Mapping[str, Any]) -> int:
    """Steps from which a run's own pace can be believed: before it learns it is faster than ever after."""
    early = algo.get("learning_starts", 0)
    return 3 * early if isinstance(early, int) else 0
