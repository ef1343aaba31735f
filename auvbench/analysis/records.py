"""Define the data passed between the parts of a report: loaded runs, agents, the ranking, the findings.

`load.py` reads `RunRecord`s, `grouping.py` groups them into `Agent`s, `ranking.py` computes a `Ranking`, and
`reporting` draws the result.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from auvbench.config.algorithms import learns as is_learner
from auvbench.runs.identity import DEFAULT_TASK
from auvbench.statistics.intervals import Estimate
from auvbench.statistics.reliability import Reliability
from auvbench.untrusted.text import short

if TYPE_CHECKING:
    from auvbench.analysis.grouping import Section
    from auvbench.analysis.sources import RunSource
    from auvbench.analysis.thesis import ComparisonRow

NO_POLICY = -1
"""outcome of every test episode of a failed training, which has no policy and so no success"""


@dataclass(frozen=True, slots=True, eq=False)
class Evaluation:
    """Evaluation of one run by one protocol."""

    protocol: str
    fingerprint: str
    """hash of the scenarios: rows with different fingerprints are never mixed in one table"""
    summary: Mapping[str, Any]
    """content of summary.json"""
    episodes: pd.DataFrame
    """one row per episode, with the columns of docs/protocol.md"""


@dataclass(frozen=True, slots=True, eq=False)
class RunRecord:
    """One run as read from disk."""

    id: str
    source: RunSource
    """where its files are"""
    state: str
    """state: pending | running | interrupted | failed | complete"""
    seed: int
    config: Mapping[str, Any]
    """resolved configuration by dotted keys: {"algo.name": "ppo", "reward.k": 1.0}"""
    manifest: Mapping[str, Any]
    evaluations: Mapping[str, Evaluation] = field(default_factory=dict)
    """evaluations by the protocol's name"""
    name: str = ""
    """name of the run's agent in the analysis (`names.name_agents`); '' for a label made from the configuration"""

    @property
    def directory(self) -> Path:
        """Return the folder by which messages name the run."""
        return self.source.directory


@dataclass(frozen=True, slots=True)
class Problem:
    """Reason that keeps a run, or a part of it, out of the tables; always named, never printed as zeros."""

    where: str
    """run id or path"""
    kind: str
    """kind: missing | failed | unfinished | damaged | foreign | duplicate"""
    message: str

    def __post_init__(self) -> None:
        # The two texts may quote untrusted files, and go to terminals and pages.
        object.__setattr__(self, "where", short(self.where, 1000))
        object.__setattr__(self, "message", short(self.message, 1000))


@dataclass(frozen=True, slots=True, eq=False)
class Agent:
    """All seeds of one configuration under one condition of one protocol: a row of the table.

    Every metric is an array (seeds, episodes). Column j is the same scenario for every agent, so differences
    are paired by column.
    """

    label: str
    """label such as 'PPO K=1 25 Hz', as short as the grouping allows"""
    key: Mapping[str, Any]
    """values of the keys that distinguish agents: {"algo": "ppo", "reward.k": 1.0, "step.frequency": 25.0}"""
    runs: tuple[RunRecord, ...]
    """one run per training seed, in the order of the metrics' rows"""
    fingerprint: str
    outcome: NDArray[np.int8]
    """(seeds, episodes) codes into `OUTCOMES`; `NO_POLICY` throughout for a seed whose training failed"""
    metrics: Mapping[str, NDArray[np.float64]]
    """(seeds, episodes) by column name; NaN throughout for a seed whose training failed"""
    step_limit: float
    """steps after which a test episode ends"""

    @property
    def success(self) -> NDArray[np.float64]:
        """Return (seeds, episodes) 1.0 for each successful episode."""
        return np.asarray(self.outcome == 0, dtype=np.float64)


def learns(agent: Agent) -> bool:
    """Return whether the agent was trained; K and the training frequency have no meaning otherwise."""
    return any(run_learns(run) for run in agent.runs)


def run_learns(run: RunRecord) -> bool:
    """Return whether the run is a training, even one that failed at its first step."""
    return bool(run.manifest.get("steps")) or is_learner(
        {key: run.config.get(f"algo.{key}") for key in ("agent", "learns")}
    )


def budget_of(run: RunRecord) -> int:
    """Return the budget of a training in environment steps; 0 if it is unknown.

    The steps taken may be more: PPO finishes the rollout in which its budget ends.
    """
    budget = run.config.get("train.total_steps") or run.manifest.get("total_steps")
    return int(budget or run.manifest.get("steps") or 0)


def task_of(run: RunRecord) -> str:
    """Return the name of a run's task; waypoint if the configuration has none."""
    return str(run.config.get("task.name", DEFAULT_TASK))


def run_ids(*groups: Sequence[Agent]) -> tuple[str, ...]:
    """Return the ids of the agents' runs without duplicates."""
    return tuple(dict.fromkeys(run.id for group in groups for agent in group for run in agent.runs))


@dataclass(frozen=True, slots=True)
class Row:
    """One agent's row of the ranking."""

    label: str
    key: Mapping[str, Any]
    seeds: tuple[int, ...]
    run_ids: tuple[str, ...]
    episodes: int
    """test episodes per seed"""
    rank: int
    rank_interval: tuple[int, int]
    """ranks that the tests leave open; 1 to the number of rows for an agent that is not compared"""
    estimates: Mapping[str, Estimate]
    """estimates by metric name: success_rate, collision_rate, timeout_rate, mean_steps, and mean_<column> for
    others
    """
    trained: bool = True
    """False for a controller, which has no spread between training seeds"""
    compared: bool = True
    """False for one training seed: the row describes one policy, and is not in any test"""
    budget: tuple[int, ...] = ()
    """budgets of its trainings in environment steps: one number, several if runs differ, none for a controller"""
    succeeded: int = 0
    """number of its trainings that reach at least half of the test goals"""
    failed_seeds: tuple[int, ...] = ()
    """members of `seeds` whose training failed; they count as success 0"""
    knows: tuple[str, ...] = ()
    """knowledge of the agent beyond noisy readings: sheet, model, preview, map, true velocities"""
    trials: int | None = None
    """number of trials that chose its settings; None if it was not recorded"""
    trial_steps: int | None = None
    """environment steps of these trials"""
    trial_s: float | None = None
    """processor time of these trials in s, with their tests"""


@dataclass(frozen=True, slots=True)
class Comparison:
    """Comparison of two agents on the ranking measure, paired by scenario."""

    first: str
    second: str
    metric: str
    difference: Estimate
    p_value: float
    p_adjusted: float
    """p-value with Holm's correction over all pairs of the table"""
    verdict: str = "undecided"
    """verdict on the first agent: better | worse | undecided"""
    trainings: int = 0
    """Number of trainings of the learner with fewer trainings; 0 for two controllers"""
    needed: int = 0
    """trainings from which a verdict needs no assumption about their distribution"""
    first_reliability: Reliability | None = None
    """trainings of the first agent that are not behind the second; None for a controller"""
    second_reliability: Reliability | None = None


@dataclass(frozen=True, slots=True)
class Needed:
    """Number of trainings or episodes that would decide an open comparison, with 80 % power if the observed
    difference is the true one.
    """

    unit: str
    """unit: trainings | episodes"""
    count: int | None
    """number of trainings or episodes; None: more than the planner tries"""


@dataclass(frozen=True, slots=True)
class Against:
    """Comparison of one agent with the baseline."""

    agent: str
    difference: Estimate
    """Typical training less baseline (typical training, if the baseline learns); all intervals hold simultaneously.
    With fewer than five trainings there are no limits.
    """
    verdict: str
    """verdict: ahead | equivalent | behind | open"""
    needed: Needed | None = None
    """Number of trainings or episodes that would decide an open comparison; None if it cannot be planned"""
    trainings: int = 0
    """Number of trainings of the learner with fewer trainings; 0 for two controllers"""
    enough: int = 0
    """trainings from which a verdict needs no assumption about their distribution"""
    reliability: Reliability | None = None
    """trainings of the agent that are not behind the baseline; if only the baseline learns, its trainings
    that are not behind the agent
    """
    of_baseline: bool = False
    """whether `reliability` is that of the baseline's trainings"""

    @property
    def own_reliability(self) -> Reliability | None:
        """Return the trainings of the agent that are not behind the baseline; None for a controller."""
        return None if self.of_baseline else self.reliability

    @property
    def few(self) -> bool:
        """Return whether a verdict from these trainings assumes that they cluster around the typical one."""
        return 0 < self.trainings < self.enough

    @property
    def starred(self) -> bool:
        """Return whether it is decided by few trainings: tables mark the verdict with a star."""
        return self.few and self.verdict != "open"

    @property
    def marked_verdict(self) -> str:
        """Return the verdict, with a star if it is decided by few trainings."""
        return f"{self.verdict}*" if self.starred else self.verdict


@dataclass(frozen=True, slots=True)
class Primary:
    """Primary analysis: each agent against one baseline on one measure."""

    measure: str
    baseline: str
    margin: float
    """smallest difference of interest, in the measure's unit (rates from 0 to 1); NaN without one"""
    confidence: float
    """simultaneous confidence of all intervals"""
    comparisons: tuple[Against, ...]
    """comparisons in the order of the table, without the baseline"""
    chosen_by_rank: bool = False
    """whether the baseline is the best agent of this table, because the table has no controller"""

    def of(self, label: str) -> Against | None:
        """Return the comparison of an agent; None for the baseline."""
        return next((c for c in self.comparisons if c.agent == label), None)

    def having(self, verdict: str) -> list[Against]:
        """Return the comparisons with a verdict, in the order of the table."""
        return [c for c in self.comparisons if c.verdict == verdict]


@dataclass(frozen=True, slots=True)
class Condition:
    """Success and primary measure under one condition of a protocol."""

    name: str
    """name such as nominal, current=0.5, vehicle=bluerov2-heavy"""
    success: Mapping[str, Estimate]
    """success rates by the agent's label; an agent that was not tested under the condition is absent"""
    success_change: Mapping[str, Estimate] = field(default_factory=dict)
    """success under the condition less success undisturbed, paired by seed and scenario"""
    par1_change: Mapping[str, Estimate] = field(default_factory=dict)
    """change of PAR-1 steps, in which a failure counts as the limit; absent if frequency or limit differ"""
    measured: Mapping[str, Estimate] = field(default_factory=dict)
    """primary measure; absent if it is a rate or a penalised time"""


@dataclass(frozen=True, slots=True)
class Limit:
    """Limit of the time to the goal: a reference for the agents, not an agent."""

    seconds: float
    """mean over the scenarios of the best known time"""
    steps: float
    proven_seconds: float
    """mean over the scenarios of the proven lower bound"""
    gap: float
    """median of the ratio of the best known time to the lower bound"""
    episodes: int


@dataclass(frozen=True, slots=True)
class Ranking:
    """The ranked table and its analyses."""

    rows: tuple[Row, ...]
    rank_by: str
    protocol: str
    condition: str
    fingerprint: str
    confidence: float
    primary: Primary | None
    """primary analysis; None for a table of one agent, or if no agent is compared"""
    comparisons: tuple[Comparison, ...]
    """exploratory comparisons of pairs of agents, corrected over all pairs"""
    problems: tuple[Problem, ...] = ()
    conditions: tuple[Condition, ...] = ()
    """all conditions of the protocol if it has several, including the ranking's"""
    columns: tuple[str, ...] = ()
    """further columns that the user asked for, names in `optional_columns.COLUMNS`"""
    machines: tuple[str, ...] = ()
    """columns of times from different processors; empty if all times are from the same one"""
    declaration: str = ""
    """sentence on whether the analysis was declared before the first run"""
    sealed: str = ""
    """files of a sealed protocol and what was not tested; '' for other protocols"""
    notices: tuple[str, ...] = ()
    """cautions to print before the table, e.g. unequal training budgets"""
    limit: Limit | None = None
    """best known times; None if not requested or not available"""
    no_limit: str = ""
    """reason why there is no limit, with the command that computes it"""
    task: str = DEFAULT_TASK
    """task of the scenarios"""

    def ordered(self, agents: Sequence[Agent]) -> list[Agent]:
        """Return the agents, all or some of the ranked ones, in the order of the rows."""
        by_label = {agent.label: agent for agent in agents}
        return [by_label[row.label] for row in self.rows if row.label in by_label]


@dataclass(frozen=True, slots=True)
class Finding:
    """A result in addition to the primary analysis, as data and as one sentence."""

    kind: str
    """name of the finding's template: a function in `findings` or a module next to it"""
    text: str
    agents: tuple[str, ...] = ()
    """labels of the agents in the finding"""
    estimate: Estimate | None = None
    """number of the finding, mostly a difference; rates from 0 to 1"""
    basis: str = ""
    """method in one clause"""
    run_ids: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class ClaimVerdict:
    """One claim of a study with its verdict."""

    text: str
    verdict: str = ""
    """verdict: holds | does not hold | cannot be said"""
    statistic: str = ""
    missing: str = ""
    run_ids: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Report:
    """Content of one section of a report, for all formats."""

    section: Section
    agents: Sequence[Agent]
    """agents in the order of the ranking"""
    ranking: Ranking
    findings: Sequence[Finding] = ()
    claims: Sequence[ClaimVerdict] = ()
    comparison: Sequence[ComparisonRow] = ()
    """the study's own numbers next to ours"""
    without_baseline: bool = False
    """whether the named baseline is missing from this section"""

    @property
    def runs(self) -> Sequence[RunRecord]:
        """Return every run of the section, tested or not."""
        return self.section.runs
