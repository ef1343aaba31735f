"""Warn about training budgets that are too small for their task."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from auvbench.config.algorithms import learns
from auvbench.registry import TASKS

if TYPE_CHECKING:
    from omegaconf import DictConfig


def remarks(configs: Sequence[DictConfig]) -> list[str]:
    """Return a warning for each task that a learner trains for fewer steps than `TaskSpec.budget`.

    Published learners did not learn the task in fewer steps. Residual learners are not checked, since their controller
    already brings the vehicle near the goal.
    """
    short: dict[str, int] = {}
    for config in configs:
        task, algo, steps = str(config.task.name), config.algo, int(config.train.total_steps)
        if task in TASKS.own and learns(algo) and "residual" not in algo and steps < TASKS[task].budget:
            short[task] = max(steps, short.get(task, 0))
    return [
        f"task={task}: {TASKS[task].short_of_budget}; type train.total_steps={TASKS[task].budget} or more instead of"
        f" {steps:,}"
        for task, steps in short.items()
    ]
