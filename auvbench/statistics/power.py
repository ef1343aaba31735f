"""Compute how many seeds and episodes are needed to detect a difference, by simulating the statistical test of a report.

Each replication draws test results of two agents whose true values differ by the difference to detect. The
model of trainings comes from existing runs (`spread_of_rates`, `spread_of_means`) or from the command line.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import expit, logit, ndtr, ndtri

from auvbench.statistics import typical
from auvbench.statistics.crossed import crossed
from auvbench.statistics.intervals import FloatArray

_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(60)
_WEIGHTS = _WEIGHTS / _WEIGHTS.sum()
MOST_SEEDS = 128
"""largest number of seeds that a plan tries"""


@dataclass(frozen=True, slots=True)
class Rates:
    """Model of success: the rates of trainings are logit-normal, and a scenario is equally hard for all agents.

    A training's rate over all scenarios is expit(m + sd z) with z from a standard normal distribution, so the
    typical training's rate is expit(m). In a scenario with the effect b, also standard normal, the rate is
    Phi(Phi^-1(rate) sqrt(1 + scenario_sd^2) + scenario_sd b). The mean of this rate over b is the training's rate.
    """

    sd: float
    """standard deviation between training seeds, in logits"""
    scenario_sd: float = 1.0
    """standard deviation between scenarios, in probits"""
    rate: bool = True

    def draw(
        self,
        values: Sequence[float],
        S: int,
        E: int,
        rng: np.random.Generator,
        controllers: Sequence[bool] = (),
    ) -> list[FloatArray]:
        """Return simulated successes of agents, each (S, E) with 1 for success and 0 for failure.

        `values` are the rates of the agents' typical trainings. The columns are the same E scenarios for all
        agents. Agents marked in `controllers` have one run, (1, E).
        """
        hard = self.scenario_sd * rng.normal(size=E)
        drawn = []
        for value, single_run in zip(values, controllers or [False] * len(values), strict=True):
            luck = np.zeros((1, 1)) if single_run else self.sd * rng.normal(size=(S, 1))
            trained = np.clip(expit(logit(value) + luck), 1e-12, 1 - 1e-12)
            chance = ndtr(ndtri(trained) * np.sqrt(1 + self.scenario_sd**2) + hard)
            drawn.append((rng.random((len(luck), E)) < chance).astype(np.float64))
        return drawn


@dataclass(frozen=True, slots=True)
class Means:
    """Model of a measure that is not a rate, such as steps: the sum of normal effects of seeds and scenarios, and of residuals.

    A scenario has the same effect on all agents.
    """

    sd: float
    """standard deviation between training seeds, in the measure's unit"""
    scenario_sd: float
    residual_sd: float
    rate: bool = False

    def draw(
        self,
        values: Sequence[float],
        S: int,
        E: int,
        rng: np.random.Generator,
        controllers: Sequence[bool] = (),
    ) -> list[FloatArray]:
        """Return simulated values of agents with the true means `values`, in arrays like those of `Rates.draw`."""
        hard = self.scenario_sd * rng.normal(size=E)
        drawn = []
        for value, single_run in zip(values, controllers or [False] * len(values), strict=True):
            luck = np.zeros((1, 1)) if single_run else self.sd * rng.normal(size=(S, 1))
            drawn.append(value + luck + hard + self.residual_sd * rng.normal(size=(len(luck), E)))
        return drawn


Model = Rates | Means
"""model from which agents are simulated"""


@dataclass(frozen=True, slots=True)
class SeedSpread:
    """Standard deviation between trainings of one configuration, estimated from agents with several seeds."""

    sd: float
    df: float
    """degrees of freedom: number of seeds minus one, summed over agents"""
    variances: tuple[tuple[float, float, int], ...] = ()
    """Three numbers per agent: the variance between seeds, the part of this variance that comes from the random outcomes of episodes,
    and the degrees of freedom; empty for means"""

    def upper(self, confidence: float = 0.9) -> float:
        """Return the upper confidence limit of the standard deviation, if trainings are normally distributed.

        Without `variances`, this is the chi-squared limit. With `variances`, it is the Q-profile limit (Viechtbauer
        2007, Stat. Med. 26:37): the standard deviation at which variances as small as the agents' variances have the
        probability 1 - confidence.
        """
        from scipy.stats import chi2  # imported late: takes half a second, and most commands do not need it

        quantile = float(chi2.ppf(1 - confidence, self.df))
        if self.variances:
            return float(np.sqrt(_profiled(self.variances, quantile)))
        return float(self.sd * np.sqrt(self.df / quantile))


def _profiled(variances: Sequence[tuple[float, float, int]], q: float) -> float:
    """Return the variance v >= 0 between trainings at which the agents' Q statistic is `q`.

    Q is the sum of df * variance / (noise + v) over the agents (variance, noise, df).
    """

    def excess(between: float) -> float:
        return sum(df * variance / (noise + between) for variance, noise, df in variances) - q

    if excess(0.0) <= 0.0:
        return 0.0
    from scipy.optimize import brentq  # imported late: takes half a second, and most commands do not need it

    return float(brentq(excess, 0.0, 1.0 + 2.0 * sum(df * variance for variance, _, df in variances) / q))


def spread_of_rates(data: Sequence[FloatArray]) -> tuple[SeedSpread, float]:
    """Return the spread between seeds, in logits, and the standard deviation between scenarios, in probits.

    Seeds: the variance of the empirical logits log((x + 1/2)/(E - x + 1/2)) of x successes in E episodes, minus the
    part due to the random outcomes of episodes, 1/(x + 1/2) + 1/(E - x + 1/2). Agents are weighted by how
    precisely their variance is known (Paule & Mandel 1982, J. Res. Natl. Bur. Stand. 87:377): an agent that
    never failed has almost no weight. Agents with one seed do not contribute.

    Scenarios: the standard deviation, from 0 to 10, at which the rates of the model's scenarios have the
    observed variance. It is 1 if no agent with several seeds and several episodes has a rate between 2 and 98 %.

    Args:
        data: successes (S_i, E) of each agent, 0 or 1.

    Raises:
        ValueError: no agent has several seeds.
    """
    variances: list[tuple[float, float, int]] = []
    shares = []
    for x in data:
        S, E = x.shape
        if S < 2:
            continue
        good = x.sum(axis=1) + 0.5
        bad = E - x.sum(axis=1) + 0.5
        variances.append((float(np.log(good / bad).var(ddof=1)), float((1 / good + 1 / bad).mean()), S - 1))
        p = float(x.mean())
        if E > 1 and 0.02 < p < 0.98:
            table = crossed([x], rate=True)
            shares.append((p, max(float(table.between_scenarios[0, 0] - table.residual[0]), 0.0) * E))
    if not variances:
        raise ValueError("no agent has several seeds")
    df = sum(freedom for *_, freedom in variances)
    return SeedSpread(float(np.sqrt(_profiled(variances, df))), df, tuple(variances)), _scenario_sd(shares)


def _scenario_sd(shares: Sequence[tuple[float, float]]) -> float:
    if not shares:
        return 1.0
    observed = float(np.mean([variance for _, variance in shares]))

    def excess(sd: float) -> float:
        model = 0.0
        for p, _ in shares:
            chance = ndtr(ndtri(p) * np.sqrt(1 + sd**2) + sd * _NODES)
            model += float(_WEIGHTS @ chance**2) - p**2
        return model / len(shares) - observed

    if excess(0.01) >= 0:
        return 0.0
    if excess(10.0) <= 0:
        return 10.0
    from scipy.optimize import brentq  # imported late, as above

    return float(brentq(excess, 0.01, 10.0))


def spread_of_means(data: Sequence[FloatArray]) -> tuple[SeedSpread, float, float]:
    """Return the spread between seeds and the standard deviations between scenarios and of the residuals.

    The three standard deviations are pooled over agents. Agents with one seed, one episode or a missing value do not
    contribute.

    Args:
        data: values (S_i, E) of each agent, in the measure's unit.

    Raises:
        ValueError: no agent has several seeds, several episodes and a value for each episode.
    """
    seeds, scenarios, residuals, df = 0.0, 0.0, 0.0, 0
    for x in data:
        S, E = x.shape
        if S < 2 or E < 2 or not np.isfinite(x).all():
            continue
        table = crossed([x])
        residual = float(table.residual[0])
        seeds += (S - 1) * S * (float(table.between_seeds[0]) - residual)
        scenarios += (S - 1) * E * (float(table.between_scenarios[0, 0]) - residual)
        residuals += (S - 1) * S * E * residual
        df += S - 1
    if not df:
        raise ValueError("no agent has several seeds, several episodes and a value for each episode")
    deviations = [float(np.sqrt(max(part / df, 0.0))) for part in (seeds, scenarios, residuals)]
    return SeedSpread(deviations[0], df), deviations[1], deviations[2]


def simulated_power(
    model: Model,
    values: tuple[float, float],
    S: int,
    E: int,
    levels: Sequence[float],
    *,
    against_controller: bool = True,
    replications: int = 200,
    seed: int = 0,
) -> FloatArray:
    """Return the power at each level, (len(levels),): the share of simulated comparisons that find the difference with
    the right sign.

    In a comparison of rates with a controller, either of the two values may belong to the learner. Both cases are
    simulated, and the lower power is returned.

    Args:
        model: model of trainings.
        values: true values of two typical trainings, or of a controller and a typical training.
        S: number of trainings of each learner.
        E: number of test episodes of each training.
        levels: error rates of the interval, after any correction.
        against_controller: whether one of the two agents is a controller.
        replications: number of simulated comparisons.
        seed: seed of the simulation.
    """
    sides = (
        ((True, False), (False, True))
        if against_controller and model.rate
        else ((against_controller, False),)
    )
    power = np.ones(len(levels))
    for place, controllers in enumerate(sides):
        rng = np.random.default_rng([seed, S, E, place])
        right = np.zeros(len(levels))
        for _ in range(replications):
            first, second = (typical.sample(x) for x in model.draw(values, S, E, rng, controllers))
            low, high = typical.difference(second, first, model.rate).ends(np.asarray(levels))
            right += (low > 0) if values[1] > values[0] else (high < 0)
        power = np.minimum(power, right / replications)
    return power


def seeds_needed(tried: Callable[[int], float], target: float, most: int = MOST_SEEDS) -> int | None:
    """Return the smallest number of seeds, from 2 to `most`, at which the power reaches the target.

    Return None if no number reaches it.

    The search doubles the number of seeds, then bisects. It assumes that power rises with the number of seeds.

    Args:
        tried: function that returns the simulated power for a number of seeds.
        target: required power.
        most: largest number of seeds to try.
    """
    low, high = 1, 2
    while tried(high) < target:
        if high >= most:
            return None
        low, high = high, min(2 * high, most)
    while high - low > 1:
        middle = (low + high) // 2
        if tried(middle) >= target:
            high = middle
        else:
            low = middle
    return high


RESAMPLES = 200
"""number of simulated comparisons for each number of trainings that `trainings_that_decide` tries"""


def trainings_that_decide(
    gains: FloatArray,
    baseline: FloatArray,
    error: float,
    t: float,
    level: float,
    margin: float,
    *,
    power: float,
    above: int,
) -> int | None:
    """Return the number of trainings of each learner that decides an open comparison with the required power.

    Args:
        gains: (n,) values of the agent's trainings, higher is better; one value for a controller.
        baseline: (m,) values of the baseline's trainings.
        error: standard error of the difference due to the scenarios.
        t: quantile of Student's t that multiplies `error`.
        level: error rate of the interval.
        margin: margin of equivalence; an interval inside -margin .. margin also decides the comparison. NaN: no margin.
        power: required share of decided comparisons.
        above: number of existing trainings, with which the comparison is still open.

    Returns:
        A number larger than `above` and at least `typical.FEWEST`; None if more than `MOST_SEEDS` trainings are needed.
    """

    def decided(S: int) -> float:
        rng = np.random.default_rng(S)
        samples = [x if len(x) == 1 else rng.choice(x, (RESAMPLES, S)) for x in (gains, baseline)]
        (l1, m1, u1), (l2, m2, u2) = (typical.median_interval(x, level) for x in samples)
        value = m1 - m2 + error * rng.normal(size=RESAMPLES)
        low = value - typical.join(np.hypot(m1 - l1, u2 - m2), t * error)
        high = value + typical.join(np.hypot(u1 - m1, m2 - l2), t * error)
        decides = (low > 0) | (high < 0) | ((low > -margin) & (high < margin))
        return float(decides.mean())

    least = max(above + 1, typical.FEWEST)
    trainings = seeds_needed(lambda S: decided(max(S, least)), power) if least <= MOST_SEEDS else None
    return None if trainings is None else max(trainings, least)
