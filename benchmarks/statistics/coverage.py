"""How often intervals hold the truth, for the t-type interval that the tables use and for two bootstraps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from auvbench.statistics.bootstrap import multiplicities, paired_means, seed_weights
from auvbench.statistics.crossed import crossed, means
from auvbench.statistics.differences import pairs
from auvbench.statistics.resolution import pooled
from benchmarks.statistics import tables
from benchmarks.statistics.alternatives import one_by_one
from benchmarks.statistics.letters import Design
from benchmarks.statistics.worlds import FloatArray, World, drawn, of_rate, successes

BATCH = 100
"""experiments at once"""

METHODS = ("t-type (used)", "bootstrap", "bootstrap, rescaled")

WORLDS = (
    *((f"{sd}", World(level, sd)) for sd in (0.0, 0.5, 1.0) for level in (0.5, 3.0)),
    *(("2.5", World(level, 2.5)) for level in (0.5, 4.0)),
    *((f"{sd:g}", of_rate(0.98, sd)) for sd in (1.0, 2.0)),
    ("0.5, 3 of 10 fail", World(3.25, 0.5, failing=0.3)),
)
"""what is measured; the last as wild as trainings of reinforcement learning can be"""


def coverage(
    world: World,
    S: int,
    E: int,
    *,
    replications: int,
    resamples: int = 400,
    confidence: float = 0.95,
    seed: int = 0,
) -> dict[str, FloatArray]:
    """By method the share (4,) of experiments whose interval holds the truth, the truth being known.

    Of the success rate, the mean steps, and the differences of both to a second agent of the same world (truth 0).
    Without resamples, or with one seed, the t-type interval alone.
    """
    if S > 1 and not resamples:
        return {METHODS[0]: _together(world, S, E, replications, confidence, seed)}
    rng = np.random.default_rng(seed)
    rate, steps = world.truth()
    truth = np.array([rate, steps, 0.0, 0.0])
    inside = {method: np.zeros(4) for method in (METHODS if resamples and S > 1 else METHODS[:1])}
    tail = (1 - confidence) / 2
    for _ in range(replications):
        scenarios = rng.normal(size=E)
        agents = [world.draw(S, E, scenarios, rng) for _ in range(2)]
        lows, highs = _t_type(agents, confidence)
        inside[METHODS[0]] += (lows <= truth) & (truth <= highs)
        for method, rescaled in ((METHODS[1], False), (METHODS[2], True)):
            if method not in inside:
                continue
            drawn = multiplicities(E, resamples, rng)
            weights = [seed_weights(S, resamples, rng, rescaled=rescaled) for _ in range(2)] * 2
            data = [agents[0][0], agents[1][0], agents[0][1], agents[1][1]]
            r = paired_means(data, drawn, weights)
            r = np.column_stack([r[:, 0], r[:, 2], r[:, 0] - r[:, 1], r[:, 2] - r[:, 3]])
            low, high = np.quantile(r, [tail, 1 - tail], axis=0)
            inside[method] += (low <= truth) & (truth <= high)
    return {method: count / replications for method, count in inside.items()}


def _together(world: World, S: int, E: int, replications: int, confidence: float, seed: int) -> FloatArray:
    """The same for the t-type interval alone, many experiments at once."""
    rng = np.random.default_rng(seed)
    inside, truth = np.zeros(4), world.truth()
    for start in range(0, replications, BATCH):
        scenarios = rng.normal(size=(min(BATCH, replications - start), E))
        for metric, values in enumerate(drawn([world] * 2, S, scenarios, rng)):
            table = tables.crossed(values, rate=metric == 0)
            for one in one_by_one(table):
                first = means(one, confidence)[0]
                both = pairs(pooled(one), confidence, one)
                inside[metric] += first.low <= truth[metric] <= first.high
                inside[2 + metric] += both.low[0, 1] <= 0 <= both.high[0, 1]
    return inside / replications


def _t_type(
    agents: Sequence[tuple[FloatArray, FloatArray]], confidence: float
) -> tuple[FloatArray, FloatArray]:
    """Ends (4,) of the intervals that the tables use."""
    found = []
    for metric in (0, 1):
        table = crossed([agent[metric] for agent in agents], rate=metric == 0)
        one, both = means(table, confidence)[0], pairs(pooled(table), confidence, table)
        found += [(one.low, one.high), (both.low[0, 1], both.high[0, 1])]
    ends = np.array(found)[[0, 2, 1, 3]]
    return ends[:, 0], ends[:, 1]


def of_pairs(
    design: Design, replications: int, seed: int = 0, E: int = 200
) -> dict[str, tuple[float, float]]:
    """Over all pairs of agents of a table, the share of intervals that hold the true difference, and the median width.

    With each agent's own variance between seeds, and as a report has them, pooled upwards over the table.
    """
    rng = np.random.default_rng(seed)
    truth = np.array([world.truth()[0] for world in design.worlds])
    i, j = np.triu_indices(len(truth), 1)
    true = truth[i] - truth[j]
    held: dict[str, list[FloatArray]] = {"own variances": [], "used": []}
    width: dict[str, list[FloatArray]] = {name: [] for name in held}
    data = successes(design.worlds, design.seeds, rng.normal(size=(replications, E)), rng)
    for table in one_by_one(tables.crossed(data, rate=True)):
        for name, found in (("own variances", pairs(table)), ("used", pairs(pooled(table), own=table))):
            low, high = found.low[i, j], found.high[i, j]
            held[name].append((low <= true) & (true <= high))
            width[name].append(high - low)
    return {name: (float(np.mean(held[name])), float(np.median(width[name]))) for name in held}
