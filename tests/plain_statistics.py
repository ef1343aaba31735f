"""The table once more from the CSV files, with pandas and scipy alone: nothing here imports auvbench.

Formulas as docs/statistics-appendix.md states them, loop by loop and without regard to speed: what the report prints must agree
with this to 1e-12.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
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


RATIO_OF_RATES, RATIO_OF_MEANS, PRIOR_DF = 0.13, 0.2, 3.0
"""the prior of docs/statistics-appendix.md"""


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


def squeezed(p: Pieces) -> Pieces:
    """A towards the prior: a share of the variance of an episode, with three degrees of freedom."""
    if p.seeds == 1 or p.r == 0:
        return p
    ratio = RATIO_OF_RATES if p.rate else RATIO_OF_MEANS
    of_a_seed = p.a * p.seeds
    prior = ratio**2 * p.r * p.seeds * len(p.columns)
    between = (PRIOR_DF * prior + p.df * of_a_seed) / (PRIOR_DF + p.df)
    df = p.df + 1 / (1 / PRIOR_DF + 1 / p.df)
    return replace(p, a=max(between, of_a_seed) / p.seeds, df=df)


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


def p_value(first: Pieces, second: Pieces) -> float:
    """Where the interval of the difference would just touch zero."""
    a, df, c, dfc = spread_of(first, second)
    difference = abs(first.mean - second.mean)
    if difference == 0:
        return 1.0

    def excess(log_p: float) -> float:
        return half_width(a, df, c, dfc, np.exp(log_p) / 2) - difference

    return float(np.exp(brentq(excess, -600, np.log(1 - 1e-15), xtol=1e-15, rtol=1e-15)))


def on_log_odds(x: pd.DataFrame, p: Pieces, least: float, most: float) -> Pieces:
    """The pieces on log(f / (1 - f)), with what the seeds' own log-odds and the skew of their mean add."""
    S, E = x.shape
    n, span = S * E, most - least
    f = ((p.mean - least) / span * n + 0.5) / (n + 1)
    s = 1 / (f * (1 - f)) / span
    each = [((m - least) / span * E + 0.5) / (E + 1) for m in x.mean(axis=1)]
    a = s**2 * p.a if S == 1 else max(s**2 * p.a, np.var([log(g / (1 - g)) for g in each], ddof=1) / S)
    found = squeezed(
        replace(p, mean=log(f / (1 - f)), a=a, b=s**2 * p.b, r=s**2 * p.r, columns=s * p.columns)
    )
    if S == 1:
        return found
    if p.mean in (least, most):
        return replace(found, df=np.inf)
    return replace(found, a=found.a + (1 - 2 * f) ** 2 * (found.a * S) ** 2 / (2 * found.df))


def resolution(agents: list[Plain], measure: str, least: float, most: float) -> dict[tuple[str, str], float]:
    """P-values of all pairs on the measure's own scale and on that of the log-odds: the larger one."""
    rate = measure == "success"
    seeds = [agent.seeds for agent in agents]
    data = [getattr(agent, measure) for agent in agents]
    plain = [pieces(x, rate) for x in data]
    own = [squeezed(p) for p in plain]
    odds = [on_log_odds(x, p, least, most) for x, p in zip(data, plain, strict=True)]
    found = {}
    for i, j in combinations(range(len(agents)), 2):
        p = p_value(own[i], own[j])
        if max(seeds[i], seeds[j]) > 1:
            p = max(p, p_value(odds[i], odds[j]))
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
    """Intervals of all differences, each pair by itself, variances between seeds squeezed."""
    rate, tail = measure == "success", (1 - confidence) / 2
    seeds = [agent.seeds for agent in agents]
    own = [pieces(getattr(agent, measure), rate) for agent in agents]
    raised = [squeezed(p) for p in own]
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


def score(agent: np.ndarray, random: float, pid: float) -> list[float]:
    """0 for random's mean, 1 for PID's: of each seed of an agent (seeds, episodes)."""
    return [(sum(row) / len(row) - random) / (pid - random) for row in agent.tolist()]


def interquartile_mean(values: list[float]) -> float:
    """The mean without the lowest and the highest quarter, as many as fit in a whole number."""
    cut = len(values) // 4
    kept = sorted(values)[cut : len(values) - cut]
    return sum(kept) / len(kept)


def bootstrap(strata: list[list[list[float]]], picks: list[np.ndarray], tail: float) -> tuple[float, float]:
    """Ends of the interquartile mean: `picks` are (resamples, seeds - 1) indices of seeds for each stratum."""
    found = []
    for draw in range(len(picks[0])):
        values = [
            value
            for rows, pick in zip(strata, picks, strict=True)
            for seed in pick[draw]
            for value in rows[seed]
        ]
        found.append(interquartile_mean(values))
    low, high = np.quantile(found, [tail, 1 - tail])
    return float(low), float(high)
