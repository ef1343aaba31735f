"""What a report says of agents: from arrays through the tests of `analysis.pairwise` to letters and verdicts."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from auvbench.analysis.measures import measure
from auvbench.analysis.pairwise import Tests, all_pairs
from auvbench.analysis.primary import VERDICTS, primary_analysis
from auvbench.analysis.ranking import one_policy
from auvbench.analysis.records import Agent, RunRecord
from benchmarks.statistics.worlds import FloatArray, World, of_rate


def agent(label: str, success: FloatArray) -> Agent:
    """A trained agent with these successes (S, E), every failure a timeout after 1000 steps."""
    S = len(success)
    runs = tuple(
        RunRecord(f"{label}-s{s}", Path(label), "complete", s, {"algo.name": label}, {"steps": 1})
        for s in range(S)
    )
    steps = np.where(success == 1, 300.0, 1000.0)
    outcome = np.where(success == 1, 0, 2).astype(np.int8)
    return Agent(label, {"algo": label}, runs, "f" * 16, outcome, {"steps": steps}, 1000.0)


def tables(
    worlds: Sequence[World], seeds: Sequence[int], E: int, replications: int, seed: int = 0
) -> list[list[Agent]]:
    """Simulated tables of agents, one per world, with their numbers of seeds."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(replications):
        scenarios = rng.normal(size=E)
        drawn = [w.draw(S, E, scenarios, rng)[0] for w, S in zip(worlds, seeds, strict=True)]
        found.append([agent(f"a{i:02}", success) for i, success in enumerate(drawn)])
    return found


def decided(agents: Sequence[Agent], *, policies: bool = False) -> Tests:
    """The tests of a table on success, as `analysis.ranking.rank` makes them."""
    compared = np.array([policies or not one_policy(a) for a in agents])
    return all_pairs(agents, measure("success_rate"), compared, 0.95)


def one_seed(replications: int, seed: int = 0) -> dict[str, tuple[float, float]]:
    """Share of tables of equal configurations with a false letter: compared as policies, and as a report does."""
    world = of_rate(0.9, 0.5)
    found = {}
    for name, seeds in (("8 of one seed", [1] * 8), ("4 of five seeds, 4 of one", [5] * 4 + [1] * 4)):
        drawn = tables([world] * 8, seeds, 500, replications, seed)
        as_policies = float(np.mean([decided(agents, policies=True).resolved.any() for agents in drawn]))
        found[name] = as_policies, float(np.mean([decided(agents).resolved.any() for agents in drawn]))
    return found


def against_baseline(
    worlds: Sequence[World], S: int, replications: int, margin: float = 0.05, seed: int = 0
) -> dict[str, float]:
    """By verdict of the primary analysis, the share of tables in which some agent gets it.

    The first world is the baseline, a controller with one run; the others have S seeds each.
    """
    found = dict.fromkeys(VERDICTS, 0)
    for agents in tables(worlds, [1, *[S] * (len(worlds) - 1)], 500, replications, seed):
        compared = np.ones(len(agents), dtype=bool)
        primary = primary_analysis(agents, decided(agents, policies=True), compared, agents[0], margin)
        assert primary is not None
        for verdict in {against.verdict for against in primary.comparisons}:
            found[verdict] += 1
    return {verdict: count / replications for verdict, count in found.items()}
