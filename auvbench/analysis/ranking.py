"""Compute the ranked table; docs/statistics.md explains every number."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from auvbench import statistics as st
from auvbench.analysis.conditions import results
from auvbench.analysis.formatting import listed
from auvbench.analysis.measures import Measure, all_measures, measure, to_rank_by
from auvbench.analysis.pairwise import all_pairs, rank_intervals
from auvbench.analysis.primary import (
    at_limit,
    default_margin,
    find_baseline,
    primary_analysis,
    with_reliability,
)
from auvbench.analysis.records import (
    NO_POLICY,
    Agent,
    Problem,
    Ranking,
    Row,
    RunRecord,
    budget_of,
    learns,
    task_of,
)
from auvbench.analysis.typical import Typical
from auvbench.errors import ReportError
from auvbench.statistics.intervals import BoolArray, Estimate, FloatArray

FINER = "par1_steps"
"""measure that orders agents whose values of the ranking measure are exactly equal"""
ALL_PAIRS = 30
"""largest number of compared agents for which `Ranking.comparisons` has all pairs"""


def rank(
    agents: Sequence[Agent],
    *,
    rank_by: str = "success_rate",
    baseline: str | None = None,
    confidence: float = 0.95,
    margin: float | None = None,
    protocol: str = "test",
    condition: str = "nominal",
    problems: Sequence[Problem] = (),
) -> Ranking:
    """Rank agents by one measure and compare each with a baseline; the order of the agents does not matter.

    Rows are sorted by typical values (medians over trainings). The primary analysis compares each agent with
    the baseline. Rank intervals and comparisons are exploratory: they come from the tests of all pairs.

    Args:
        agents: agents of one protocol and condition, with the same scenarios.
        rank_by: primary measure, a name in `measures.measures`; means of steps and times rank by their
            penalised mean (`measures.RANKED_AS`), so that a failure counts.
        baseline: label of an agent, or an algorithm that only one agent has; None chooses one.
        confidence: confidence of all intervals.
        margin: smallest difference of interest in the unit of `rank_by` (rates from 0 to 1); None: the
            default.
        protocol: protocol of the test.
        condition: condition to name in the table.
        problems: problems to name in the table.

    Raises:
        ReportError: there are no agents, the measure or baseline is unknown, two labels are equal, or
            scenarios differ.
    """
    by, finer = to_rank_by(rank_by), measure(FINER)
    _check(agents, confidence, margin)
    agents = sorted(map(one_run_of_a_controller, agents), key=lambda agent: agent.label)
    reference = None if baseline is None else find_baseline(agents, baseline)
    value, second = (_oriented(Typical(agents, m)) for m in (by, finer))
    if not np.isfinite(value).any():
        raise ReportError(f"no agent has values of {by.name}")
    order = np.lexsort((-second, -value))
    agents, value, second = [agents[i] for i in order], value[order], second[order]
    estimates = _estimates(agents, confidence)
    compared = np.array([not one_policy(agent) for agent in agents])
    tests = all_pairs(agents, by, compared, confidence)
    ranks = _ranks(value, second)
    intervals = rank_intervals(value, tests.resolved)
    rows = tuple(
        Row(
            label=agent.label,
            key=agent.key,
            seeds=tuple(run.seed for run in agent.runs),
            run_ids=tuple(run.id for run in agent.runs),
            episodes=agent.outcome.shape[1],
            rank=int(ranks[i]),
            rank_interval=intervals[i],
            estimates=estimates[i],
            trained=learns(agent),
            compared=bool(compared[i]),
            budget=tuple(sorted({budget_of(run) for run in agent.runs})) if learns(agent) else (),
            succeeded=st.succeeded(agent.success),
            failed_seeds=tuple(
                run.seed
                for run, outcome in zip(agent.runs, agent.outcome, strict=True)
                if (outcome == NO_POLICY).all()
            ),
        )
        for i, agent in enumerate(agents)
    )
    primary = primary_analysis(agents, tests, compared, reference, margin)
    apart = primary.margin if primary else default_margin(by, tests.typical.value[0])
    pairs = _listed(compared)
    pairwise = zip(pairs, tests.comparisons(agents, pairs), strict=True)
    return Ranking(
        rows=rows,
        rank_by=by.name,
        protocol=protocol,
        condition=condition,
        fingerprint=agents[0].fingerprint,
        confidence=confidence,
        primary=primary,
        comparisons=tuple(with_reliability(c, agents, tests.typical, pair, apart) for pair, c in pairwise),
        problems=(*problems, *_without_values(agents, (by, finer))),
        conditions=results(agents, protocol, confidence, by),
        notices=tuple(filter(None, (tuned_on_these(agents, protocol), at_limit(agents, tests, primary)))),
        task=task_of(agents[0].runs[0]),
    )


def _check(agents: Sequence[Agent], confidence: float, margin: float | None) -> None:
    if not agents:
        raise ReportError("there are no agents to rank")
    if margin is not None and not 0 < margin < np.inf:
        raise ReportError(f"margin must be a positive number, got {margin:g}")
    if not 0.5 <= confidence < 1:
        raise ReportError(
            f"confidence must be at least 0.5 and less than 1, for example 0.95, got {confidence}"
        )
    labels = [agent.label for agent in agents]
    if twice := sorted({label for label in labels if labels.count(label) > 1}):
        raise ReportError(f"two agents have the label {twice[0]!r}; each agent must have its own label")
    scenarios = {(agent.fingerprint, agent.outcome.shape[1]) for agent in agents}
    if len(scenarios) > 1:
        listing = ", ".join(f"{fingerprint} ({n} episodes)" for fingerprint, n in sorted(scenarios))
        raise ReportError(f"the agents met different scenarios and cannot share a table: {listing}")


def _estimates(agents: Sequence[Agent], confidence: float) -> list[dict[str, Estimate]]:
    """Return the estimates of all measures by name, for each agent; a measure that an agent lacks is NaN."""
    by_measure = {m.name: st.means(m.table(agents, paired=False), confidence) for m in all_measures(agents)}
    return [{name: estimates[i] for name, estimates in by_measure.items()} for i in range(len(agents))]


def _oriented(typical: Typical) -> FloatArray:
    """Return typical values (n,), signed so that higher is better; an agent without a value is last."""
    # Round the values: agents with equal successes then have exactly equal values in spite of rounding errors of sums.
    values = (typical.measure.sign * typical.value).round(12)
    return np.where(np.isnan(values), -np.inf, values)


def _ranks(value: FloatArray, finer: FloatArray) -> NDArray[np.int64]:
    """Return the ranks (n,) of sorted agents; exactly equal agents share the better rank."""
    ranks = np.arange(1, len(value) + 1)
    for i in range(1, len(value)):
        if value[i] == value[i - 1] and finer[i] == finer[i - 1]:
            ranks[i] = ranks[i - 1]
    return ranks


def _listed(compared: BoolArray) -> list[tuple[int, int]]:
    """Return the pairs (better, worse) that get a `Comparison`.

    Up to `ALL_PAIRS` compared agents, these are all pairs. For more agents, these are the pairs of neighbours
    in the ranking and the pairs with the best agent.
    """
    indices = [int(i) for i in np.flatnonzero(compared)]
    if len(indices) <= ALL_PAIRS:
        return list(combinations(indices, 2))
    return [
        (i, j)
        for i, j in combinations(indices, 2)
        if i == indices[0] or indices.index(j) == indices.index(i) + 1
    ]


def _without_values(agents: Sequence[Agent], measures: Sequence[Measure]) -> list[Problem]:
    return [
        Problem(
            agent.label,
            "missing",
            f"has no values of {m.name}, so it is last in the ranking; a missing value does not count as 0",
        )
        for agent in agents
        for m in measures
        if not np.isfinite(m.values(agent)).any()
    ]


def one_policy(agent: Agent) -> bool:
    """Return whether the agent has a single training, so that the spread of its trainings is unknown."""
    return learns(agent) and len(agent.outcome) == 1


def one_run_of_a_controller(agent: Agent) -> Agent:
    """Return a controller with only its first run, since its seeds are not a sample; return a learner unchanged."""
    if learns(agent) or len(agent.runs) < 2:
        return agent
    metrics = {column: values[:1] for column, values in agent.metrics.items()}
    return replace(agent, runs=agent.runs[:1], outcome=agent.outcome[:1], metrics=metrics)


def tuned_on_these(agents: Sequence[Agent], protocol: str) -> str:
    """Return a warning for a table with agents that were tuned on its scenarios; '' without such agents."""
    labels = [agent.label for agent in agents if any(_on_these(run, protocol) for run in agent.runs)]
    if not labels:
        return ""
    single = len(labels) == 1
    return (
        f"{listed(labels, 4)} {'was' if single else 'were'} tuned on the scenarios of this table (protocol {protocol}): "
        f"{'its settings are' if single else 'their settings are each'} the best of many trials, so the result is "
        "optimistic (selection bias), and this is not a valid ranking. Use protocol=test, whose scenarios no tuning sees."
    )


def _on_these(run: RunRecord, protocol: str) -> bool:
    """Return whether the run's settings were chosen on the scenarios of its evaluation by this protocol."""
    config = run.config
    evaluation = run.evaluations.get(protocol)
    if config.get("algo.tuned.protocol") is None or evaluation is None:
        return False
    return all(evaluation.summary[key] == config.get(f"algo.tuned.{key}") for key in ("scenarios", "seed"))
