"""Pure functions on arrays (seeds, episodes); docs/statistics-appendix.md has the reasons and the measurements.

`crossed` has means over seeds and scenarios, `differences` those of agents with the tests of all pairs, `intervals` those of
rates, `multiple` corrections, `power` plans.
"""

from auvbench.statistics.crossed import (
    EPISODES_ONLY,
    MIXED,
    SEEDS_AND_EPISODES,
    Crossed,
    crossed,
    means,
)
from auvbench.statistics.differences import contrast, pairs, resolution
from auvbench.statistics.intervals import (
    Estimate,
    limits,
    p_more_than_half,
    quantile,
    score_interval,
    succeeded,
    trials_that_bound,
    wilson,
)
from auvbench.statistics.multiple import discordant, holm, mcnemar

__all__ = [
    "EPISODES_ONLY",
    "MIXED",
    "SEEDS_AND_EPISODES",
    "Crossed",
    "Estimate",
    "contrast",
    "crossed",
    "discordant",
    "holm",
    "limits",
    "mcnemar",
    "means",
    "p_more_than_half",
    "pairs",
    "quantile",
    "resolution",
    "score_interval",
    "succeeded",
    "trials_that_bound",
    "wilson",
]
