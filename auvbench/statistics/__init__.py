"""Statistics: pure functions on arrays (seeds, episodes); docs/statistics.md says why these.

`intervals` has Wilson's interval, `crossed` means over seeds and scenarios, `differences` those of agents, `resolution` tests
of all pairs, `equivalence` whether differences are small, `bootstrap` the resampling, `paired` tests and effect sizes between agents, `groups` the letters.
"""

from auvbench.statistics.bootstrap import (
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
from auvbench.statistics.crossed import (
    EPISODES_ONLY,
    MIXED,
    SEEDS_AND_EPISODES,
    Crossed,
    crossed,
    means,
)
from auvbench.statistics.differences import Contrast, Pairs, contrast, pairs
from auvbench.statistics.equivalence import equivalence
from auvbench.statistics.estimate import Estimate
from auvbench.statistics.groups import letter, letters, shared
from auvbench.statistics.intervals import quantile, score_interval, wilson
from auvbench.statistics.paired import (
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
from auvbench.statistics.resolution import pooled, resolution

__all__ = [
    "EPISODES_ONLY",
    "MIXED",
    "SEEDS_AND_EPISODES",
    "Contrast",
    "Crossed",
    "Estimate",
    "Pairs",
    "Profile",
    "bca",
    "contrast",
    "crossed",
    "discordant",
    "equivalence",
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
    "multiplicities",
    "paired_means",
    "pairs",
    "percentile",
    "performance_profile",
    "pooled",
    "probability_of_improvement",
    "quantile",
    "resolution",
    "score",
    "score_interval",
    "seed_weights",
    "shared",
    "wilson",
    "wins",
]
