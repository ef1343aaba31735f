"""Pure functions on arrays (seeds, episodes); docs/statistics-appendix.md has the reasons and the measurements.

`crossed` has means over seeds and scenarios, `differences` those of agents with their tests and the correction for all pairs,
`intervals` those of rates, `power` plans.
"""

from auvbench.statistics.crossed import (
    EPISODES_ONLY,
    MIXED,
    SEEDS_AND_EPISODES,
    Crossed,
    crossed,
    means,
)
from auvbench.statistics.differences import contrast, holm, mcnemar, pairs, resolution
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

__all__ = [
    "EPISODES_ONLY",
    "MIXED",
    "SEEDS_AND_EPISODES",
    "Crossed",
    "Estimate",
    "contrast",
    "crossed",
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
