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
"""outcome code of every test episode of a failed training, which has no policy"""


@dataclass(frozen=True, slots=True, eq=False)
class Evaluation:
    """Evaluation of one run by one protocol."""

    protocol: str
    fingerprint: str
    """Digest of the scenarios and their physics; a table never contains rows with different fingerprints"""
    summary: Mapping[str, Any]
    """content of summary.json"""
    episodes: pd.DataFrame
    """one row per episode, with the columns of docs/protocol.md"""


@dataclass(frozen=True, slots=True, eq=False)
class RunRecord:
    """One run as read from disk."""

    id: str
    source: RunSource
    """source of the run's files: a run directory or a published study"""
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
    """Reason why a run or an evaluation is not in the tables; a report lists it, instead of printing zeros."""

    where: str
    """run id or path"""
    kind: str
    """kind: missing | failed | unfinished | damaged | foreign | duplicate"""
    message: str

    def __post_init__(self) -> None:
        # `where` and `message` may quote untrusted files, and terminals and pages show them.
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
    """Indices (seeds, episodes) of `OUTCOMES`; `NO_POLICY` in all episodes of a seed whose training failed"""
    metrics: Mapping[str, NDArray[np.float64]]
    """Values (seeds, episodes) by column name. A seed whose training failed has NaN, except in columns of the scenario"""
    step_limit: float
    """Number of steps after which a test episode ends"""

    @property
    def success(self) -> NDArray[np.float64]:
        """Return the successes (seeds, episodes): 1.0 for a successful episode, else 0.0."""
        return np.asarray(self.outcome == 0, dtype=np.float64)


def learns(agent: Agent) -> bool:
    """Return whether the agent was trained; K and the training frequency have no meaning for a controller."""
    return any(run_learns(run) for run in agent.runs)


def run_learns(run: RunRecord) -> bool:
    """Return whether the run is a training, even one that failed at its first step."""
    return bool(run.manifest.get("steps")) or is_learner(
        {key: run.config.get(f"algo.{key}") for key in ("agent", "learns")}
    )


def budget_of(run: RunRecord) -> int:
    """Return the budget of a training in environment steps; 0 if it is unknown.

    The training may take more steps: PPO finishes the rollout in which its budget ends.
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
    """Number of test episodes per seed"""
    rank: int
    rank_interval: tuple[int, int]
    """best and worst rank that the tests allow; 1 and the number of rows for an agent that is not compared"""
    estimates: Mapping[str, Estimate]
    """estimates by measure name: success_rate, collision_rate, timeout_rate, par1_steps, mean_<column>, ..."""
    trained: bool = True
    """False for a controller, which has no spread between training seeds"""
    compared: bool = True
    """False for a learner with one training seed, which is not tested against other agents"""
    budget: tuple[int, ...] = ()
    """distinct budgets of the agent's trainings in environment steps; empty for a controller"""
    succeeded: int = 0
    """Number of the agent's trainings that succeed in at least half of their test episodes"""
    failed_seeds: tuple[int, ...] = ()
    """Seeds whose training failed; each test episode of such a seed counts as failed"""
    knows: tuple[str, ...] = ()
    """knowledge of the agent beyond noisy readings: sheet, model, preview, map, true velocities"""
    trials: int | None = None
    """number of tuning trials that chose the agent's settings; None if the number was not recorded"""
    trial_steps: int | None = None
    """environment steps of the tuning trials"""
    trial_s: float | None = None
    """processor time of the tuning trials in s, including the tests of the trials"""


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
    """Number of trainings of the learner, or the smaller number of two learners; 0 for two controllers"""
    needed: int = 0
    """smallest number of trainings for which a verdict assumes nothing about the distribution of trainings"""
    first_reliability: Reliability | None = None
    """reliability of the first agent against the second; None for a controller"""
    second_reliability: Reliability | None = None


@dataclass(frozen=True, slots=True)
class Needed:
    """Number of trainings or episodes that would decide an open comparison with 80 % power, if the observed
    difference is the true difference.
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
    """Agent's value minus the baseline's value, with an interval; the intervals of all comparisons hold simultaneously.
    A learner's value is the value of its typical training. The limits are NaN for a learner with fewer than five
    trainings.
    """
    verdict: str
    """verdict: ahead | equivalent | behind | open"""
    needed: Needed | None = None
    """Number of trainings or episodes that would decide an open comparison; None if it cannot be planned"""
    trainings: int = 0
    """Number of trainings of the learner, or the smaller number of two learners; 0 for two controllers"""
    enough: int = 0
    """smallest number of trainings for which a verdict assumes nothing about the distribution of trainings"""
    reliability: Reliability | None = None
    """reliability of the agent's trainings against the baseline; if only the baseline learns, reliability of the
    baseline's trainings against the agent
    """
    of_baseline: bool = False
    """whether `reliability` counts the baseline's trainings"""

    @property
    def own_reliability(self) -> Reliability | None:
        """Return the reliability of the agent's trainings against the baseline; None for a controller."""
        return None if self.of_baseline else self.reliability

    @property
    def few(self) -> bool:
        """Return whether a verdict has to assume that trainings cluster around the typical training, because they are few."""
        return 0 < self.trainings < self.enough

    @property
    def starred(self) -> bool:
        """Return whether the verdict is decided by few trainings; tables mark such a verdict with a star."""
        return self.few and self.verdict != "open"

    @property
    def marked_verdict(self) -> str:
        """Return the verdict, with a star if few trainings decide it."""
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
        """Return the comparisons with the given verdict, in the order of the table."""
        return [c for c in self.comparisons if c.verdict == verdict]


@dataclass(frozen=True, slots=True)
class Condition:
    """Success and primary measure under one condition of a protocol."""

    name: str
    """name such as nominal, current=0.5, vehicle=bluerov2-heavy"""
    success: Mapping[str, Estimate]
    """success rates by the agent's label; an agent that was not tested under the condition is absent"""
    success_change: Mapping[str, Estimate] = field(default_factory=dict)
    """success under this condition minus success under the undisturbed condition, paired by seed and scenario"""
    par1_change: Mapping[str, Estimate] = field(default_factory=dict)
    """PAR-1 steps (a failure counts as the limit) under this condition minus PAR-1 steps under the undisturbed condition;
    absent if the two conditions have different frequencies or step limits
    """
    measured: Mapping[str, Estimate] = field(default_factory=dict)
    """means of the primary measure by label; empty if the measure is a rate or a penalised time"""


@dataclass(frozen=True, slots=True)
class Limit:
    """Best known time to the goal, and the proven lower bound of any time to the goal: references without a rank."""

    seconds: float
    """Mean of the best known time over the scenarios, s"""
    steps: float
    proven_seconds: float
    """Mean of the proven lower bound over the scenarios, s"""
    gap: float
    """Median over the scenarios of the best known time divided by the lower bound"""
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
    """results under all conditions of the protocol, including the ranking's condition; empty if the protocol has one condition"""
    columns: tuple[str, ...] = ()
    """optional columns that the user requested: names in `optional_columns.COLUMNS`, or measures"""
    machines: tuple[str, ...] = ()
    """cautions about times from different processors; empty if all times are from the same processor"""
    declaration: str = ""
    """sentence on whether the analysis was declared before the first run"""
    sealed: str = ""
    """note on the files of a sealed protocol and the untested conditions; '' for other protocols"""
    notices: tuple[str, ...] = ()
    """Cautions to print before the table: agents tuned on the table's scenarios, or agents with the measure's worst value"""
    limit: Limit | None = None
    """Best known times; None if they are not available (see `no_limit`)"""
    no_limit: str = ""
    """Reason why no best known times are available; '' otherwise"""
    task: str = DEFAULT_TASK
    """task of the scenarios"""

    def ordered(self, agents: Sequence[Agent]) -> list[Agent]:
        """Return the given agents in the order of the ranking's rows."""
        by_label = {agent.label: agent for agent in agents}
        return [by_label[row.label] for row in self.rows if row.label in by_label]


@dataclass(frozen=True, slots=True)
class Finding:
    """A result in addition to the primary analysis, as data and as one sentence."""

    kind: str
    """name of the function that makes the finding, in `findings` or in another module of this package"""
    text: str
    agents: tuple[str, ...] = ()
    """labels of the agents in the finding"""
    estimate: Estimate | None = None
    """main number of the finding, usually a difference; rates from 0 to 1"""
    basis: str = ""
    """statistical method in one clause"""
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
    """numbers of the original study, each with our estimate"""
    without_baseline: bool = False
    """whether the named baseline is missing from this section"""

    @property
    def runs(self) -> Sequence[RunRecord]:
        """Return every run of the section, tested or not."""
        return self.section.runs
