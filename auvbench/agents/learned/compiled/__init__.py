"""Off-policy algorithms of Stable-Baselines3 with the same updates, compiled: `algo.updates=compiled`.

Each class replaces `train` of its base by hand-written gradients on flat float32 arrays, which share the
memory of SB3's own parameters and optimizer states. Draws, logs, checkpoints and saved files come from the
base class. All numbers equal SB3's numbers up to rounding (tests/unit/agents/test_compiled_updates.py).
"""

from auvbench.agents.learned.compiled.algorithms import DDPG, SAC, TD3, TQC, CrossQ

__all__ = ["DDPG", "SAC", "TD3", "TQC", "CrossQ"]
