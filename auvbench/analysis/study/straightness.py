"""Claim 6: whether path straightness and step count correlate over agents, given how often they fail."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from auvbench.analysis.effects import learns
from auvbench.analysis.formatting import counted
from auvbench.analysis.measures import measure
from auvbench.analysis.records import Agent
from auvbench.analysis.study import thesis
from auvbench.analysis.study.evidence import FACTORS, Evidence
from auvbench.analysis.study.verdict import FAILS, HOLDS, OPEN, Part, learned, runs_of
from auvbench.statistics import quantile
from auvbench.statistics.intervals import Estimate, FloatArray

WEAK = 0.5
"""rank correlations within ± this do not count as one"""
FEWEST_AGENTS = 5
"""points of a correlation"""


def straightness_and_steps(e: Evidence) -> list[Part]:
    """6: over the agents that learned something, straightness and steps do not correlate at equal failure rates.

    A failed episode is long and crooked, so both rank with the failure rate. Judged is the partial rank correlation of
    mean deviation and mean steps given the failure rate: it holds within ±0.5, and fails if its interval excludes 0.
    """
    trained = [agent for agent in e.agents if learns(agent)]
    agents = [agent for agent in trained if learned(agent)]
    columns = (("mean_deviation_mean_m", "deviation_mean_m"), ("mean_steps", "steps"))
    deviation, steps = (
        np.array(
            [
                np.nanmean(measure(m).values(agent)) if agent.metrics.get(c) is not None else np.nan
                for agent in agents
            ]
        )
        for m, c in columns
    )
    failing = np.array([1 - float(agent.success.mean()) for agent in agents])
    there = np.isfinite(deviation) & np.isfinite(steps)
    nothing = len(trained) - len(agents)
    left = f"; {counted(nothing, 'agent')} left out: learned nothing" if nothing else ""
    theirs = partial_rank_correlation(*study_points(), len(study_points()[0]), e.confidence)
    besides = f"on the original study's own ten agents {_rho(theirs)}"
    if there.sum() < FEWEST_AGENTS:
        missing = (
            f"{FEWEST_AGENTS} agents that learned something, with both measures (here {int(there.sum())})"
        )
        return [Part(OPEN, f"{besides}{left}", missing)]
    used = [agent for agent, ok in zip(agents, there, strict=True) if ok]
    n = independent(used)
    found = partial_rank_correlation(deviation[there], steps[there], failing[there], n, e.confidence)
    inside = found.low > -WEAK and found.high < WEAK
    verdict = HOLDS if inside else FAILS if found.low > 0 or found.high < 0 else OPEN
    missing = "more agents: the interval is wider than what counts as none" if verdict == OPEN else ""
    statistic = (
        f"Spearman's rho given the failure rate {_rho(found)} over {len(used)} agents that count as {n} independent "
        f"ones, none means within ±{WEAK:g} ({besides}){left}"
    )
    return [Part(verdict, statistic, missing, runs_of([tuple(used)]))]


def independent(agents: Sequence[Agent]) -> int:
    """Return how many of the agents are independent: cells of a crossed grid share the effects of their levels.

    One, and one for each further level of each factor: the parameters of the grid's main effects.
    """
    levels = [{agent.key.get(factor) for agent in agents} for factor in FACTORS]
    return min(len(agents), 1 + sum(len(found) - 1 for found in levels))


def study_points() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return mean deviation, mean steps and failure rate of the original study's agents that have all three."""
    names = [a for a in thesis.AGENTS if a in thesis.TABLE["mean_steps"]]
    deviation, steps, success = (
        np.array([thesis.TABLE[m][a].value for a in names])
        for m in ("mean_deviation_mean_m", "mean_steps", "success_rate")
    )
    return deviation, steps, 1 - success / 100


def partial_rank_correlation(
    x: FloatArray, y: FloatArray, given: FloatArray, n: int, confidence: float
) -> Estimate:
    """Return Spearman's rho of x and y given a third variable, with an interval for n independent points.

    The interval is that of Bonett & Wright (2000, Psychometrika 65:23), tanh(atanh rho ± z sqrt((1 + rho²/2) / (n - 3))),
    with one point less for the third variable. A third variable without ranks changes nothing. The interval is
    [-1, 1] where rho is undefined or n leaves no freedom.
    """
    from scipy.stats import rankdata  # half a second of imports that most reports do not need

    ranks = [rankdata(values) for values in (x, y, given)]
    if min(np.ptp(rank) for rank in ranks[:2]) == 0:
        return Estimate(0.0, -1.0, 1.0, confidence, "agents")
    rho, free = float(np.corrcoef(ranks[0], ranks[1])[0, 1]), n - 3
    if np.ptp(ranks[2]) > 0:
        to_given = [float(np.corrcoef(rank, ranks[2])[0, 1]) for rank in ranks[:2]]
        left = np.sqrt((1 - to_given[0] ** 2) * (1 - to_given[1] ** 2))
        if left < 1e-6:  # the third variable orders one of them by itself
            return Estimate(0.0, -1.0, 1.0, confidence, "agents")
        rho, free = (rho - to_given[0] * to_given[1]) / left, n - 4
    if free <= 0:
        return Estimate(rho, -1.0, 1.0, confidence, "agents")
    z = np.arctanh(np.clip(rho, -0.999999, 0.999999))
    half = float(quantile(confidence)) * np.sqrt((1 + rho**2 / 2) / free)
    return Estimate(rho, float(np.tanh(z - half)), float(np.tanh(z + half)), confidence, "agents")


def _rho(e: Estimate) -> str:
    return f"{e.value:.2f} [{e.low:.2f}, {e.high:.2f}]"
