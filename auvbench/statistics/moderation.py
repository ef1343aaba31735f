"""The variance between training seeds that every verdict uses: an agent's own, squeezed towards a fixed prior.

Few seeds may agree by chance, so a test of their own variance alone finds little and errs where trainings differ
wildly. limma squeezes each variance towards a prior that it estimates from the other rows of the table (Smyth 2004,
Stat. Appl. Genet. Mol. Biol. 3:3; Phipson et al. 2016, Ann. Appl. Stat. 10:946). Then a verdict depends on rows that it
does not name. Here the prior is declared once, in units of each agent's own spread of episodes. It has no parameter of
the table, so dropping a row changes no p-value. docs/statistics-appendix.md has the measurements behind the numbers.
"""

from __future__ import annotations

import numpy as np

from auvbench.statistics.crossed import Crossed
from auvbench.statistics.intervals import FloatArray

RATIO_OF_RATES = 0.13
"""prior standard deviation between trainings, in residual standard deviations of an episode: success and other rates"""
RATIO_OF_MEANS = 0.2
"""the same for all other measures"""
PRIOR_DF = 3.0
"""degrees of freedom of the prior in the squeezed variance"""


def freedom(df: FloatArray) -> FloatArray:
    """Return the degrees of freedom of a squeezed variance.

    The prior adds the harmonic d d0 / (d + d0), always less than either: two seeds borrow less than ten. limma's full
    d0 leads to false verdicts where rows differ in their true variances.
    """
    return np.asarray(np.where(np.isinf(df), df, df + PRIOR_DF / (1 + PRIOR_DF / np.where(df > 0, df, 1.0))))


def seed_variance(table: Crossed) -> tuple[FloatArray, FloatArray]:
    """Return what training seeds add to the variance of each mean (n,), and its degrees of freedom (n,).

    With d degrees of freedom, own variance s² and prior s0² it is max(s², (d0 s0² + d s²) / (d0 + d)) / S: an outlier
    keeps its own, and so does a row without residual, which gives the prior no unit. Rows of one seed stay at 0. The
    table's arrays may have leading axes.
    """
    several = table.seeds > 1
    ratio = RATIO_OF_RATES if table.rate else RATIO_OF_MEANS
    df = np.where(several, table.seeds_df, 1.0)
    # The residual is over S E values: times E it is the variance of an episode over S.
    prior = ratio**2 * table.residual * table.episodes
    squeezed = (PRIOR_DF * prior + df * table.between_seeds) / (PRIOR_DF + df)
    between = np.where(several, np.fmax(squeezed, table.between_seeds), table.between_seeds)
    return between, np.where(several & (prior > 0), freedom(df), table.seeds_df)
