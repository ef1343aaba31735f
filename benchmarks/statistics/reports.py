"""What a report says of agents: from arrays through the tests of `analysis.pairwise` to letters and verdicts."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from auvbench.analysis.measures import measure
from auvbench.analysis.model import Agent, RunRecord
from auvbench.analysis.pairwise import Tests, all_pairs
from auvbench.analysis.policies import one_policy
from auvbench.statistics.bootstrap import multiplicities, paired_means, seed_weights
from benchmarks.statistics.worlds import FloatArray, World, of_rate, shifted


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


def decided(agents: Sequence[Agent], *, policies: bool = False, margin: float | None = None) -> Tests:
    """The tests of a table on success, as `analysis.ranking.rank` makes them."""
    compared = np.array([policies or not one_policy(a) for a in agents])
    return all_pairs(agents, measure("success_rate"), compared, 0.95, margin)


def one_seed(replications: int, seed: int = 0) -> dict[str, tuple[float, float]]:
    """Share of tables of equal configurations with a false letter: compared as policies, and as a report does."""
    world = of_rate(0.9, 0.5)
    found = {}
    for name, seeds in (("8 of one seed", [1] * 8), ("4 of five seeds, 4 of one", [5] * 4 + [1] * 4)):
        drawn = tables([world] * 8, seeds, 500, replications, seed)
        as_policies = float(np.mean([decided(agents, policies=True).resolved.any() for agents in drawn]))
        found[name] = as_policies, float(np.mean([decided(agents).resolved.any() for agents in drawn]))
    return found


def best(
    replications: int, resamples: int = 400, seed: int = 0
) -> list[tuple[str, int, float, float, float]]:
    """Rows of: seeds' sd, seeds, share of tables whose bootstrap is "> 99 %" sure of the first place, share of those
    in which it is right, and share of all tables in which the truly best has a rank interval that begins at 1.
    """
    rng = np.random.default_rng(seed)
    rows = []
    for sd in (0.5, 1.0):
        for S in (3, 5):
            worlds = [World(2.2, sd), World(2.0, sd)]
            sure = right = open_ = 0
            for agents in tables(worlds, [S] * 2, 200, replications, seed):
                drawn = multiplicities(200, resamples, rng)
                weights = [seed_weights(S, resamples, rng) for _ in agents]
                means = paired_means([a.success for a in agents], drawn, weights)
                first = np.bincount(means.argmax(axis=1), minlength=2) / resamples
                if first.max() > 0.99:
                    sure += 1
                    right += int(first.argmax()) == 0
                tests = decided(agents)
                open_ += not (tests.resolved[0] & (tests.pairs.difference[0] < 0)).any()
            rows.append((f"{sd:g}", S, sure / replications, right / max(sure, 1), open_ / replications))
    return rows


def equivalence(
    replications: int, margin: float = 0.05, seed: int = 0
) -> list[tuple[str, int, float, float]]:
    """Rows of: world, seeds, share of "equivalent" where the true difference is the margin, and where it is none.

    The last world: trainings of both work alike, but three of ten of the second fail, so that 23 points part them.
    """
    rows = []
    for rate, sd in ((0.9, 0.1), (0.9, 0.3), (0.98, 0.3)):
        world = of_rate(rate, sd)
        for S in (3, 5, 10):
            shares = []
            for other in (shifted(world, margin), world):
                drawn = tables([world, other], [S, S], 500, replications, seed)
                verdicts = [decided(agents, margin=margin).verdict(0, 1) for agents in drawn]
                shares.append(float(np.mean([verdict == "equivalent" for verdict in verdicts])))
            rows.append((f"rate {100 * rate:.0f} %, sd {sd:g}", S, *shares))
    works = of_rate(0.95, 0.1)
    fails = World(works.level, works.seed_sd, failing=0.3)
    for S in (3, 5, 10):
        drawn = tables([works, fails], [S, S], 500, replications, seed)
        verdicts = [decided(agents, margin=margin).verdict(0, 1) for agents in drawn]
        rows.append(
            ("3 of 10 of one fail", S, float(np.mean([v == "equivalent" for v in verdicts])), float("nan"))
        )
    return rows
