"""Define the learner PETS: its schema and its spec."""

from __future__ import annotations

from dataclasses import dataclass

from auvbench.config.algorithms import AgentSpec, Algorithm
from auvbench.config.fields import require
from auvbench.config.schema import number


@dataclass(kw_only=True)
class PETS(Algorithm):
    members: int = number(1, 64)
    net_arch: list[int]
    learning_rate: float = number(0.0, 1.0, open_low=True)
    weight_decay: float = number(0.0, 1.0)
    batch_size: int = number(1, 1 << 20)
    gradient_steps: int = number(1, 1 << 20)
    fit_every: int = number(1, 1 << 31)
    learning_starts: int = number(2, 1 << 31)
    buffer_size: int = number(2, 1 << 31)
    samples: int = number(2, 65_536)
    horizon: float = number(0.0, 100.0, open_low=True)  # s
    temperature: float = number(0.0, 1e3, open_low=True)
    noise: float = number(0.0, 2.0, open_low=True)
    correlation: float = number(0.0, 100.0)  # s
    reading_share: float = number(0.0, 1.0)
    gamma: float = number(0.0, 1.0)
    terminal_weight: float = number(0.0, 1e6)

    def check(self) -> None:
        widths = self.net_arch
        right = len(widths) > 0 and all(width > 0 for width in widths)
        require(right, "algo.net_arch", widths, "have at least one layer, and widths of at least 1")
        starts = self.learning_starts
        require(
            self.buffer_size >= starts, "algo.buffer_size", self.buffer_size, f"be at least {starts} steps"
        )


SPEC = AgentSpec(
    "pets",
    "PETS",
    PETS,
    "auvbench.agents.learned.pets:PETSLearner",
    learns=True,
    teams=False,
    check="auvbench.agents.learned.pets:check",
)
