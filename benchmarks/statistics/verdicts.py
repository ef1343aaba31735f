"""Measure how often verdicts about typical trainings are false, and how often they find true differences; each line has a limit.

Each design is simulated once, as tables of twelve learners with twenty trainings. Smaller tables have the first five learners,
smaller numbers of trainings the first ones. `statistics.typical` computes all verdicts, as in a report.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from auvbench.statistics.typical import ALPHA, Contrast, Sample, difference, median_interval, sample
from benchmarks.statistics.designs import EPISODES, Design, FloatArray

TRAININGS = (5, 8, 10, 20)
ROWS = (5, 12)
BATCH = 20
"""tables simulated at once: about 100 MB"""


@dataclass(frozen=True, slots=True)
class Cell:
    """A measured share in per cent, and its limit."""

    share: float
    limit: float = np.nan
    at_least: bool = False
    trials: int = 1

    @property
    def within(self) -> bool:
        """Return whether the share is within the limit plus two standard errors of the simulation; True without a limit."""
        if np.isnan(self.limit):
            return True
        p = self.limit / 100
        error = 200 * np.sqrt(p * (1 - p) / self.trials)
        return bool(self.share >= self.limit - error if self.at_least else self.share <= self.limit + error)


DESIGNS = (
    Design("rate", 0.5),
    Design("rate", 2.0),
    Design("rate", 1.2, 0.6),
    Design("rate", 1.0, shape="heavy"),
    Design("rate", 1.0, shape="skew"),
    Design("rate", 2.0, shape="skew"),
    Design("rate", 2.0, 0.98, shape="skew"),
    Design("rate", 2.0, shape="skewup"),
    Design("rate", 2.0, shape="skew", rho=0.5),
    Design("rate", 0.0, rho=0.5),
    Design("rate", 0.0, 0.98, failing=0.05),
    Design("rate", 0.5, 0.98, failing=0.05),
    Design("rate", 0.0, 0.98, failing=0.1),
    Design("rate", 0.5, 0.98, failing=0.1),
    Design("par", 0.3),
    Design("par", 0.3, shape="skew"),
    Design("par", 0.1, failing=0.05),
    Design("par", 0.1, failing=0.1),
    Design("par", 0.02, inter=0.3),
    Design("rms", 0.5),
    Design("rms", 1.0),
    Design("rms", 0.2, failing=0.05),
    Design("rms", 0.2, failing=0.1),
    Design("rms", 0.05, inter=0.3),
)
"""learners whose typical training equals the controller"""
STRESS = (Design("rate", 0.5, 0.98, failing=0.3), Design("rate", 0.5, 0.98, failing=0.45))
"""designs outside the guarantee: nearly half of the trainings fail"""
APART = (
    Design("rate", 0.25, 0.95, controller=0.9),
    Design("rate", 0.3, 0.95, controller=0.9),
    Design("rate", 0.5, 0.95, controller=0.9),
    Design("par", 0.05, controller=1.1),
    Design("par", 0.1, controller=1.1),
    Design("rms", 0.1, controller=1.2),
    Design("rms", 0.2, controller=1.2),
)
"""learners that are better"""
AT_MARGIN = (
    Design("rate", 0.0, 0.97, controller=0.99),
    Design("rate", 0.3, 0.97, controller=0.99),
    Design("rate", 0.0, 0.98, controller=1.0),
    Design("rate", 0.5, 0.98, controller=1.0),
    Design("rate", 0.3, 0.94, controller=0.96),
    Design("par", 0.001, controller=1 / 1.05, lost=0.0),
    Design("par", 0.05, controller=1 / 1.05, lost=0.0),
    Design("par", 0.02, controller=1 / 0.95, lost=0.0),
    Design("rms", 0.001, controller=1 / 1.05),
    Design("rms", 0.05, controller=1 / 1.05),
    Design("rms", 0.5, controller=1 / 1.05),
)
"""learners whose typical training differs from the controller by the margin: 2 points, or 5 % of the controller's value"""
PAIRS = (
    (Design("rate", 0.5), Design("rate", 0.5)),
    (Design("rate", 2.0, shape="skew"), Design("rate", 0.3)),
    (Design("rate", 0.5, 0.98, failing=0.1), Design("rate", 0.5, 0.98, failing=0.1)),
    (Design("par", 0.3, shape="skew"), Design("par", 0.3, shape="skew")),
    (Design("rms", 1.0), Design("rms", 0.1)),
)
"""learners and their baseline, a learner, with equal typical trainings"""
EQUAL = (Design("rate", 0.3, 0.99), Design("rate", 0.3, 0.995), Design("rate", 0.3, 0.999))


def contrasts(design: Design, replications: int, seed: int = 0) -> Iterator[dict[int, Contrast]]:
    """Yield, for each batch, the comparisons (tables, 12) of learners with the controller, by number of trainings."""
    rng = np.random.default_rng(seed)
    for start in range(0, replications, BATCH):
        tables = min(BATCH, replications - start)
        x, y = design.tables(tables, max(ROWS), max(TRAININGS), rng)
        baseline = Sample(y.mean(axis=-1), y[:, :, 0])
        yield {n: difference(sample(x[:, :, :n]), baseline, design.rate) for n in TRAININGS}


def shares(
    design: Design,
    replications: int,
    judge: Callable[[Contrast, float], FloatArray],
    rows: Sequence[int] = ROWS,
    seed: int = 0,
) -> dict[tuple[int, int], FloatArray]:
    """Return `judge`'s result for each comparison at its level (tables, rows), by rows of the table and trainings."""
    found: dict[tuple[int, int], list[FloatArray]] = {(k, n): [] for k in rows for n in TRAININGS}
    for batch in contrasts(design, replications, seed):
        for k, n in found:
            found[k, n].append(judge(batch[n], ALPHA / k)[:, : max(k, 5)])
    return {key: np.concatenate(parts) for key, parts in found.items()}


def excludes_zero(found: Contrast, level: float) -> FloatArray:
    """Return whether an interval excludes 0, so that the verdict is ahead or behind."""
    low, high = found.ends(level)
    return np.asarray((low > 0) | (high < 0), dtype=np.float64)


def holds_zero(found: Contrast, level: float) -> FloatArray:
    """Return whether an interval contains 0."""
    return 1 - excludes_zero(found, level)


def false_verdicts(design: Design, replications: int, required: bool = True) -> list[Cell]:
    """Return the share of tables with any false ahead or behind, by rows and trainings; then the share of single intervals that contain 0."""
    found = shares(design, replications, excludes_zero, (*ROWS, 1))
    cells = []
    for k in ROWS:
        for n in TRAININGS:
            limit = (7.0 if n == 5 else 5.0) if required else np.nan
            share = 100 * float(found[k, n].any(axis=1).mean())
            cells.append(Cell(share, limit, trials=replications))
    rows = replications * found[1, 5].shape[1]
    return [*cells, *(Cell(100 - 100 * float(found[1, n].mean()), trials=rows) for n in TRAININGS)]


def power(design: Design, replications: int) -> list[Cell]:
    """Return the share of rows with the right verdict, in tables of one, five and twelve."""
    better = 1 if design.rate else -1

    def right(found: Contrast, level: float) -> FloatArray:
        low, high = found.ends(level)
        return np.asarray(low > 0 if better > 0 else high < 0, dtype=np.float64)

    found = shares(design, replications, right, (1, *ROWS))
    least = {(1, 10): 94.0, (5, 10): 70.0} if design == APART[0] else {}
    return [
        Cell(100 * float(found[k, n].mean()), least.get((k, n), np.nan), True, replications)
        for k in (1, *ROWS)
        for n in TRAININGS
    ]


def equivalent(design: Design, replications: int, limit: float = np.nan) -> list[Cell]:
    """Return the share of rows with the verdict equivalent; with a limit, of tables with any such row."""

    def within(found: Contrast, level: float) -> FloatArray:
        low, high = found.ends(level)
        baseline = found.samples[1].means[..., 0]
        margin = 0.02 if design.rate else 0.05 * np.abs(baseline)
        return np.asarray((low > -margin) & (high < margin), dtype=np.float64)

    found = shares(design, replications, within)
    whole = not np.isnan(limit)
    return [
        Cell(
            100 * float(found[k, n].any(axis=1).mean() if whole else found[k, n].mean()),
            limit,
            trials=replications,
        )
        for k in ROWS
        for n in TRAININGS
    ]


def undecided(design: Design, replications: int) -> list[Cell]:
    """Return the share of open rows whose interval over trainings, without the scenarios' error, is on one side of 0: none."""

    def open_still(found: Contrast, level: float) -> FloatArray:
        low, _, high = median_interval(found.samples[0].means, level)
        baseline = found.samples[1].typical
        s = -stdtrit(EPISODES - 1.0, level / 2) * found.error
        one_side = (low - baseline > s) | (high - baseline < -s)
        return np.asarray(one_side & (excludes_zero(found, level) == 0), dtype=np.float64)

    found = shares(design, replications, open_still)
    return [Cell(100 * float(found[k, n].mean()), 0.0, trials=replications) for k in ROWS for n in TRAININGS]


def of_learners(
    first: Design, second: Design, replications: int, seed: int = 0
) -> dict[tuple[int, int], float]:
    """Return the share of tables of five learners in which any differs from a baseline that learns (%), by trainings of each."""
    rng = np.random.default_rng(seed)
    pairs = ((5, 5), (10, 10), (20, 20), (20, 5))
    found = dict.fromkeys(pairs, 0)
    for start in range(0, replications, BATCH):
        tables = min(BATCH, replications - start)
        hard = rng.normal(size=(tables, EPISODES))
        x, y = first.learners(5, 20, hard, rng), second.learners(1, 20, hard, rng)
        for n, m in pairs:
            one = difference(sample(x[:, :, :n]), sample(y[:, :, :m]), first.rate)
            found[n, m] += int(excludes_zero(one, ALPHA / 5).any(axis=1).sum())
    return {key: 100 * count / replications for key, count in found.items()}
