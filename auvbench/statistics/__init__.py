"""Pure functions on arrays (seeds, episodes); docs/statistics-appendix.md has the reasons and the measurements.

`crossed` has means over seeds and scenarios, `differences` those of agents, `moderation` the variance between seeds that
every verdict uses, `resolution` tests of all pairs, `intervals` and `binomial` intervals of rates, `paired` tests and effect sizes between agents, `groups` the letters.
"""

from auvbench.statistics.binomial import limits, p_more_than_half, succeeded, trials_that_bound
from auvbench.statistics.crossed import (
    EPISODES_ONLY,
    MIXED,
    SEEDS_AND_EPISODES,
    Crossed,
    crossed,
    means,
)
from auvbench.statistics.differences import Contrast, Pairs, contrast, pairs
from auvbench.statistics.groups import letter, letters
from auvbench.statistics.intervals import Estimate, quantile, score_interval, wilson
from auvbench.statistics.paired import (
    discordant,
    holm,
    mcnemar,
    probability_of_improvement,
)
from auvbench.statistics.resolution import resolution

__all__ = [
    "EPISODES_ONLY",
    "MIXED",
    "SEEDS_AND_EPISODES",
    "Contrast",
    "Crossed",
    "Estimate",
    "Pairs",
    "contrast",
    "crossed",
    "discordant",
    "holm",
    "letter",
    "letters",
    "limits",
    "mcnemar",
    "means",
    "p_more_than_half",
    "pairs",
    "probability_of_improvement",
    "quantile",
    "resolution",
    "score_interval",
    "succeeded",
    "trials_that_bound",
    "wilson",
]
