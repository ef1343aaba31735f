"""The ranked table: who is better, and how sure that is. docs/statistics.md explains every number to a reviewer."""

from __future__ import annotations

import zlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from auvbench import statistics as st
from auvbench.analysis.conditions import successes
from auvbench.analysis.effects import learns
from auvbench.analysis.measures import Measure, all_measures, measure
from auvbench.analysis.model import Agent, Comparison, Problem, Ranking, Row
from auvbench.errors import ReportError, closest
from auvbench.statistics.estimate import Estimate
from auvbench.statistics.intervals import FloatArray

ALL_PAIRS = 30
"""Up to so many agents every pair is listed in `Ranking.comparisons`; beyond, those that `_listed` names."""
RESAMPLES = 2000


def rank(
    agents: Sequence[Agent],
    *,
    rank_by: str = "success_rate",
    then: str = "mean_steps",
    baseline: str | None = None,
    confidence: float = 0.95,
    seed: int = 0,
    resamples: int = RESAMPLES,
    protocol: str | None = None,
    condition: str = "nominal",
    problems: Sequence[Problem] = (),
) -> Ranking:
    """Rank agents by one measure, ties by a second; the result does not depend on the order of the agents.

    Rows are in the order of the point values. What the data resolve is said by the group letters, the intervals of
    the ranks and the adjusted p-values, which all come from the same tests of all pairs on `rank_by`; comparisons
    with the baseline are corrected among themselves.

    Args:
        agents: of one protocol and condition, with the same scenarios.
        rank_by: a name of `measures.MEASURES`.
        then: decides between agents that are exactly equal in `rank_by`, and between two episodes that both went
            well in the probability of improvement.
        baseline: label of an agent, or its algorithm where that is one agent.
        confidence: of all intervals; letters and rank intervals hold for all agents together with it.
        seed: of the bootstrap behind the probability of being best.
        resamples: of that bootstrap.
        protocol: named in the table; by default that of the agents' runs.
        condition: named in the table.
        problems: named in the table.

    Raises:
        ReportError: no agents, unknown measure or baseline, equal labels, or scenarios that differ.
    """
    by, finer = measure(rank_by), measure(then, "--then")
    _check(agents, confidence)
    agents = sorted(agents, key=lambda agent: agent.label)
    reference = None if baseline is None else find_baseline(agents, baseline)
    estimates = _estimates(agents, confidence)
    value = _oriented(estimates, by)
    order = np.lexsort((-_oriented(estimates, finer), -value))
    agents, estimates, value = [agents[i] for i in order], [estimates[i] for i in order], value[order]
    if not np.isfinite(value).any():
        raise ReportError(f"no agent has values of {rank_by}")
    table = st.moderated(by.table(agents))
    pairs = st.pairs(table, confidence)
    p, adjusted = _p_values(agents, by, table, pairs)
    resolved = adjusted < 1 - confidence
    scores = [_score(agent, by, finer) for agent in agents]
    best = _probability_best(agents, by, finer, seed, resamples)
    ranks, intervals = _ranks(value, _oriented(estimates, finer)), _rank_intervals(value, resolved)
    groups = st.letters(resolved)
    adjusted = _planned(p, adjusted, agents, reference)
    comparisons = []
    for i, j in _listed(agents, reference):
        comparisons.append(
            Comparison(
                first=agents[i].label,
                second=agents[j].label,
                metric=rank_by,
                difference=pairs.estimate(i, j, table, confidence),
                p_value=float(p[i, j]),
                p_adjusted=float(adjusted[i, j]),
                probability_of_improvement=st.improvement(scores[i], scores[j], confidence),
            )
        )
    rows = tuple(
        Row(
            label=agent.label,
            key=agent.key,
            seeds=tuple(run.seed for run in agent.runs),
            run_ids=tuple(run.id for run in agent.runs),
            episodes=agent.outcome.shape[1],
            rank=int(ranks[i]),
            rank_interval=intervals[i],
            probability_best=float(best[i]),
            group=groups[i],
            estimates=estimates[i],
            trained=learns(agent),
        )
        for i, agent in enumerate(agents)
    )
    name = _protocol(agents) if protocol is None else protocol
    return Ranking(
        rows=rows,
        rank_by=rank_by,
        then=then,
        protocol=name,
        condition=condition,
        fingerprint=agents[0].fingerprint,
        confidence=confidence,
        baseline=None if reference is None else reference.label,
        comparisons=tuple(comparisons),
        improvement=st.improvement_matrix(scores),
        problems=(*problems, *_without_values(agents, (by, finer))),
        conditions=successes(agents, name, confidence),
    )


def _check(agents: Sequence[Agent], confidence: float) -> None:
    if not agents:
        raise ReportError("there are no agents to rank")
    if not 0.5 <= confidence < 1:
        raise ReportError(f"confidence {confidence} is not in [0.5, 1), for example 0.95")
    labels = [agent.label for agent in agents]
    if twice := sorted({label for label in labels if labels.count(label) > 1}):
        raise ReportError(f"two agents have the label {twice[0]!r}: group by one more key")
    scenarios = {(agent.fingerprint, agent.outcome.shape[1]) for agent in agents}
    if len(scenarios) > 1:
        found = ", ".join(f"{fingerprint} ({n} episodes)" for fingerprint, n in sorted(scenarios))
        raise ReportError(f"the agents met different scenarios and cannot share a table: {found}")


def find_baseline(agents: Sequence[Agent], name: str) -> Agent:
    """The agent of that label (letter case aside), or of that algorithm if it is the only one.

    Raises:
        ReportError: none or several; lists the labels.
    """
    wanted = name.casefold()
    exact = [agent for agent in agents if agent.label == name]
    found = exact or [agent for agent in agents if agent.label.casefold() == wanted]
    found = found or [agent for agent in agents if str(agent.key.get("algo", "")).casefold() == wanted]
    if len(found) == 1:
        return found[0]
    if found:
        labels = ", ".join(sorted(agent.label for agent in found))
        raise ReportError(f"--baseline {name!r} is {len(found)} agents; give one of their labels: {labels}")
    hint = closest(name, (agent.label for agent in agents))
    raise ReportError(f"--baseline {name!r} is not among the agents; {hint}")


def _estimates(agents: Sequence[Agent], confidence: float) -> list[dict[str, Estimate]]:
    """By agent, the estimates of all measures; one that an agent lacks is NaN, never zero."""
    result: list[dict[str, Estimate]] = [{} for _ in agents]
    for m in all_measures(agents):
        for found, estimate in zip(result, st.means(m.table(agents, paired=False), confidence), strict=True):
            found[m.name] = estimate
    return result


def _oriented(estimates: Sequence[dict[str, Estimate]], m: Measure) -> FloatArray:
    """(n,) Values of which higher is better; an agent without a value comes after all others."""
    missing = Estimate(np.nan, np.nan, np.nan)
    # Rounded so that two agents with the same successes are equal whatever the order of summation.
    values = np.array([m.sign * e.get(m.name, missing).value for e in estimates]).round(12)
    return np.where(np.isnan(values), -np.inf, values)


def _p_values(
    agents: Sequence[Agent], by: Measure, table: st.Crossed, pairs: st.Pairs
) -> tuple[FloatArray, FloatArray]:
    """P (n, n) of no difference and Holm's adjusted ones over all pairs; NaN where there is no test.

    Rates of two agents with one seed each: McNemar's mid-p. Everything else: the t-type test of `pairs`, with
    variances between seeds moderated by all agents of the table.
    """
    p = pairs.p_value.copy()
    single = [i for i, agent in enumerate(agents) if len(agent.outcome) == 1]
    if by.rate and len(single) > 1:
        only = st.discordant(np.concatenate([by.values(agents[i]) for i in single]))
        p[np.ix_(single, single)] = st.mcnemar(only, only.T)
    upper = np.triu_indices(len(agents), 1)
    adjusted = np.full_like(p, np.nan)
    adjusted[upper] = st.holm(p[upper])
    adjusted.T[upper] = adjusted[upper]
    return p, adjusted


def _planned(
    p: FloatArray, adjusted: FloatArray, agents: Sequence[Agent], baseline: Agent | None
) -> FloatArray:
    """The adjusted p-values, with those of the comparisons with the baseline from a family of their own.

    Naming a baseline is asking n - 1 questions beforehand, as in Dunnett's comparisons with a control. Letters and
    ranks stay with the family of all pairs.
    """
    if baseline is None:
        return adjusted
    i = next(i for i, agent in enumerate(agents) if agent is baseline)
    others = [j for j in range(len(agents)) if j != i]
    result = adjusted.copy()
    result[i, others] = result[others, i] = st.holm(p[i, others])
    return result


def _score(agent: Agent, by: Measure, finer: Measure) -> FloatArray:
    """(S, E) of which higher is better on a scenario: what the probability of improvement compares."""
    values = by.values(agent)
    if by.rate:
        return st.score((values == 1) == by.higher_is_better, finer.sign * finer.values(agent))
    return np.where(np.isnan(values), -np.inf, by.sign * values)


def _probability_best(
    agents: Sequence[Agent], by: Measure, finer: Measure, seed: int, resamples: int
) -> FloatArray:
    """(n,) Share of the hierarchical bootstrap's resamples in which the agent is best; ties by `then`, then shared.

    Scenarios are drawn once for all agents. Each agent's seeds are drawn from a generator of its own label, so
    that neither the order nor the presence of other agents changes them.
    """
    scenarios = st.multiplicities(agents[0].outcome.shape[1], resamples, np.random.default_rng([seed, 0]))
    weights = []
    for agent in agents:
        rng = np.random.default_rng([seed, 1, zlib.crc32(agent.label.encode())])
        weights.append(st.seed_weights(len(agent.outcome), resamples, rng))
    best = np.ones((resamples, len(agents)), dtype=bool)
    for m in (by, finer):
        means = m.sign * st.paired_means([m.values(agent) for agent in agents], scenarios, weights)
        means = np.where(np.isnan(means), -np.inf, means.round(12))
        top = np.where(best, means, -np.inf).max(axis=1, keepdims=True)
        best &= means == top
    return np.asarray((best / best.sum(axis=1, keepdims=True)).mean(axis=0))


def _ranks(value: FloatArray, finer: FloatArray) -> NDArray[np.int64]:
    """(n,) Rank of agents that are sorted already; exactly equal ones share the better rank."""
    ranks = np.arange(1, len(value) + 1)
    for i in range(1, len(value)):
        if value[i] == value[i - 1] and finer[i] == finer[i - 1]:
            ranks[i] = ranks[i - 1]
    return ranks


def _rank_intervals(value: FloatArray, resolved: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """From 1 + the agents that are resolved to be better, to n - those that are resolved to be worse.

    Because the tests of all pairs hold together, so do these intervals: Mogstad, Romano, Shaikh & Wilhelm (2024,
    Rev. Econ. Stud. 91:476). Bootstrapped ranks do not have that property near ties (Xie, Singh & Zhang 2009).
    """
    better, worse = value[:, None] < value[None, :], value[:, None] > value[None, :]
    first = 1 + (resolved & better).sum(axis=1)
    last = len(value) - (resolved & worse).sum(axis=1)
    return [(int(a), int(b)) for a, b in zip(first, last, strict=True)]


def _listed(agents: Sequence[Agent], baseline: Agent | None) -> list[tuple[int, int]]:
    """Pairs (better placed, worse placed) that get a `Comparison`.

    Every pair of up to `ALL_PAIRS` agents; of more, the neighbours, the first with all, the baseline with all.
    """
    n = len(agents)
    every = [(i, j) for i in range(n) for j in range(i + 1, n)]
    if n <= ALL_PAIRS:
        return every
    middle = next((i for i, agent in enumerate(agents) if agent is baseline), 0)
    return [(i, j) for i, j in every if j == i + 1 or i == 0 or middle in (i, j)]


def _protocol(agents: Sequence[Agent]) -> str:
    """Name of the protocol whose scenarios the agents met, as their runs have it."""
    for agent in agents:
        for run in agent.runs:
            for name, evaluation in run.evaluations.items():
                if evaluation.fingerprint == agent.fingerprint:
                    return name
    return "test"


def _without_values(agents: Sequence[Agent], measures: Sequence[Measure]) -> list[Problem]:
    return [
        Problem(agent.label, "missing", f"has no values of {m.name}: it is last in the ranking, not zero")
        for agent in agents
        for m in measures
        if not np.isfinite(m.values(agent)).any()
    ]
