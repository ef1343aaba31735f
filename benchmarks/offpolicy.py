"""Measure updates of off-policy learners: Stable-Baselines3's, compiled ones, and SBX's if it is installed (`pip install sbx-rl`)."""

from __future__ import annotations

import inspect
import os
import time
from collections.abc import Iterator
from importlib.util import find_spec
from typing import Any

from stable_baselines3.common.logger import Logger
from stable_baselines3.common.vec_env import VecNormalize

from auvbench.agents.learned import learners
from auvbench.config.compose import compose
from auvbench.config.schema import TrainConfig
from auvbench.config.validate import train_config
from auvbench.envs.batch import Batch
from auvbench.envs.sb3 import AuvVecEnv
from auvbench.registry import AGENTS

UPDATES, ROUNDS, CALLS = 8, 10, 6
STEPS = 4000
"""steps of random actions that fill the replay buffer"""


def offpolicy() -> Iterator[tuple[str, str, str, str]]:
    """Return the processor time of an update of 256 transitions by SB3, SBX and compiled code: the least of several rounds of eight."""
    for algo in ("sac", "td3", "tqc", "crossq"):
        configs = {
            name: train_config(compose("train", [f"algo={algo}", f"algo.updates={name}"]))
            for name in ("sb3", "compiled")
        }
        models = {
            name: _ready(learners.make(config, _environment(config))) for name, config in configs.items()
        }
        if find_spec("sbx"):
            models["SBX"] = _ready(_sbx(configs["sb3"]))
        for model in models.values():
            model.train(UPDATES, 256)  # compiles
        least = dict.fromkeys(models, float("inf"))
        for _ in range(ROUNDS):  # alternate the learners, since the load of a machine changes
            for name, model in models.items():
                begun = time.process_time()
                for _ in range(CALLS):
                    model.train(UPDATES, 256)
                least[name] = min(least[name], (time.process_time() - begun) / (UPDATES * CALLS))
        for name, seconds in least.items():
            title = {"sb3": "Stable-Baselines3", "compiled": "compiled"}.get(name, name)
            remark = f"{1e3 * seconds:.2f} ms; {least['sb3'] / seconds:.2f} times Stable-Baselines3"
            yield f"updates, {AGENTS[algo].title}, {title}", f"{1 / seconds:,.0f}", "updates/s", remark


def _environment(config: TrainConfig) -> VecNormalize:
    return VecNormalize(AuvVecEnv(Batch(config), detailed=False))


def _ready(model: Any) -> Any:
    """Return the learner with a filled replay buffer."""
    model.set_logger(Logger(None, []))
    model.learning_starts = 2 * STEPS
    model.learn(STEPS)
    return model


def _sbx(config: TrainConfig) -> Any:
    """Return SBX's learner on one core with the same networks and settings."""
    # JAX reads it when it starts.
    os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
    os.environ["JAX_PLATFORMS"] = "cpu"
    import flax.linen
    import sbx  # type: ignore[import-not-found]

    algo: Any = config.algo
    kind = getattr(sbx, AGENTS[algo.agent].title)
    arguments = learners.arguments(config, _environment(config))
    arguments["policy_kwargs"] = {
        "net_arch": list(algo.net_arch),
        "activation_fn": flax.linen.relu,
        "n_critics": 2,
    }
    if algo.agent == "tqc":
        arguments["policy_kwargs"]["n_quantiles"] = algo.n_quantiles
    if algo.agent == "crossq":
        arguments["policy_kwargs"]["net_arch"] = {"pi": list(algo.net_arch), "qf": list(algo.critic_net_arch)}
    taken = inspect.signature(kind).parameters
    return kind(**{name: value for name, value in arguments.items() if name in taken})
