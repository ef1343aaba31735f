"""The tables of the shipped studies, to measure the tests on trainings that were carried out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from scipy.special import digamma, polygamma
from scipy.stats import median_abs_deviation

from auvbench.analysis.conditions import default
from auvbench.analysis.grouping import sections
from auvbench.analysis.load import agents, load
from auvbench.analysis.measures import Measure, measure
from auvbench.analysis.ranking import one_policy
from auvbench.analysis.records import Agent
from auvbench.statistics.crossed import Crossed
from benchmarks.statistics.alternatives import Test, inverse_trigamma
from benchmarks.statistics.letters import ALPHA
from benchmarks.statistics.tables import upper

RESULTS = Path(__file__).parents[2] / "results"
PROTOCOLS = ("test", "gazebo", "robustness", "transfer")
MEASURES = ("success_rate", "par1_steps", "mean_return", "mean_energy_J", "mean_deviation_mean_m")


@dataclass(frozen=True, slots=True)
class Table:
    """The agents of a shipped table that are compared."""

    name: str
    agents: tuple[Agent, ...]

    def on(self, m: Measure, without: int | None = None) -> Crossed:
        """Return the table on a measure, without one of its rows."""
        return m.table([agent for i, agent in enumerate(self.agents) if i != without])

    def lost(self, m: Measure, test: Test) -> tuple[int, int]:
        """Return the resolved pairs, and the most of them that dropping one row leaves unresolved.

        Bonferroni over all pairs of the whole table: its size stays that of the family.
        """
        n = len(self.agents)
        i, j = np.triu_indices(n, 1)
        limit = ALPHA / len(i)
        resolved = upper(test(self.on(m))) < limit
        lost = 0
        for row in range(n):
            rest = (i != row) & (j != row)
            lost = max(lost, int((resolved[rest] & (upper(test(self.on(m, row))) >= limit)).sum()))
        return int(resolved.sum()), lost


@cache
def shipped(protocols: tuple[str, ...] = PROTOCOLS) -> tuple[Table, ...]:
    """Return the tables of all studies by these protocols, of two agents or more."""
    return tuple(
        table
        for folder in sorted(RESULTS.glob("*/runs.parquet"))
        for table in _tables(folder.parent, protocols)
    )


def _tables(study: Path, protocols: Sequence[str]) -> Iterator[Table]:
    runs, _ = load([study], protocols)
    for name in (p for p in protocols if any(p in run.evaluations for run in runs)):
        for part in sections(runs, name):
            condition = default(part.runs, name)
            found, _ = agents(part.runs, protocol=name, condition=condition)
            compared = tuple(agent for agent in found if not one_policy(agent))
            if len(compared) > 1:
                yield Table(f"{study.name}, {name}, {part.folder}", compared)


def spread_of_trainings(name: str) -> tuple[float, float, int]:
    """Return how trainings of one configuration differ in a measure, over all shipped agents with several seeds.

    Standard deviation between trainings in residual standard deviations of an episode, degrees of freedom of that
    variance as a prior, and the number of agents. Smyth's (2004) prior, from median and MAD of the log variances.
    """
    m = measure(name)
    ratio, df = [], []
    for table in shipped(PROTOCOLS[:2]):
        t = table.on(m)
        with np.errstate(divide="ignore", invalid="ignore"):
            # What drawing episodes adds to the variance between seeds is the residual itself.
            excess = np.maximum(t.between_seeds - t.residual, 0.0) / (t.residual * t.episodes)
        use = (t.seeds > 1) & np.isfinite(excess) & (excess > 0)
        ratio += list(excess[use])
        df += list(t.seeds_df[use])
    x, d = np.array(ratio), np.array(df)
    e = np.log(x) - digamma(d / 2) + np.log(d / 2)
    spread = float(median_abs_deviation(e, scale="normal")) ** 2 - float(polygamma(1, d / 2).mean())
    d0 = 2 * float(inverse_trigamma(np.array(max(spread, 1e-2))))
    prior = np.exp(np.median(e) + digamma(d0 / 2) - np.log(d0 / 2))
    return float(np.sqrt(prior)), d0, len(x)
