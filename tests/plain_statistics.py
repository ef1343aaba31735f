"""The table once more from the CSV files, with pandas and scipy alone: nothing here imports auvbench.

Formulas as docs/statistics-appendix.md states them, loop by loop and without regard to speed: what the report prints must agree
with this to 1e-12.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from math import sqrt
from pathlib import Path

import numpy as np
import pandas as pd
import yaml
from scipy import stats
from scipy.optimize import brentq

LIMIT = 1000.0


@dataclass
class Plain:
    """One agent: a frame of seeds (rows) and episodes (columns) per measure."""

    name: str
    learns: bool
    success: pd.DataFrame
    par1: pd.DataFrame

    @property
    def seeds(self) -> int:
        return len(self.success)


def read(folder: Path) -> list[Plain]:
    """The agents of an experiment by algorithm, K and frequency; a failed training has no success."""
    rows = []
    for run in sorted(p.parent for p in folder.glob("*/manifest.json")):
        manifest = json.loads((run / "manifest.json").read_text())
        config = yaml.safe_load((run / "config.yaml").read_text())
        key = (config["algo"]["name"], config["reward"]["k"], config["step"]["frequency"])
        if manifest["state"] == "complete":
            episodes = pd.read_csv(run / "evaluations" / "test" / "episodes.csv").set_index("episode")
            success = (episodes["outcome"] == "success").astype(float)
            rows.append((key, config["seed"], success, episodes["steps"].where(success == 1, LIMIT)))
        elif manifest["state"] == "failed":
            rows.append((key, config["seed"], None, None))
    index = next(success.index for _, _, success, _ in rows if success is not None)
    agents = []
    for key in sorted({key for key, *_ in rows}):
        mine = sorted((row for row in rows if row[0] == key), key=lambda row: row[1])
        success = [pd.Series(0.0, index) if s is None else s for _, _, s, _ in mine]
        par1 = [pd.Series(LIMIT, index) if s is None else s for _, _, _, s in mine]
        learns = key[0] not in ("pid", "random")
        agents.append(Plain(str(key), learns, pd.DataFrame(success), pd.DataFrame(par1)))
    return agents


@dataclass
class Pieces:
    """The variance of a mean: between seeds A with its degrees of freedom, between scenarios B - R."""

    mean: float
    a: float
    df: float
    b: float
    r: float
    columns: np.ndarray
    seeds: int
    rate: bool


def pieces(x: pd.DataFrame, rate: bool) -> Pieces:
    S, E = x.shape
    mean, seeds, scenarios = x.to_numpy().mean(), x.mean(axis=1), x.mean(axis=0)
    a = seeds.var() / S if S > 1 else 0.0
    b = scenarios.var() / E
    left = x.sub(seeds, axis=0).sub(scenarios, axis=1) + mean
    r = float((left**2).to_numpy().sum()) / ((S - 1) * (E - 1)) / (S * E) if S > 1 else 0.0
    if rate and mean in (0.0, 1.0):
        shrunk = (mean * S * E + 1) / (S * E + 2)
        if S > 1:
            a = shrunk * (1 - shrunk) / (S * E)
        else:
            b = shrunk * (1 - shrunk) / E
    return Pieces(mean, a, S - 1 if S > 1 else np.inf, b, r, scenarios.to_numpy(), S, rate)


def half_width(a: float, df: float, c: float, dfc: float, tail: float) -> float:
    """sqrt(A t(df)² + C t(dfc)²) at an upper tail."""
    total = 0.0
    if a > 0:
        total += a * stats.t.isf(tail, df) ** 2
    if c > 0:
        total += c * stats.t.isf(tail, dfc) ** 2
    return sqrt(total)


def rate_interval(x: pd.DataFrame, confidence: float) -> tuple[float, float]:
    """Wilson's, with as many trials as would have the variance of the mean."""
    S, E = x.shape
    p, tail = pieces(x, True), (1 - confidence) / 2
    c = max(p.b - p.r, 0.0)
    if S == 1:
        n, z = float(E), stats.norm.isf(tail)
    else:
        n = S * E if p.mean in (0.0, 1.0) else min(p.mean * (1 - p.mean) / (p.a + c), S * E)
        z = half_width(p.a, p.df, c, E - 1, tail) / sqrt(p.a + c)
    centre = (p.mean + z**2 / (2 * n)) / (1 + z**2 / n)
    half = z / (1 + z**2 / n) * sqrt(p.mean * (1 - p.mean) / n + z**2 / (4 * n**2))
    return max(centre - half, 0.0), min(centre + half, 1.0)


def mean_interval(x: pd.DataFrame, confidence: float, least: float, most: float) -> tuple[float, float]:
    p = pieces(x, False)
    half = half_width(p.a, p.df, max(p.b - p.r, 0.0), x.shape[1] - 1, (1 - confidence) / 2)
    return max(p.mean - half, least), min(p.mean + half, most)


def median_interval(x: pd.DataFrame, level: float) -> tuple[float, float, float]:
    """Ends of an interval of the median over trainings, and that of the sample."""
    v = sorted(float(mean) for mean in x.mean(axis=1))
    n, middle = len(v), float(np.median(v))
    if n == 1:
        return middle, middle, middle
    # 1 - confidence of the interval from the r-th smallest to the r-th largest value.
    missed = {r: 2 * stats.binom.cdf(r - 1, n, 0.5) for r in range(1, n // 2 + 2)}
    r = max((r for r in range(1, n // 2 + 1) if missed[r] <= level), default=0)
    if r == 0:
        beyond = max(level ** (-1 / (n - 1)) / 2 - 1, 0.0) * (v[-1] - v[0])
        return v[0] - beyond, middle, v[-1] + beyond
    w = (level - missed[r]) / (missed[r + 1] - missed[r]) if r < n // 2 else 0.0
    return (1 - w) * v[r - 1] + w * v[min(r, n - 1)], middle, (1 - w) * v[n - r] + w * v[n - r - 1]


def middle_half(x: pd.DataFrame) -> pd.Series:
    """By scenario, the mean without the best and the worst quarter of the trainings, as many as fit in a whole number."""
    cut = len(x) // 4
    order = np.argsort(x.mean(axis=1).to_numpy(), kind="stable")[cut : len(x) - cut]
    return x.iloc[order].mean(axis=0)


def join(a: float, s: float) -> float:
    return max(sqrt(a**2 + s**2), a + (sqrt(2) - 1) * s)


def typical(x: pd.DataFrame, y: pd.DataFrame, rate: bool, level: float) -> tuple[float, float, float]:
    """The difference of the typical trainings with the ends of its interval."""
    lx, mx, ux = median_interval(x, level)
    ly, my, uy = median_interval(y, level)
    d = list(middle_half(x) - middle_half(y))
    E = len(d)
    if rate:  # two scenarios more, one that each side alone wins
        d += [1.0, -1.0]
        E += 2
    mean = sum(d) / E
    variance = sum((value - mean) ** 2 for value in d) / (E if rate else E - 1)
    s = stats.t.isf(level / 2, len(x.columns) - 1) * sqrt(variance / E)
    low, high = join(sqrt((mx - lx) ** 2 + (uy - my) ** 2), s), join(sqrt((ux - mx) ** 2 + (my - ly) ** 2), s)
    return mx - my, mx - my - low, mx - my + high


def p_value(x: pd.DataFrame, y: pd.DataFrame, rate: bool) -> float:
    """The level at which an end of the interval of the typical difference is 0."""
    value = typical(x, y, rate, 0.05)[0]

    def nearer(log_level: float) -> float:
        _, low, high = typical(x, y, rate, np.exp(log_level))
        return low if value > 0 else -high

    return 1.0 if nearer(0.0) <= 0 else float(np.exp(brentq(nearer, -60, 0.0, xtol=1e-14)))


def controllers(x: pd.DataFrame, y: pd.DataFrame, rate: bool, level: float) -> tuple[float, float, float]:
    """The same of two single runs, scenario by scenario."""
    a, b = pieces(x, rate), pieces(y, rate)
    d, n = a.mean - b.mean, len(a.columns)
    covariance = float(np.cov(a.columns, b.columns)[0, 1]) / n
    if not rate:
        half = stats.t.isf(level / 2, n - 1) * sqrt(max(a.b + b.b - 2 * covariance, 0.0))
        return d, d - half, d + half
    z = stats.norm.isf(level / 2)
    (l1, u1), (l2, u2) = wilson(a.mean, n, z), wilson(b.mean, n, z)
    covariance = max(covariance - 1 / (2 * n * (n - 1)), 0.0) if covariance > 0 else covariance
    r = min(max(covariance / sqrt(a.b * b.b), -1.0), 1.0)
    down, up, down2, up2 = a.mean - l1, u1 - a.mean, b.mean - l2, u2 - b.mean
    below = sqrt(max(down**2 - 2 * r * down * up2 + up2**2, 0.0))
    above = sqrt(max(up**2 - 2 * r * up * down2 + down2**2, 0.0))
    return d, d - below, d + above


def p_of_controllers(x: pd.DataFrame, y: pd.DataFrame, rate: bool) -> float:
    return mcnemar(x.iloc[0], y.iloc[0]) if rate else float(stats.ttest_rel(x.iloc[0], y.iloc[0]).pvalue)


def compare(
    one: Plain, other: Plain, measure: str, level: float, least: float, most: float
) -> tuple[float, float, float, float]:
    """Difference of two agents with its interval at 1 - level, and the p-value of none."""
    x, y, rate = getattr(one, measure), getattr(other, measure), measure == "success"
    if max(one.seeds, other.seeds) > 1:
        (d, low, high), p = typical(x, y, rate, level), p_value(x, y, rate)
    else:
        (d, low, high), p = controllers(x, y, rate, level), p_of_controllers(x, y, rate)
    return d, max(low, least - most), min(high, most - least), p


def wilson(p: float, n: float, z: float) -> tuple[float, float]:
    centre, half = p + z**2 / (2 * n), z * sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
    return max((centre - half) / (1 + z**2 / n), 0.0), min((centre + half) / (1 + z**2 / n), 1.0)


def not_behind(x: pd.DataFrame, baseline: float, margin: float, higher: bool) -> tuple[int, float, float]:
    """Trainings that are not worse than a value by more than the margin, with Clopper and Pearson's limits."""
    n = len(x)
    k = sum((mean - baseline if higher else baseline - mean) >= -margin for mean in x.mean(axis=1))
    exact = stats.binomtest(k, n).proportion_ci(0.95, method="exact")
    return k, exact.low, exact.high


def mcnemar(x: pd.Series, y: pd.Series) -> float:
    """Mid-p on the discordant scenarios."""
    b, c = int(((x == 1) & (y == 0)).sum()), int(((x == 0) & (y == 1)).sum())
    if b == c:
        return 1.0
    return float(2 * stats.binom.cdf(min(b, c), b + c, 0.5) - stats.binom.pmf(min(b, c), b + c, 0.5))


def holm(p: dict[tuple[str, str], float]) -> dict[tuple[str, str], float]:
    found, worst = {}, 0.0
    for place, (pair, value) in enumerate(sorted(p.items(), key=lambda item: item[1])):
        worst = max(worst, (len(p) - place) * value)
        found[pair] = min(worst, 1.0)
    return found


def score(agent: np.ndarray, random: float, pid: float) -> list[float]:
    """0 for random's mean, 1 for PID's: of each seed of an agent (seeds, episodes)."""
    return [(sum(row) / len(row) - random) / (pid - random) for row in agent.tolist()]


def interquartile_mean(values: list[float]) -> float:
    """The mean without the lowest and the highest quarter, as many as fit in a whole number."""
    cut = len(values) // 4
    kept = sorted(values)[cut : len(values) - cut]
    return sum(kept) / len(kept)


def bootstrap(
    tasks: list[tuple[np.ndarray, np.ndarray, np.ndarray]],
    counts: list[np.ndarray],
    picks: list[np.ndarray],
    tail: float,
) -> tuple[float, float]:
    """Ends of the interquartile mean over tasks (agent (S, E), random (E,), PID (E,)).

    `counts` are (resamples, E) how often each scenario was drawn, `picks` (resamples, S - 1) indices of trainings.
    """
    found = []
    for draw in range(len(picks[0])):
        values = []
        for (agent, random, pid), count, pick in zip(tasks, counts, picks, strict=True):
            drawn = np.repeat(np.arange(len(pid)), count[draw])
            zero, one = random[drawn].mean(), pid[drawn].mean()
            values += [(agent[seed][drawn].mean() - zero) / (one - zero) for seed in pick[draw]]
        found.append(interquartile_mean(values))
    low, high = np.quantile(found, [tail, 1 - tail])
    return float(low), float(high)
