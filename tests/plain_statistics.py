"""The table once more from the CSV files, with pandas and scipy alone: nothing here imports auvbench.

Formulas as docs/statistics.md states them, loop by loop and without regard to speed: what the report prints must agree
with this to 1e-12.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from itertools import combinations
from math import log, sqrt
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
    return Pieces(mean, a, S - 1 if S > 1 else np.inf, b, r, scenarios.to_numpy())


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


def pooled(table: list[Pieces], seeds: list[int], assumed: tuple[bool, ...] = ()) -> list[Pieces]:
    """A no smaller than the average variance of a seed over the agents with several, divided by the seeds.

    An A that is `assumed`, for no failure or no success was seen, has all degrees of freedom, too.
    """
    several = [i for i, S in enumerate(seeds) if S > 1]
    if not several:
        return table
    freedom = sum(seeds[i] - 1 for i in several)
    average = sum((seeds[i] - 1) * seeds[i] * table[i].a for i in several) / freedom
    found = []
    for p, S, stand_in in zip(table, seeds, assumed or (False,) * len(seeds), strict=True):
        raised = S > 1 and p.a < average / S
        if raised or (stand_in and S > 1):
            p = Pieces(p.mean, average / S if raised else p.a, freedom, p.b, p.r, p.columns)
        found.append(p)
    return found


def p_value(first: Pieces, second: Pieces, slopes: tuple[float, float], values: tuple[float, float]) -> float:
    """Where the interval of the difference of `values` would just touch zero."""
    one, other = slopes
    a = one**2 * first.a + other**2 * second.a
    squares = sum(
        (s**2 * p.a) ** 2 / p.df for s, p in ((one, first), (other, second)) if np.isfinite(p.df) and p.a > 0
    )
    df = a**2 / squares if a > 0 else np.inf
    E = len(first.columns)
    shared = float(np.cov(first.columns, second.columns)[0, 1]) / E
    noise = one**2 * first.r + other**2 * second.r
    c = max(one**2 * first.b + other**2 * second.b - 2 * one * other * shared - noise, 0.0)
    difference = abs(values[0] - values[1])
    if difference == 0:
        return 1.0

    def excess(log_p: float) -> float:
        return half_width(a, df, c, E - 1, np.exp(log_p) / 2) - difference

    return float(np.exp(brentq(excess, -600, np.log(1 - 1e-15), xtol=1e-15, rtol=1e-15)))


def resolution(agents: list[Plain], measure: str, least: float, most: float) -> dict[tuple[str, str], float]:
    """P-values of all pairs on the measure's own scale and on that of the log-odds: the larger one."""
    rate = measure == "success"
    seeds = [agent.seeds for agent in agents]
    plain = [pieces(getattr(agent, measure), rate) for agent in agents]
    own = pooled(plain, seeds)
    shares = []
    for agent, p in zip(agents, plain, strict=True):
        n = agent.success.size
        shares.append(((p.mean - least) / (most - least) * n + 0.5) / (n + 1))
    slope = [1 / (f * (1 - f)) / (most - least) for f in shares]
    on_odds = [
        Pieces(log(f / (1 - f)), s**2 * p.a, p.df, s**2 * p.b, s**2 * p.r, s * p.columns)
        for f, s, p in zip(shares, slope, plain, strict=True)
    ]
    odds = pooled(on_odds, seeds, tuple(p.mean in (least, most) for p in plain))
    found = {}
    for i, j in combinations(range(len(agents)), 2):
        p = p_value(own[i], own[j], (1.0, 1.0), (own[i].mean, own[j].mean))
        if max(seeds[i], seeds[j]) > 1:
            p = max(p, p_value(odds[i], odds[j], (1.0, 1.0), (odds[i].mean, odds[j].mean)))
        elif rate:
            p = mcnemar(agents[i].success.iloc[0], agents[j].success.iloc[0])
        found[agents[i].name, agents[j].name] = p
    return found


def spread_of(first: Pieces, second: Pieces) -> tuple[float, float, float, int]:
    """Of a difference: variance between seeds with Welch's degrees of freedom, that of scenarios with its own."""
    a = first.a + second.a
    squares = sum(p.a**2 / p.df for p in (first, second) if np.isfinite(p.df) and p.a > 0)
    E = len(first.columns)
    shared = float(np.cov(first.columns, second.columns)[0, 1]) / E
    c = max(first.b + second.b - 2 * shared - first.r - second.r, 0.0)
    return a, a**2 / squares if a > 0 else np.inf, c, E - 1


def wilson(p: float, n: float, z: float) -> tuple[float, float]:
    centre, half = p + z**2 / (2 * n), z * sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
    return max((centre - half) / (1 + z**2 / n), 0.0), min((centre + half) / (1 + z**2 / n), 1.0)


def differences(
    agents: list[Plain], measure: str, confidence: float, least: float, most: float
) -> dict[tuple[str, str], tuple[float, float]]:
    """Intervals of all differences, each pair by itself, variances between seeds pooled upwards."""
    rate, tail = measure == "success", (1 - confidence) / 2
    seeds = [agent.seeds for agent in agents]
    own = [pieces(getattr(agent, measure), rate) for agent in agents]
    raised = pooled(own, seeds)
    found = {}
    for i, j in combinations(range(len(agents)), 2):
        d = own[i].mean - own[j].mean
        a, df, c, dfc = spread_of(raised[i], raised[j])
        half = half_width(a, df, c, dfc, tail)
        low, high = d - half, d + half
        if rate:
            single = max(seeds[i], seeds[j]) == 1
            z = stats.norm.isf(tail) if single else half / sqrt(a + c)
            ends = []
            for k in (i, j):
                p, S = own[k], seeds[k]
                E, variance = len(p.columns), p.a + max(p.b - p.r, 0.0)
                n = E if S == 1 else S * E
                if S > 1 and p.mean not in (0.0, 1.0):
                    n = min(p.mean * (1 - p.mean) / variance, n)
                ends.append(wilson(p.mean, n, z))
                if S > 1:
                    reach = z * sqrt(raised[k].a + max(raised[k].b - raised[k].r, 0.0))
                    ends[-1] = (
                        max(min(ends[-1][0], p.mean - reach), 0.0),
                        min(max(ends[-1][1], p.mean + reach), 1.0),
                    )
            (l1, u1), (l2, u2) = ends
            shared = float(np.cov(own[i].columns, own[j].columns)[0, 1]) / len(own[i].columns)
            if single and shared > 0:
                n = len(own[i].columns)
                shared = max(shared - 1 / (2 * n * (n - 1)), 0.0)
            variances = [p.a + max(p.b - p.r, 0.0) for p in (own[i], own[j])]
            r = min(max(shared / sqrt(variances[0] * variances[1]), -1.0), 1.0)
            down, up = own[i].mean - l1, u1 - own[i].mean
            down2, up2 = own[j].mean - l2, u2 - own[j].mean
            least_ = d - sqrt(max(down**2 - 2 * r * down * up2 + up2**2, 0.0))
            most_ = d + sqrt(max(up**2 - 2 * r * up * down2 + down2**2, 0.0))
            if single:
                low, high = least_, most_
            else:
                low, high = min(least_, max(low, l1 - u2)), max(most_, min(high, u1 - l2))
        found[agents[i].name, agents[j].name] = max(low, least - most), min(high, most - least)
    return found


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
