"""What passes between the parts of a report: loaded runs, agents, the ranking, the findings.

`load.py` reads `RunRecord`s, `grouping.py` groups them into `Agent`s, `ranking.py` turns agents into a `Ranking`, and
`reporting` draws what it is handed.
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
from auvbench.statistics.intervals import Estimate
from auvbench.statistics.reliability import Reliability
from auvbench.untrusted.text import short

if TYPE_CHECKING:
    from auvbench.analysis.archive import Archive
    from auvbench.analysis.grouping import Section
    from auvbench.analysis.thesis import ComparisonRow

NO_POLICY = -1
"""outcome of every test episode of a training that failed: there is no policy, so no success"""


@dataclass(frozen=True, slots=True, eq=False)
class Evaluation:
    """One protocol applied to one run."""

    protocol: str
    fingerprint: str
    """hash of the scenarios: rows of different fingerprints are never mixed in one table"""
    summary: Mapping[str, Any]
    """summary.json as read"""
    episodes: pd.DataFrame
    """a row per episode; the columns of docs/protocol.md"""
    directory: Path
    archive: Archive | None = None
    """the published study that holds the evaluation"""


@dataclass(frozen=True, slots=True, eq=False)
class RunRecord:
    """One run directory as read from disk."""

    id: str
    directory: Path
    state: str
    """pending | running | interrupted | failed | complete"""
    seed: int
    config: Mapping[str, Any]
    """the resolved configuration, flattened to dotted keys: {"algo.name": "ppo", "reward.k": 1.0}"""
    manifest: Mapping[str, Any]
    evaluations: Mapping[str, Evaluation] = field(default_factory=dict)
    """by the protocol's name"""
    archive: Archive | None = None
    """the published study that holds the run; None for a run directory"""
    name: str = ""
    """of its agent in the analysis (`names.name_agents`); empty for a label made from the configuration"""


@dataclass(frozen=True, slots=True)
class Problem:
    """Something that keeps a run, or a part of it, out of the tables; always named, never printed as zeros."""

    where: str
    """run id or path"""
    kind: str
    """missing | failed | unfinished | damaged | foreign | duplicate"""
    message: str

    def __post_init__(self) -> None:
        # Both may quote foreign files, and go to terminals and pages.
        object.__setattr__(self, "where", short(self.where, 1000))
        object.__setattr__(self, "message", short(self.message, 1000))


@dataclass(frozen=True, slots=True, eq=False)
class Agent:
    """All seeds of one configuration on one condition of one protocol: a row of the table.

    Every metric is an array (seeds, episodes); column j is the same scenario for every agent, so differences
    are paired by column.
    """

    label: str
    """'PPO K=1 25 Hz', as short as the grouping allows"""
    key: Mapping[str, Any]
    """the values of the keys that tell agents apart: {"algo": "ppo", "reward.k": 1.0, "step.frequency": 25.0}"""
    runs: tuple[RunRecord, ...]
    """one per training seed, in the order of the rows of the metrics"""
    fingerprint: str
    outcome: NDArray[np.int8]
    """(seeds, episodes) codes into `OUTCOMES`; `NO_POLICY` throughout for a seed whose training failed"""
    metrics: Mapping[str, NDArray[np.float64]]
    """by column name: (seeds, episodes); NaN throughout for a seed whose training failed"""
    step_limit: float
    """steps after which a test episode ends"""

    @property
    def success(self) -> NDArray[np.float64]:
        """(seeds, episodes) 1.0 where the episode ended in success."""
        return np.asarray(self.outcome == 0, dtype=np.float64)


def learns(agent: Agent) -> bool:
    """Whether the agent was trained: K and the training frequency mean nothing to one that was not."""
    return any(run_learns(run) for run in agent.runs)


def run_learns(run: RunRecord) -> bool:
    """Whether the run is a training, one that failed at its first step included."""
    return bool(run.manifest.get("steps")) or is_learner(
        {key: run.config.get(f"algo.{key}") for key in ("agent", "learns")}
    )


def budget_of(run: RunRecord) -> int:
    """Return the environment steps that a training was given; 0 where they are unknown.

    Not those that were taken: PPO finishes the rollout in which its budget ends.
    """
    given = run.config.get("train.total_steps") or run.manifest.get("total_steps")
    return int(given or run.manifest.get("steps") or 0)


def task_of(run: RunRecord) -> str:
    """Return the name of a run's task; waypoint where the configuration names none."""
    return str(run.config.get("task.name", "waypoint"))


def run_ids(*groups: Sequence[Agent]) -> tuple[str, ...]:
    """Return the ids of the agents' runs, each once."""
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
    """ranks that the tests leave open; 1 to the number of rows for one that is not compared"""
    estimates: Mapping[str, Estimate]
    """by metric name: success_rate, collision_rate, timeout_rate, mean_steps, and mean_<column> for the others"""
    trained: bool = True
    """False for a controller that does not learn: it has no training seeds to be unsure of"""
    compared: bool = True
    """False for one training seed: the row describes one policy, and takes no part in any test"""
    budget: tuple[int, ...] = ()
    """environment steps that its trainings were given: one number, several if runs differ, none for a controller"""
    succeeded: int = 0
    """how many of its trainings reach at least half of the test goals"""
    failed_seeds: tuple[int, ...] = ()
    """those of `seeds` whose training failed and counts as success 0"""
    knows: tuple[str, ...] = ()
    """what the agent knows beyond noisy readings: sheet, model, preview, true velocities"""
    trials: int | None = None
    """trials that chose its settings; None where none are recorded"""


@dataclass(frozen=True, slots=True)
class Comparison:
    """Two agents of the table on the measure it is ranked by, paired by scenario."""

    first: str
    second: str
    metric: str
    difference: Estimate
    p_value: float
    p_adjusted: float
    """Holm-corrected over all pairs of the table"""
    verdict: str = "undecided"
    """of the first agent: better | worse | undecided"""
    trainings: int = 0
    """of the learner with the fewer trainings; 0 for two controllers"""
    needed: int = 0
    """trainings from which a verdict needs no assumption of their distribution"""
    first_reliability: Reliability | None = None
    """trainings of the first agent that are not behind the second; None for a controller"""
    second_reliability: Reliability | None = None


@dataclass(frozen=True, slots=True)
class Needed:
    """What would decide an open comparison, with 80 % power if the true difference is the one seen."""

    unit: str
    """trainings | episodes"""
    count: int | None
    """None: more than is planned for"""


@dataclass(frozen=True, slots=True)
class Against:
    """One agent against the baseline."""

    agent: str
    difference: Estimate
    """Typical training less the (typical) baseline; the intervals of all comparisons hold together. No ends for fewer than five
    trainings."""
    verdict: str
    """ahead | equivalent | behind | open"""
    needed: Needed | None = None
    """for an open comparison that can be planned"""
    trainings: int = 0
    """of the learner with the fewer trainings; 0 for two controllers"""
    enough: int = 0
    """trainings from which a verdict needs no assumption of their distribution"""
    reliability: Reliability | None = None
    """trainings of the agent that are not behind the baseline; of a learner as baseline, its own that are not behind the agent"""

    @property
    def few(self) -> bool:
        """Whether the verdict has fewer trainings than it needs, and holds only if they cluster around the typical one."""
        return 0 < self.trainings < self.enough

    @property
    def marked(self) -> str:
        """Return the verdict, with a star where it holds only if trainings cluster around the typical one."""
        return f"{self.verdict}*" if self.few and self.verdict != "open" else self.verdict


@dataclass(frozen=True, slots=True)
class Primary:
    """The primary analysis: each agent against one baseline on one measure."""

    measure: str
    baseline: str
    margin: float
    """smallest difference of interest, in the measure's unit (rates from 0 to 1); NaN where there is none"""
    confidence: float
    """of all intervals together"""
    comparisons: tuple[Against, ...]
    """in the order of the table, without the baseline"""
    chosen_by_rank: bool = False
    """the baseline is the best of this very table, because no controller is in it"""

    def of(self, label: str) -> Against | None:
        """Return the comparison of an agent; None for the baseline."""
        return next((c for c in self.comparisons if c.agent == label), None)

    def having(self, verdict: str) -> list[Against]:
        """Return the comparisons with a verdict, in the order of the table."""
        return [c for c in self.comparisons if c.verdict == verdict]


@dataclass(frozen=True, slots=True)
class Condition:
    """Success and the measure of the task under one condition of a protocol."""

    name: str
    """nominal, current=0.5, vehicle=bluerov2-heavy"""
    success: Mapping[str, Estimate]
    """by the agent's label; an agent that was not tested under it is absent"""
    success_change: Mapping[str, Estimate] = field(default_factory=dict)
    """success under it less success undisturbed, paired by seed and scenario"""
    par1_change: Mapping[str, Estimate] = field(default_factory=dict)
    """the same of PAR-1 steps, in which a failure counts as the limit; absent where frequency or limit differ"""
    measured: Mapping[str, Estimate] = field(default_factory=dict)
    """the measure that ranks; absent where it is a rate or a penalised time"""


@dataclass(frozen=True, slots=True)
class Limit:
    """How soon the vehicle could be there: what agents are set in relation to, and no agent itself."""

    seconds: float
    """mean over the scenarios of the shortest time that is known"""
    steps: float
    proven_seconds: float
    """mean of what is proven to be the least"""
    gap: float
    """median of the shortest time known over what is proven"""
    episodes: int


@dataclass(frozen=True, slots=True)
class Ranking:
    """The ranked table and what stands behind it."""

    rows: tuple[Row, ...]
    rank_by: str
    protocol: str
    condition: str
    fingerprint: str
    confidence: float
    primary: Primary | None
    """None for a table of one agent, or where no agent is compared"""
    comparisons: tuple[Comparison, ...]
    """exploratory: pairs of agents, corrected over all pairs"""
    problems: tuple[Problem, ...] = ()
    conditions: tuple[Condition, ...] = ()
    """all of the protocol where it has several, that of the ranking among them"""
    columns: tuple[str, ...] = ()
    """further columns that were asked for, as names of `optional_columns.COLUMNS`"""
    machines: tuple[str, ...] = ()
    """which of the times among them were taken on other processors; nothing where all are of one"""
    declaration: str = ""
    """whether the analysis was declared before the first run"""
    sealed: str = ""
    """Files of a sealed protocol and what was not tested; empty for other protocols"""
    notices: tuple[str, ...] = ()
    """what must be read before the table: unequal budgets of training"""
    limit: Limit | None = None
    """None where it was not looked for, or there is none"""
    no_limit: str = ""
    """why there is none, with the command that computes it"""
    task: str = "waypoint"
    """of its scenarios"""

    def ordered(self, agents: Sequence[Agent]) -> list[Agent]:
        """Return the agents, all or some of those ranked, in the order of the rows."""
        by_label = {agent.label: agent for agent in agents}
        return [by_label[row.label] for row in self.rows if row.label in by_label]


@dataclass(frozen=True, slots=True)
class Finding:
    """What the data show in addition to the primary analysis, as data and as one sentence."""

    kind: str
    """name of its template: a function in `findings` or a module next to it"""
    text: str
    agents: tuple[str, ...] = ()
    """labels that it is about"""
    estimate: Estimate | None = None
    """its number, mostly a difference; rates from 0 to 1"""
    basis: str = ""
    """how it was computed, in one clause"""
    run_ids: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class ClaimVerdict:
    """One claim of a study with its verdict."""

    text: str
    verdict: str = ""
    """holds | does not hold | cannot be said"""
    statistic: str = ""
    missing: str = ""
    run_ids: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Report:
    """Everything that the formats show of one section."""

    section: Section
    agents: Sequence[Agent]
    """in the order of the ranking"""
    ranking: Ranking
    findings: Sequence[Finding] = ()
    claims: Sequence[ClaimVerdict] = ()
    comparison: Sequence[ComparisonRow] = ()
    """the study's own numbers next to ours"""
    without_baseline: bool = False
    """the baseline that was named is not in this section"""

    @property
    def runs(self) -> Sequence[RunRecord]:
        """Every run that was found, with or without an evaluation."""
        return self.section.runs
