"""Statistics of the report: pure functions on arrays (seeds, episodes); docs/statistics.md says why these.

`intervals` has Wilson's interval, `crossed` means over seeds and scenarios, `differences` those of agents,
`bootstrap` the resampling, `paired` tests and effect sizes between agents, `groups` the letters.
"""

from auvbench.reporting.statistics.bootstrap import (
    bca,
    hierarchical,
    iqm,
    mean,
    median,
    multiplicities,
    paired_means,
    percentile,
    seed_weights,
)
from auvbench.reporting.statistics.crossed import (
    EPISODES_ONLY,
    MIXED,
    SEEDS_AND_EPISODES,
    Crossed,
    crossed,
    means,
)
from auvbench.reporting.statistics.differences import Contrast, Pairs, contrast, pairs
from auvbench.reporting.statistics.groups import letter, letters, shared
from auvbench.reporting.statistics.intervals import quantile, score_interval, wilson
from auvbench.reporting.statistics.moderation import moderated
from auvbench.reporting.statistics.paired import (
    Profile,
    discordant,
    holm,
    improvement,
    improvement_matrix,
    mcnemar,
    performance_profile,
    probability_of_improvement,
    score,
    wins,
)

__all__ = [
    "EPISODES_ONLY",
    "MIXED",
    "SEEDS_AND_EPISODES",
    "Contrast",
    "Crossed",
    "Pairs",
    "Profile",
    "bca",
    "contrast",
    "crossed",
    "discordant",
    "hierarchical",
    "holm",
    "improvement",
    "improvement_matrix",
    "iqm",
    "letter",
    "letters",
    "mcnemar",
    "mean",
    "means",
    "median",
    "moderated",
    "multiplicities",
    "paired_means",
    "pairs",
    "percentile",
    "performance_profile",
    "probability_of_improvement",
    "quantile",
    "score",
    "score_interval",
    "seed_weights",
    "shared",
    "wilson",
    "wins",
]
