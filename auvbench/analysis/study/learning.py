"""What the training records of a run say: whether and when it converged, and how its best-rewarded episodes ended."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from auvbench.analysis.evaluations import Damage
from auvbench.analysis.records import RunRecord
from auvbench.analysis.timing import limit_s
from auvbench.analysis.training import training
from auvbench.statistics.intervals import FloatArray

WINDOW = 100
"""episodes that are averaged"""
SHORT = 0.8
"""of the time limit: a window with a longer mean episode has not converged"""
HALF = 0.5
"""share of successes in the window, without which short episodes are early collisions and no convergence"""


@dataclass(frozen=True, slots=True, eq=False)
class Episodes:
    """Episodes of a training or of a test, in the order in which they ended."""

    seconds: FloatArray  # (n,) duration
    success: NDArray[np.bool_]  # (n,)
    ended: FloatArray  # (n,) environment steps of the training when the episode ended

    def converged_at(self, limit: float) -> float:
        """Return the environment steps before the first good window of `WINDOW` episodes; inf without convergence.

        In a good window at least `HALF` of the episodes succeed within `limit` seconds, and the mean duration, cut at the
        limit, is below `SHORT` of it. The last window must be good. A policy that succeeds from the first episode on has
        converged at 0, however many steps its episodes take.
        """
        if len(self.seconds) < WINDOW:
            return np.inf
        in_time = _window_means(self.success & (self.seconds <= limit))
        duration = _window_means(np.minimum(self.seconds, limit))
        good = (duration < SHORT * limit) & (in_time >= HALF)
        first = int(good.argmax())
        if not good[-1]:
            return np.inf
        return float(self.ended[first - 1]) if first else 0.0


def _window_means(values: NDArray[np.float64] | NDArray[np.bool_]) -> FloatArray:
    total = np.concatenate([[0.0], np.cumsum(values, dtype=np.float64)])
    return np.asarray((total[WINDOW:] - total[:-WINDOW]) / WINDOW, dtype=np.float64)


@dataclass(frozen=True, slots=True)
class Learning:
    """A run's training in a few numbers."""

    run: RunRecord
    steps: int
    """environment steps of the whole training"""
    episodes: Episodes
    failing_top: float
    """share of failures among the tenth of the episodes of the second half with the highest return"""

    @property
    def limit(self) -> float:
        """Seconds that an episode may last."""
        return limit_s(self.run)

    @property
    def converged(self) -> bool:
        """Whether the run converged within its own time limit."""
        return bool(np.isfinite(self.converged_at(self.limit)))

    def converged_at(self, limit: float) -> float:
        """Return the environment steps when the run converged, by `Episodes.converged_at`."""
        return self.episodes.converged_at(limit)


def learning(run: RunRecord) -> Learning | None:
    """Read a run's training; None without records, without a frequency, or with fewer than 100 episodes."""
    try:
        frame = training(run)
    except Damage:  # the figures name it
        return None
    frequency = run.config.get("step.frequency")
    if frame is None or len(frame) < WINDOW or not frequency:
        return None
    frame = frame.sort_values("step", kind="stable")
    return Learning(
        run=run,
        steps=max(int(frame["step"].iloc[-1]), int(run.manifest.get("steps") or 0)),
        episodes=Episodes(
            frame["steps"].to_numpy(dtype=np.float64) / float(frequency),
            (frame["outcome"] == "success").to_numpy(),
            frame["step"].to_numpy(dtype=np.float64),
        ),
        failing_top=_failing_top(frame.iloc[len(frame) // 2 :]),
    )


def _failing_top(frame: pd.DataFrame) -> float:
    top = frame.nlargest(max(len(frame) // 10, 1), "return")
    return float((top["outcome"] != "success").mean())
