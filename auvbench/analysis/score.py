"""Compute a score across tasks: each task's primary measure, scaled so that random is 0 and PID is 1.

The score of an agent under one condition of one task is (m(agent) - m(random)) / (m(PID) - m(random)), where
m is the mean of the task's primary measure. The score depends only on the agent, PID and random, not on other
rows of a table.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from auvbench.analysis.formatting import listed
from auvbench.analysis.grouping import frequency_fixed
from auvbench.analysis.labels import labels, usual_sentence
from auvbench.analysis.measures import Measure
from auvbench.analysis.names import with_names
from auvbench.analysis.primary import default_margin
from auvbench.analysis.records import NO_POLICY, Agent, learns
from auvbench.statistics.intervals import BoolArray, Estimate, FloatArray

ZERO, ONE = "random", "pid"
"""algorithms whose scores are 0 and 1"""

Name = tuple[tuple[str, str], ...]
"""keys and values that identify an agent within a task"""


@dataclass(frozen=True, slots=True)
class OneTask:
    """Results of the agents of one task."""

    title: str
    """title in the heading of a column: 'docking'"""
    measure: Measure
    conditions: Mapping[str, Sequence[Agent]]
    """agents by condition, in the protocol's order of conditions"""
    add: Mapping[str, str]
    """commands that add runs of PID and random, by algorithm"""


@dataclass(frozen=True, slots=True)
class Scored:
    """One agent's scores."""

    label: str
    key: Mapping[str, Any]
    trained: bool
    trainings: tuple[int, ...]
    """number of training seeds in each task; 0 if the agent was not tested in the task"""
    tasks: tuple[float, ...]
    """mean score over seeds and conditions in each task; NaN if the agent was not tested in the task"""
    score: Estimate
    """interquartile mean of the scores over seeds, conditions and tasks; NaN unless the agent was tested in each task"""
    run_ids: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Scores:
    """Scores across tasks, best agent first; agents that were not tested in all tasks come last."""

    titles: tuple[str, ...]
    measures: tuple[Measure, ...]
    """measure of each task's score"""
    rows: tuple[Scored, ...]
    cells: int
    """number of pairs of task and condition that have a score"""
    protocol: str
    confidence: float
    notes: tuple[str, ...] = ()
    """Notes below the table: what was left out, or the reason why there is no score"""


def scores(tasks: Sequence[OneTask], protocol: str, confidence: float, seed: int = 0) -> Scores | None:
    """Return the score of each agent over all tasks; None for fewer than two tasks.

    Agents of two tasks are one agent if they agree in every key that distinguishes agents within a task. A
    failed training scores 0. If PID is not ahead of random by more than the default margin under a condition, the
    condition has no scale and is left out.

    Args:
        tasks: tasks of one or more vehicles; all conditions of a task have the same agents.
        protocol: protocol of the conditions.
        confidence: confidence of the intervals.
        seed: seed of the resampling.
    """
    if len(tasks) < 2:
        return None
    titles, measures = tuple(t.title for t in tasks), tuple(t.measure for t in tasks)
    if missing := [line for task in tasks for line in _missing(task)]:
        return Scores(titles, measures, (), 0, protocol, confidence, tuple(missing))
    by_name: dict[Name, list[Cell | None]] = {}
    notes: list[str] = []
    unscaled: list[str] = []
    cells = 0
    for i, task in enumerate(tasks):
        scored, without = _task(task)
        cells += len(task.conditions) - len(without)
        if without:
            unscaled.append(f"{task.title} under {listed(without, len(without))}")
        for name, cell in scored.items():
            by_name.setdefault(name, [None] * len(tasks))[i] = cell
    rows = _rows(list(by_name.values()), confidence, seed)
    if unscaled:
        notes.append(
            f"No score where PID is not ahead of random by more than the margin: {'; '.join(unscaled)}."
        )
    notes += usual_sentence([row.key for row in rows], [row.trained for row in rows])
    if partly := [row.label for row in rows if math.isnan(row.score.value)]:
        notes.append(f"No score across tasks for {listed(partly, 4)}: not tested on every task.")
    return Scores(titles, measures, tuple(rows), cells, protocol, confidence, tuple(notes))


def _missing(task: OneTask) -> list[str]:
    """Return a line for PID unless the task has exactly one PID agent, and likewise a line for random."""
    agents = next(iter(task.conditions.values()))
    lines = []
    for name in (ONE, ZERO):
        n = sum(_algorithm(agent) == name for agent in agents)
        if n == 0:
            lines.append(f"No score across tasks: {task.title} has no runs of {name}. {task.add[name]}")
        elif n > 1:
            lines.append(
                f"No score across tasks: {task.title} has {n} agents of algo={name}; --where leaves one."
            )
    return lines


def _algorithm(agent: Agent) -> str:
    return str(agent.runs[0].config.get("algo.name"))


@dataclass(frozen=True, slots=True, eq=False)
class Cell:
    """Values of an agent in one task, and the values of random and PID, which define the scale of the scores.

    Shapes: S trainings, C conditions, E scenarios.
    """

    agent: Agent
    values: FloatArray  # (S, C, E) values of the agent's trainings
    zero: FloatArray  # (C, E) values of random
    one: FloatArray  # (C, E) values of PID
    failed: BoolArray  # (S,) whether a training has no policy, and so the score 0

    def scores(self, weights: FloatArray | None = None) -> FloatArray:
        """Return the scores (..., S, C).

        `weights` (..., E) are the scenarios' weights in the means and add up to 1; default: equal weights.
        """
        E = self.values.shape[-1]
        w = np.full(E, 1.0 / E) if weights is None else weights

        def mean(x: FloatArray) -> FloatArray:
            return np.asarray(np.tensordot(w, x, axes=(-1, -1)))

        zero, one = mean(self.zero), mean(self.one)
        scaled = (mean(self.values) - zero[..., None, :]) / (one - zero)[..., None, :]
        return np.where(self.failed[:, None], 0.0, scaled)


def _task(task: OneTask) -> tuple[dict[Name, Cell], list[str]]:
    """Return the cells of the agents that were tested under all conditions, and the conditions without a scale."""
    m = task.measure
    members: dict[Name, list[tuple[Agent, FloatArray]]] = {}
    without, zeros, ones = [], [], []
    for condition, agents in task.conditions.items():
        of = {_algorithm(agent): m.values(agent).mean(axis=0) for agent in agents}
        zero, one = of.get(ZERO, np.array(math.nan)), of.get(ONE, np.array(math.nan))
        apart = float(one.mean() - zero.mean())
        if not m.sign * apart > np.nan_to_num(default_margin(m, float(one.mean()))):
            without.append(condition)
            continue
        zeros.append(zero)
        ones.append(one)
        for agent in agents:
            name = tuple(sorted((k, str(v)) for k, v in agent.key.items()))
            members.setdefault(name, []).append((agent, m.values(agent)))
    by_name = {}
    for name, cells in members.items():
        columns = [values for _, values in cells]
        if len(cells) < len(zeros) or len({x.shape for x in columns}) > 1:
            continue
        failed = np.any([(agent.outcome == NO_POLICY).all(axis=1) for agent, _ in cells], axis=0)
        values = np.where(failed[:, None, None], 0.0, np.stack(columns, axis=1))
        if np.isfinite(values).all():
            by_name[name] = Cell(cells[0][0], values, np.stack(zeros), np.stack(ones), failed)
    return by_name, without


def _rows(members: Sequence[Sequence[Cell | None]], confidence: float, seed: int) -> list[Scored]:
    firsts = [next(cell.agent for cell in row if cell is not None) for row in members]
    names = list(dict.fromkeys(name for agent in firsts for name in agent.key))
    keys = [{name: agent.key.get(name) for name in names} for agent in firsts]
    fixed = frequency_fixed(a.metrics["frequency_hz"] for a in firsts if "frequency_hz" in a.metrics)
    shown = with_names(
        labels(keys, [learns(agent) for agent in firsts], fixed), [agent.runs for agent in firsts]
    )
    rows = []
    for label, key, agent, row in zip(shown, keys, firsts, members, strict=True):
        cells = [cell for cell in row if cell is not None]
        runs = tuple(run.id for cell in cells for run in cell.agent.runs)
        score = Estimate(math.nan, math.nan, math.nan, confidence)
        if len(cells) == len(row):
            # The random seed comes from the agent's own runs, so that other rows do not change the agent's interval.
            rng = np.random.default_rng([seed, zlib.crc32(" ".join(runs).encode())])
            score = bootstrapped(cells, confidence, rng)
        rows.append(
            Scored(
                label,
                key,
                learns(agent),
                tuple(0 if cell is None else len(cell.values) for cell in row),
                tuple(math.nan if cell is None else float(cell.scores().mean()) for cell in row),
                score,
                runs,
            )
        )
    return sorted(
        rows, key=lambda row: (math.isnan(row.score.value), -np.nan_to_num(row.score.value), row.label)
    )


def interquartile(scores: FloatArray) -> FloatArray:
    """Return the mean of the middle half of scores (..., n), as rliable does (Agarwal et al. 2021, NeurIPS).

    >>> float(interquartile(np.array([0.0, 1.0, 2.0, 3.0, 100.0, 3.0, 2.0, -50.0])))
    2.0
    """
    from scipy.stats import trim_mean  # imported late: takes half a second, and most reports do not need it

    return np.asarray(trim_mean(scores, 0.25, axis=-1))


RESAMPLES = 1000
"""number of bootstrap draws"""


def bootstrapped(
    cells: Sequence[Cell], confidence: float, rng: np.random.Generator, resamples: int = RESAMPLES
) -> Estimate:
    """Return the interquartile mean of all scores, with a bootstrap interval over trainings and scenarios.

    The bootstrap resamples within each task. The interval uses percentiles, as rliable does (Agarwal et al.
    2021). Of S trainings, S - 1 are drawn (Rao & Wu 1988): with S draws, the variance would be a third too small
    for three trainings. A training's scores under all conditions are drawn together, because they share the
    training's seed effect. A drawn scenario is used for the agent, PID and random under all conditions. With few
    trainings the interval contains the true value less often than its confidence says
    (docs/statistics-appendix.md).

    Args:
        cells: cells of the agent, one per task. The interval is NaN if a learner has one training.
        confidence: confidence of the interval.
        rng: generator of the draws.
        resamples: number of draws.
    """
    value = float(interquartile(np.concatenate([cell.scores().reshape(-1) for cell in cells])))
    if any(learns(cell.agent) and len(cell.values) < 2 for cell in cells):
        return Estimate(value, np.nan, np.nan, confidence)
    drawn = []
    for cell in cells:
        S, _, E = cell.values.shape
        scores = cell.scores(rng.multinomial(E, np.full(E, 1.0 / E), size=resamples) / E)  # (R, S, C)
        picked = rng.integers(S, size=(resamples, S - 1)) if S > 1 else np.zeros((resamples, 1), dtype=int)
        drawn.append(np.take_along_axis(scores, picked[..., None], axis=1).reshape(resamples, -1))
    tail = (1 - confidence) / 2
    low, high = np.quantile(interquartile(np.concatenate(drawn, axis=1)), [tail, 1 - tail])
    return Estimate(
        value, float(min(low, value)), float(max(high, value)), confidence, "training seeds and test episodes"
    )
