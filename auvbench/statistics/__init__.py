"""Statistics as pure functions on arrays (seeds, episodes).

docs/statistics-appendix.md explains the choice of each method and has its measured error rates.

`crossed` computes means over seeds and scenarios; `typical` compares learners; `differences` compares
controllers and corrects for all pairs; `reliability` counts the trainings that are at most a margin worse than the baseline;
`intervals` has intervals of rates; `power` plans experiments.
"""

from auvbench.statistics.crossed import (
    EPISODES_ONLY,
    MIXED,
    SEEDS_AND_EPISODES,
    Crossed,
    crossed,
    means,
)
from auvbench.statistics.differences import holm, mcnemar, pairs
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
    "crossed",
    "holm",
    "limits",
    "mcnemar",
    "means",
    "p_more_than_half",
    "pairs",
    "quantile",
    "score_interval",
    "succeeded",
    "trials_that_bound",
    "wilson",
]
