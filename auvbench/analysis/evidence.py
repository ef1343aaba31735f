"""Provide the evidence for the claims of the original study: trainings, agents, and parts of a verdict."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from auvbench.analysis.damage import Damage
from auvbench.analysis.formatting import capitalized, counted, listed, p_value
from auvbench.analysis.recorded import training
from auvbench.analysis.records import Agent, ClaimVerdict, RunRecord
from auvbench.analysis.thesis import FACTORS, of_family, with_factors
from auvbench.statistics.intervals import BoolArray, Estimate, FloatArray, quantile

HOLDS, FAILS, OPEN = "holds", "does not hold", "cannot be said"

WINDOW = 100
"""number of successive training episodes in a window"""
SHORT = 0.8
"""Upper limit of the mean duration of a good window's episodes, as a share of the time limit"""
HALF = 0.5
"""Smallest success rate of a good window. A limit on durations is not enough, because early collisions are short"""
PERMUTATIONS = 10_000

Point = tuple[str, float, float]
"""Stratum, level and value of a run; a run is compared only with runs of the same stratum"""


def limit_s(run: RunRecord) -> float:
    """Return the time limit of a training episode in s; NaN if the configuration has none."""
    if (limit := run.config.get("task.time_limit")) is not None:
        return float(limit)
    steps, f = run.config.get("task.max_steps"), run.config.get("step.frequency")
    return float(steps) / float(f) if steps and f else math.nan


def good_windows(seconds: FloatArray, success: BoolArray, limit: float) -> BoolArray:
    """Return, for each window of `WINDOW` successive episodes, whether the window is good.

    In a good window, at least the share `HALF` of the episodes succeeds within the time limit. The mean duration
    is less than `SHORT` times the limit. For this mean, durations longer than the limit are cut to the limit.

    Args:
        seconds: (n,) durations, in the order in which the episodes ended.
        success: (n,) successes, in the same order.
        limit: time limit, s.

    Returns:
        Array (n - `WINDOW` + 1,); empty if n < `WINDOW`.
    """
    in_time = _window_means(success & (seconds <= limit))
    duration = _window_means(np.minimum(seconds, limit))
    return (duration < SHORT * limit) & (in_time >= HALF)


def _window_means(values: FloatArray | BoolArray) -> FloatArray:
    total = np.concatenate([[0.0], np.cumsum(values, dtype=np.float64)])
    return np.asarray((total[WINDOW:] - total[:-WINDOW]) / WINDOW, dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class Learning:
    """Training of a run, with its episodes in the order in which they ended."""

    run: RunRecord
    k: float
    frequency: float
    """Step frequency, Hz"""
    steps: int
    """environment steps of the whole training"""
    seconds: FloatArray  # (n,) duration of each episode
    success: BoolArray  # (n,) success of each episode
    ended: FloatArray  # (n,) environment steps of the training when each episode ended

    @property
    def limit(self) -> float:
        """Return the time limit of an episode in s."""
        return limit_s(self.run)

    @property
    def converged(self) -> bool:
        """Return whether the run converged within its own time limit of an episode."""
        return bool(np.isfinite(self.converged_at(self.limit)))

    def converged_at(self, limit: float) -> float:
        """Return the number of environment steps before the first good window; inf if the last window is not good."""
        good = good_windows(self.seconds, self.success, limit)
        if not good.size or not good[-1]:
            return np.inf
        first = int(good.argmax())
        return float(self.ended[first - 1]) if first else 0.0


def learning(run: RunRecord) -> Learning | None:
    """Read a run's training; None without records, without a frequency, or with fewer than `WINDOW` episodes."""
    try:
        frame = training(run)
    except Damage:  # reported by the figures
        return None
    k, frequency = run.config.get("reward.k"), run.config.get("step.frequency")
    if frame is None or len(frame) < WINDOW or not frequency:
        return None
    frame = frame.sort_values("step", kind="stable")
    return Learning(
        run,
        math.nan if k is None else float(k),
        float(frequency),
        steps=max(int(frame["step"].iloc[-1]), int(run.manifest.get("steps") or 0)),
        seconds=frame["steps"].to_numpy(dtype=np.float64) / float(frequency),
        success=(frame["outcome"] == "success").to_numpy(),
        ended=frame["step"].to_numpy(dtype=np.float64),
    )


@dataclass(frozen=True, slots=True)
class Trend:
    """Trend test: share of run pairs in which the run with the higher level has the higher value; a tie counts half.

    Both runs of a pair belong to the same stratum.
    """

    share: float
    pairs: int
    p_up: float
    """one-sided p-value of the hypothesis that values do not rise with the level"""
    p_down: float
    """one-sided p-value of the hypothesis that values do not fall with the level"""


def trend(points: Sequence[Point], seed: int = 0) -> Trend | None:
    """Return Jonckheere and Terpstra's statistic within strata, with a permutation test; None without a pair.

    Values are permuted among the runs of a stratum 10,000 times. The test's level is exact for any
    distribution. With two strata of two runs each, there are only four permutations, so no p-value is below 1/4.
    """
    rng = np.random.default_rng(seed)
    pairs, wins, permuted = 0, 0.0, np.zeros(PERMUTATIONS)
    for name in sorted({point[0] for point in points}):
        levels, values = (np.array([point[i] for point in points if point[0] == name]) for i in (1, 2))
        low, high = np.nonzero(levels[:, None] < levels[None, :])
        drawn = rng.permuted(np.tile(values, (PERMUTATIONS, 1)), axis=1)
        pairs += len(low)
        wins += float(_wins(values[None], low, high)[0])
        permuted += _wins(drawn, low, high)
    if not pairs:
        return None
    p_up = (1 + (permuted >= wins - 1e-9).sum()) / (1 + PERMUTATIONS)
    p_down = (1 + (permuted <= wins + 1e-9).sum()) / (1 + PERMUTATIONS)
    return Trend(wins / pairs, pairs, float(p_up), float(p_down))


def _wins(values: FloatArray, low: NDArray[np.intp], high: NDArray[np.intp]) -> FloatArray:
    """Return the number of pairs that the run with the higher level wins, for each of m rows of values (a tie is half a win).

    Returns:
        Array (m,).
    """
    lower, higher = values[:, low], values[:, high]
    return np.asarray(((higher > lower).sum(axis=1) + (higher >= lower).sum(axis=1)) / 2)


@dataclass(frozen=True, slots=True)
class Part:
    """One test of a claim."""

    verdict: str
    statistic: str = ""
    missing: str = ""
    run_ids: tuple[str, ...] = ()


class Evidence:
    """Runs and agents of a report, as evidence for the claims."""

    def __init__(self, runs: Sequence[RunRecord], agents: Sequence[Agent], confidence: float, seed: int):
        self.runs, self.confidence, self.seed = runs, confidence, seed
        self.agents = [with_factors(agent) for agent in agents]

    def of(self, family: str) -> list[Agent]:
        """Return the agents of an algorithm."""
        return of_family(self.agents, family)

    @cached_property
    def sac(self) -> list[Learning]:
        """Return the trainings of SAC, tested or not; reading long trainings takes a while."""
        names = {str(run.config.get("algo.name")) for run in self.runs}
        name = "sac_thesis" if "sac_thesis" in names else "sac"
        runs = [r for r in self.runs if r.state == "complete" and r.config.get("algo.name") == name]
        trainings = (learning(run) for run in sorted(runs, key=lambda run: run.id))
        return [training for training in trainings if training is not None]

    def levels(self, parts: int) -> tuple[float, float]:
        """Return the confidences of the intervals for "holds" and "does not hold" of a claim with several parts."""
        return self.confidence, 1 - (1 - self.confidence) / parts

    def attainable(self, limit: float) -> bool:
        """Return whether any tested policy of the report meets the criterion of convergence within a time limit in s.

        The tested policies include controllers. If no tested policy meets the criterion, then a training that does
        not meet the criterion may still have learned.
        """
        for agent in self.agents:
            for seconds, success in zip(agent.metrics.get("duration_s", ()), agent.success > 0, strict=False):
                good = good_windows(seconds, success, limit)
                if good.size and good[-1]:
                    return True
        return False

    def unattainable(self, runs: Sequence[Learning]) -> list[str]:
        """Return a list with one text, which names the time limits within which no tested policy converges.

        The list is empty if each run's time limit is long enough for some tested policy (see `attainable`).
        """
        time_limits = sorted({run.limit for run in runs if not self.attainable(run.limit)})
        if not time_limits:
            return []
        times = listed([f"{limit:.3g}" for limit in time_limits])
        return [f"a time limit within which a control converges (no policy does within {times} s)"]


def by_interval(
    at: Callable[[float], Estimate], levels: tuple[float, float], above: float, *, less: bool = False
) -> str:
    """Return the verdict on the claim that a value is above a bound.

    The claim holds if the whole interval is above the bound, and fails if the whole interval is below it.

    Args:
        at: function that returns the estimate for a confidence.
        levels: confidences of the intervals for "holds" and "does not hold".
        above: bound.
        less: whether the claim is that the value is below the bound.
    """
    yes, no = at(levels[0]), at(levels[1])
    if (yes.high < above) if less else (yes.low > above):
        return HOLDS
    return FAILS if ((no.low > above) if less else (no.high < above)) else OPEN


def by_trend(result: Trend, what: str, levels: tuple[float, float], ids: tuple[str, ...]) -> Part:
    """Return a part that claims a rising trend, tested with two one-sided permutation tests."""
    rises, falls = result.p_up < (1 - levels[0]) / 2, result.p_down < (1 - levels[1]) / 2
    verdict = HOLDS if rises else FAILS if falls else OPEN
    p = p_value(min(1, 2 * min(result.p_up, result.p_down)))
    statistic = f"{what} {100 * result.share:.0f} % of {counted(result.pairs, 'pair')} of runs, {p}"
    return Part(verdict, statistic, "more training seeds per cell" if verdict == OPEN else "", ids)


def together(text: str, parts: Sequence[Part]) -> ClaimVerdict:
    """Return a claim's verdict: it fails if one part fails, holds if all parts hold, and otherwise cannot be said."""
    verdicts = [part.verdict for part in parts]
    verdict = FAILS if FAILS in verdicts else OPEN if OPEN in verdicts else HOLDS
    statistics, missing = [], []
    for letter, part in zip("abc", parts, strict=False):
        lettered = len(parts) > 1
        if part.statistic:
            statistics.append(f"({letter}) {part.verdict}: {part.statistic}" if lettered else part.statistic)
        if part.missing:
            missing.append(f"({letter}) {part.missing}" if lettered else part.missing)
    runs = tuple(dict.fromkeys(run for part in parts for run in part.run_ids))
    return ClaimVerdict(text, verdict, _sentence(statistics), _sentence(missing), runs)


def _sentence(parts: Sequence[str]) -> str:
    text = "; ".join(parts)
    return f"{capitalized(text)}." if text else ""


def independent(agents: Sequence[Agent]) -> int:
    """Return the number of agents that count as independent.

    Agents with the same level of a factor share the level's effect. The number is therefore at most the number of
    parameters of a main-effects model: 1 plus (number of levels - 1) for each factor.
    """
    levels_by_factor = [{agent.key.get(factor) for agent in agents} for factor in FACTORS]
    return min(len(agents), 1 + sum(len(levels) - 1 for levels in levels_by_factor))


def partial_rank_correlation(
    x: FloatArray, y: FloatArray, third: FloatArray, n: int, confidence: float
) -> Estimate:
    """Return Spearman's rho of x and y given a third variable, with an interval for n independent points.

    The interval follows Bonett & Wright (2000, Psychometrika 65:23): tanh(atanh rho ± z sqrt((1 + rho²/2) /
    (n - 3))), where n is reduced by one if the third variable varies. The interval is [-1, 1] if rho is undefined
    or n is too small.
    """
    from scipy.stats import rankdata  # imported late: takes half a second, and most reports do not need it

    ranks = [rankdata(values) for values in (x, y, third)]
    with np.errstate(invalid="ignore"):
        r = np.nan_to_num(np.corrcoef(ranks))  # a constant variable has the correlation 0
    residual = np.sqrt((1 - r[0, 2] ** 2) * (1 - r[1, 2] ** 2))
    free = n - 4 if np.ptp(ranks[2]) > 0 else n - 3
    if residual < 1e-6 or min(np.ptp(ranks[0]), np.ptp(ranks[1])) == 0:
        return Estimate(0.0, -1.0, 1.0, confidence, "agents")
    rho = float((r[0, 1] - r[0, 2] * r[1, 2]) / residual)
    if free <= 0:
        return Estimate(rho, -1.0, 1.0, confidence, "agents")
    z = np.arctanh(np.clip(rho, -0.999999, 0.999999))
    half = float(quantile(confidence)) * np.sqrt((1 + rho**2 / 2) / free)
    return Estimate(rho, float(np.tanh(z - half)), float(np.tanh(z + half)), confidence, "agents")
