"""Few seeds per agent, many agents: what the others' seeds tell of how much seeds differ.

A variance of three seeds has two degrees of freedom, too few to resolve anything among many pairs. As in the
moderated t-test of genomics (Smyth 2004, Stat. Appl. Genet. Mol. Biol. 3:3; limma) each agent's variance between
seeds, in units of its residual variance, is shrunk towards a common value by as much as the agents agree on it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.special import digamma, polygamma

from auvbench.statistics.crossed import Crossed
from auvbench.statistics.intervals import FloatArray

ENOUGH_AGENTS = 4
"""with several seeds, before anything is borrowed"""


def moderated(table: Crossed) -> Crossed:
    """The table with cautiously moderated variances between seeds and their degrees of freedom.

    F = A / R is an agent's variance between seeds over what episodes alone would make it. With prior value F0 and
    degrees of freedom d0 from all agents' F (`prior`), limma's A is R (d0 F0 + d F) / (d0 + d) with d0 + d degrees
    of freedom. Two brakes, because seeds of some agents may truly differ more than those of others, which a dozen
    agents cannot tell for certain: A is never less than the agent's own, and only half of d0 is counted. Measured
    in docs/statistics.md. Agents with one seed, and tables with fewer than `ENOUGH_AGENTS` others, stay as they are.
    """
    several = (table.seeds > 1) & np.isfinite(table.between_seeds)
    residual = table.residual.copy()
    if table.rate:
        edge = several & np.isin(table.mean, (0.0, 1.0))
        residual[edge] = table.between_seeds[edge]  # that of the rate (x + 1)/(n + 2), see `crossed`
    use = several & (residual > 0)
    informative = use & (table.between_seeds > 0) & (table.residual > 0)
    if informative.sum() < ENOUGH_AGENTS:
        return table
    ratio = np.where(use, table.between_seeds / np.where(use, residual, 1.0), 0.0)
    f0, d0 = prior(ratio[informative], table.seeds_df[informative])
    d = np.where(use, table.seeds_df, 0.0)
    if np.isfinite(d0):
        shrunk, df = (d0 * f0 + d * ratio) / (d0 + d), d + d0 / 2
    else:  # then the common value is as good as all agents' seeds together
        shrunk, df = np.full_like(ratio, f0), (d + float(table.seeds_df[informative].sum())) / 2
    return replace(
        table,
        between_seeds=np.where(use, np.maximum(shrunk * residual, table.between_seeds), table.between_seeds),
        seeds_df=np.where(use, df, table.seeds_df),
    )


def prior(ratio: FloatArray, df: FloatArray) -> tuple[float, float]:
    """F0 and d0 from the ratios (n,) with df (n,): Smyth (2004), section 6.2, by the moments of log F.

    log F - digamma(d/2) + log(d/2) has the variance trigamma(d/2) + trigamma(d0/2); d0 is infinite where the
    ratios vary no more than trigamma(d/2) explains.
    """
    e = np.log(ratio) - digamma(df / 2) + np.log(df / 2)
    excess = float(e.var(ddof=1) - polygamma(1, df / 2).mean())
    if excess <= float(polygamma(1, 1e4)):
        return float(np.exp(e.mean())), np.inf
    from scipy.optimize import brentq  # a tenth of a second of imports that most reports do not need

    half = (
        brentq(lambda x: float(polygamma(1, x)) - excess, 1e-3, 1e4) if excess < polygamma(1, 1e-3) else 1e-3
    )
    return float(np.exp(e.mean() + digamma(half) - np.log(half))), 2 * float(half)
