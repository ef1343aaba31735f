"""What a step of each algorithm costs: `python -m benchmarks.paces` prints the table of `scheduling/paces.py`.

Processor time, not the clock's, so that neighbours on a busy machine matter little. Each algorithm is trained with two
numbers of gradient steps per environment step and two budgets; the difference of budgets leaves compilation and set-up
out, and two points make the line: seconds per step = collecting + gradient x gradient steps per environment step.
"""

from __future__ import annotations

import sys
import tempfile
import time

from auvbench.config.compose import compose
from auvbench.runs.plan import prepare
from auvbench.scheduling.paces import gradient_steps
from auvbench.training.execute import execute

# Overrides for few and for many gradient steps, and the two budgets.
CASES = {
    "ppo": (["algo.n_epochs=2"], [], 40_960, 163_840),
    "sac": (["algo.gradient_steps=2"], [], 3_200, 9_600),
    "ddpg": (["algo.gradient_steps=2"], [], 3_200, 9_600),
    "td3": (["algo.gradient_steps=2"], [], 3_200, 9_600),
    "tqc": (["algo.gradient_steps=2"], [], 3_200, 9_600),
    "crossq": (["algo.gradient_steps=2"], [], 3_200, 9_600),
    "trpo": (["algo.n_critic_updates=2"], [], 40_960, 163_840),
    "recurrent_ppo": (["algo.n_epochs=2"], [], 12_288, 40_960),
    "ppo_residual": (["algo.n_epochs=2"], [], 40_960, 163_840),
    "sac_residual": (["algo.gradient_steps=2"], [], 3_200, 9_600),
    "ppo_thesis": (["algo.n_epochs=2"], [], 4_096, 16_384),
    "sac_thesis": (["algo.train_freq=4"], [], 400, 1_600),
    "ddpg_thesis": (["algo.train_freq=4"], [], 400, 1_600),
}
SHORT_START = {"sac", "ddpg", "td3", "tqc", "crossq", "sac_residual", "sac_thesis", "ddpg_thesis"}


def seconds(algo: str, overrides: list[str], steps: int) -> float:
    """Processor time of a training."""
    with tempfile.TemporaryDirectory() as folder:
        early = ["algo.learning_starts=100"] if algo in SHORT_START else []
        line = [f"algo={algo}", f"output={folder}", f"train.total_steps={steps}", *early, *overrides]
        run = prepare(compose("train", line))
        begun = time.process_time()
        execute(run)
        return time.process_time() - begun


def measure(algo: str) -> tuple[float, float]:
    """Seconds of an environment step without learning, and of a gradient step."""
    points = []
    few, many, short, long = CASES[algo]
    for overrides in (few, many):
        per_step = (seconds(algo, overrides, long) - seconds(algo, overrides, short)) / (long - short)
        config = compose("train", [f"algo={algo}", *overrides])
        points.append((gradient_steps(config.algo), per_step))
    (u, t), (v, s) = points
    slope = (s - t) / (v - u)
    return t - slope * u, slope


if __name__ == "__main__":
    import torch

    torch.set_num_threads(1)
    execute(prepare(compose("train", ["output=" + tempfile.mkdtemp(), "train.total_steps=4096"])))  # compiles
    for name in sys.argv[1:] or CASES:
        collecting, gradient = measure(name)
        print(f'    "{name}": Cost({collecting:.2e}, {gradient:.2e}),', flush=True)
