"""False group letters, and the differences found, by every test that was considered."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.statistics.alternatives import ALTERNATIVES
from benchmarks.statistics.tables import crossed, holm
from benchmarks.statistics.worlds import LIMIT, World, drawn, of_rate, successes

ALPHA = 0.05
BATCH = 50
"""tables simulated at once: some 100 MB"""
FAR = 0.2
"""a difference in rates that one would want to be told of"""


@dataclass(frozen=True, slots=True)
class Design:
    """A table of agents with equally many seeds."""

    name: str
    worlds: tuple[World, ...]
    seeds: int


RATES = (0.6, 0.9, 0.98)


def equal(rate: float) -> list[Design]:
    """Designs in which all agents have the same true rate, so that every letter beyond the first is false."""
    w = of_rate
    tight, some = w(rate, 0.3), w(rate, 0.5)
    designs = []
    for S in (3, 5, 10):
        designs += [
            Design("8 equal, sd 0.5", (some,) * 8, S),
            Design("8, one wild (0.3; 2)", (*(tight,) * 7, w(rate, 2.0)), S),
            Design("4 tight, 4 wild (0.3; 2)", (*(tight,) * 4, *(w(rate, 2.0),) * 4), S),
            Design("12, one of sd 3 (0.3; 3)", (*(tight,) * 11, w(rate, 3.0)), S),
            Design("8, 3 of 10 trainings fail", (w(rate, 0.5, 0.3),) * 8, S),
        ]
    return designs


def tests(design: Design) -> tuple[str, ...]:
    """The tests that are tried on a design: all, of ten seeds not the 184,756 ways to part twenty."""
    return tuple(name for name in ALTERNATIVES if name != "permutation" or design.seeds < 10)


def spread() -> list[Design]:
    """Designs with rates from 0.4 to 0.97, for the differences found."""
    designs = []
    for n, S in ((3, 5), (6, 3), (6, 5), (12, 3), (12, 5), (12, 10)):
        levels = np.random.default_rng(1).permutation(np.linspace(-0.5, 4.0, n))
        for name, sds in (
            ("0.6", [0.6] * n),
            ("0.2 or 1.2", ([0.2, 1.2] * n)[:n]),
            ("0.3, one 2.0", [0.3] * (n - 1) + [2.0]),
        ):
            worlds = tuple(World(float(level), sd) for level, sd in zip(levels, sds, strict=True))
            designs.append(Design(f"{n} agents, sd {name}", worlds, S))
    for S in (3, 5):
        for sd in (0.3, 0.6):
            worlds = tuple(World(level, sd) for level in (-4.0, -0.5, 1.5, 3.0, 5.0, 7.0))
            designs.append(Design(f"6 agents, sd {sd}, rates 3 to 99.8 %", worlds, S))
    return designs


def resolved(
    design: Design, replications: int, names: Iterable[str], seed: int = 0, E: int = 200
) -> Iterator[dict[str, np.ndarray]]:
    """By test the resolved pairs (tables, pairs) of success rates, in batches."""
    rng = np.random.default_rng(seed)
    for start in range(0, replications, BATCH):
        scenarios = rng.normal(size=(min(BATCH, replications - start), E))
        data = successes(design.worlds, design.seeds, scenarios, rng)
        table = crossed(data, rate=True)
        yield {name: holm(ALTERNATIVES[name](table, data.mean(axis=3))) < ALPHA for name in names}


def false_letters(
    design: Design, replications: int, names: Sequence[str] = (), seed: int = 0
) -> dict[str, float]:
    """Share of tables of equal agents in which some pair is resolved, by test (all `tests` if none is named)."""
    names = names or tests(design)
    found = dict.fromkeys(names, 0)
    for batch in resolved(design, replications, names, seed):
        for name in names:
            found[name] += int(batch[name].any(axis=1).sum())
    return {name: count / replications for name, count in found.items()}


def power(design: Design, replications: int, names: Sequence[str] = (), seed: int = 0) -> dict[str, float]:
    """Share of the differences over `FAR` that are resolved, by test (all `tests` if none is named)."""
    names = names or tests(design)
    truth = np.array([world.truth()[0] for world in design.worlds])
    i, j = np.triu_indices(len(truth), 1)
    far = np.abs(truth[i] - truth[j]) > FAR
    found = dict.fromkeys(names, 0.0)
    for batch in resolved(design, replications, names, seed):
        for name in names:
            found[name] += float(batch[name][:, far].mean(axis=1).sum())
    return {name: total / replications for name, total in found.items()}


def false_letters_of_steps(
    design: Design, replications: int, seed: int = 0, E: int = 200
) -> dict[str, float]:
    """The same for PAR-1 of the steps: agents of one world are equal in it too."""
    names = ("own variances", "used")
    rng = np.random.default_rng(seed)
    found = dict.fromkeys(names, 0)
    for start in range(0, replications, BATCH):
        scenarios = rng.normal(size=(min(BATCH, replications - start), E))
        success, steps = drawn(design.worlds, design.seeds, scenarios, rng)
        penalised = np.where(success == 1, steps, LIMIT)
        table = crossed(penalised, rate=False, least=1.0, most=LIMIT)
        for name in names:
            p = holm(ALTERNATIVES[name](table, penalised.mean(axis=3)))
            found[name] += int((p < ALPHA).any(axis=1).sum())
    return {name: count / replications for name, count in found.items()}
