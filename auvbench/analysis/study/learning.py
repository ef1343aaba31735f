"""What the training records of a run say: whether and when it converged, and how its best-rewarded episodes ended."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from auvbench.analysis.evaluations import Damage
from auvbench.analysis.model import RunRecord
from auvbench.analysis.timing import step_limit
from auvbench.analysis.training import training

WINDOW = 100
"""training episodes that are averaged"""
SHORT = 0.8
"""of the step limit: mean episode lengths above are 'near' it"""
HALF = 0.5
"""share of successes in the window, without which short episodes are early collisions and no convergence"""


@dataclass(frozen=True, slots=True)
class Learning:
    """A run's training in a few numbers."""

    run: RunRecord
    steps: int
    """environment steps of the whole training"""
    length: float
    """mean steps of the last 100 episodes"""
    converged_at: float
    """environment steps when it first converged; inf if it did not, or did not stay so to the end"""
    failing_top: float
    """share of failures among the tenth of the episodes of the second half with the highest return"""

    @property
    def converged(self) -> bool:
        """Whether the last 100 episodes are short because they succeed."""
        return bool(np.isfinite(self.converged_at))


def learning(run: RunRecord) -> Learning | None:
    """Reads a run's training; None without records, or with fewer than 100 episodes.

    Converged at a step: the last 100 episodes ended by then have a mean length below 0.8 of the step limit and at
    least 50 of them are successes. A run has converged if that holds at its end.
    """
    try:
        frame = training(run)
    except Damage:  # the figures name it
        return None
    if frame is None or len(frame) < WINDOW:
        return None
    frame = frame.sort_values("step", kind="stable")
    limit = step_limit(run)
    success = (frame["outcome"] == "success").astype(float)
    length = frame["steps"].rolling(WINDOW).mean()
    good = ((length < SHORT * limit) & (success.rolling(WINDOW).mean() >= HALF)).to_numpy()
    at = float(frame["step"].to_numpy()[int(good.argmax())]) if good[-1] else np.inf
    return Learning(
        run=run,
        steps=max(int(frame["step"].iloc[-1]), int(run.manifest.get("steps") or 0)),
        length=float(length.iloc[-1]),
        converged_at=at,
        failing_top=_failing_top(frame.iloc[len(frame) // 2 :]),
    )


def _failing_top(frame: pd.DataFrame) -> float:
    top = frame.nlargest(max(len(frame) // 10, 1), "return")
    return float((top["outcome"] != "success").mean())
