"""False group letters, and the differences found, by the test in use and by those that were considered."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.statistics.alternatives import ALTERNATIVES, USED
from benchmarks.statistics.tables import crossed, holm, upper
from benchmarks.statistics.worlds import LIMIT, World, drawn, of_rate, successes

ALPHA = 0.05
BATCH = 50
"""tables simulated at once: some 100 MB"""
FAR = 0.2
"""a difference in rates that one would want to be told of"""
RATES = (0.6, 0.9, 0.98)
SEEDS = (3, 5, 10)


@dataclass(frozen=True, slots=True)
class Design:
    """A table of agents; one seed is a controller."""

    name: str
    worlds: tuple[World, ...]
    seeds: tuple[int, ...]


def _design(name: str, *groups: tuple[int, World, int]) -> Design:
    """A design of groups (agents, their world, their seeds)."""
    worlds = tuple(world for n, world, _ in groups for _ in range(n))
    return Design(name, worlds, tuple(S for n, _, S in groups for _ in range(n)))


def equal(rate: float, S: int) -> list[Design]:
    """Designs in which all agents have the same true rate, so that every letter beyond the first is false."""
    w = of_rate
    tight, some, wild, fixed = w(rate, 0.3), w(rate, 0.5), w(rate, 2.0), w(rate, 0.0)
    return [
        _design("8 alike, sd 0.5", (8, some, S)),
        _design("8 alike, sd 1.2", (8, w(rate, 1.2), S)),
        _design("7 of sd 0.3, 1 of sd 2", (7, tight, S), (1, wild, S)),
        _design("4 of sd 0.3, 4 of sd 2", (4, tight, S), (4, wild, S)),
        _design("11 of sd 0.3, 1 of sd 3", (11, tight, S), (1, w(rate, 3.0), S)),
        _design("4 of sd 1, 4 controllers", (4, w(rate, 1.0), S), (4, fixed, 1)),
        _design("4 of sd 2, 4 controllers", (4, wild, S), (4, fixed, 1)),
        _design("4 with twice the seeds, sd 0.5", (4, some, S), (4, some, 2 * S)),
        _design("6 of sd 0.3 with twice the seeds, 2 of sd 2", (2, wild, S), (6, tight, 2 * S)),
        _design("8 of heavy tails, sd 1", (8, w(rate, 1.0, tails=3), S)),
    ]


def failing(rate: float, share: float, S: int) -> list[Design]:
    """Designs in which a share of all trainings fails; controllers have the learners' true rate."""
    learner = of_rate(rate, 0.5, share)
    controller = of_rate(learner.rate(), 0.0)
    return [
        _design("8 learners", (8, learner, S)),
        _design("4 learners, 4 controllers", (4, learner, S), (4, controller, 1)),
        _design("1 learner, 1 controller", (1, learner, S), (1, controller, 1)),
    ]


def spread(n: int, S: int) -> list[Design]:
    """Designs of n agents with rates from 0.4 to 0.97, for the differences found."""
    levels = np.random.default_rng(1).permutation(np.linspace(-0.5, 4.0, n))
    sds = {
        "0.6": [0.6] * n,
        "0.2 or 1.2": ([0.2, 1.2] * n)[:n],
        "0.3, one 2": [0.3] * (n - 1) + [2.0],
    }
    return [
        Design(f"sd {name}", tuple(World(float(x), sd) for x, sd in zip(levels, each, strict=True)), (S,) * n)
        for name, each in sds.items()
    ]


def close(S: int = 10) -> Design:
    """90 against 95 % in a table of six: seeds differ by 0.25 logits, those of one other agent by 2.5."""
    usual = of_rate(0.9, 0.25)
    return _design(
        "90 against 95 %",
        (1, usual, S),
        (1, of_rate(0.95, 0.25), S),
        (3, usual, S),
        (1, of_rate(0.9, 2.5), S),
    )


def resolved(
    design: Design,
    replications: int,
    names: Iterable[str] = (USED,),
    *,
    steps: bool = False,
    seed: int = 0,
    E: int = 200,
) -> Iterator[dict[str, np.ndarray]]:
    """By test the resolved pairs (tables, pairs) of success, or of PAR-1 of the steps, in batches."""
    rng = np.random.default_rng(seed)
    for start in range(0, replications, BATCH):
        scenarios = rng.normal(size=(min(BATCH, replications - start), E))
        if steps:
            success, took = drawn(design.worlds, design.seeds, scenarios, rng)
            data = [np.where(x == 1, y, LIMIT) for x, y in zip(success, took, strict=True)]
            table = crossed(data, rate=False, least=1.0, most=LIMIT)
        else:
            table = crossed(successes(design.worlds, design.seeds, scenarios, rng), rate=True)
        yield {name: holm(upper(ALTERNATIVES[name](table))) < ALPHA for name in names}


def false_letters(
    design: Design, replications: int, names: Sequence[str] = (USED,), *, steps: bool = False, seed: int = 0
) -> dict[str, float]:
    """Share of tables of equal agents in which some pair is resolved, by test."""
    found = dict.fromkeys(names, 0)
    for batch in resolved(design, replications, names, steps=steps, seed=seed):
        for name in names:
            found[name] += int(batch[name].any(axis=1).sum())
    return {name: count / replications for name, count in found.items()}


def power(
    design: Design, replications: int, names: Sequence[str] = (USED,), *, seed: int = 0, E: int = 200
) -> dict[str, float]:
    """Share of the differences over `FAR` that are resolved, by test; of `close`, of its first pair."""
    truth = np.array([world.rate() for world in design.worlds])
    i, j = np.triu_indices(len(truth), 1)
    wanted = np.abs(truth[i] - truth[j]) > FAR
    if not wanted.any():
        wanted[0] = True
    found = dict.fromkeys(names, 0.0)
    for batch in resolved(design, replications, names, seed=seed, E=E):
        for name in names:
            found[name] += float(batch[name][:, wanted].mean(axis=1).sum())
    return {name: total / replications for name, total in found.items()}
