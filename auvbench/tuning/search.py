"""Search settings with an Optuna study. A trial climbs rungs, which are increasing training budgets.

The search decides what to train next; it does not train.
"""

from __future__ import annotations

import copy
import math
import warnings
from collections import deque
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any

import optuna
from optuna.pruners import BasePruner, NopPruner, SuccessiveHalvingPruner
from optuna.samplers import BaseSampler, RandomSampler, TPESampler
from optuna.storages import JournalStorage
from optuna.study import Study
from optuna.trial import FrozenTrial, Trial, TrialState

from auvbench.analysis.grouping import agents
from auvbench.analysis.load import load
from auvbench.analysis.measures import Measure, to_rank_by
from auvbench.analysis.records import Agent
from auvbench.config import schema
from auvbench.config.compose import with_groups
from auvbench.errors import AuvbenchError, ConfigError, RunError
from auvbench.runs.directory import RunDirectory
from auvbench.statistics import crossed, means
from auvbench.statistics.intervals import Estimate
from auvbench.tuning.folder import Journal, Plan
from auvbench.tuning.space import of_preset, with_values

optuna.logging.set_verbosity(optuna.logging.ERROR)  # the study has its own display
# Multivariate TPE is experimental: its interface may change, but Optuna's version is pinned.
warnings.filterwarnings("ignore", category=optuna.exceptions.ExperimentalWarning)


@dataclass(frozen=True, slots=True)
class Score:
    """Score of a trial at a rung."""

    score: float
    """number that ranks the trials; higher is better"""
    objective: float
    low: float
    high: float
    """upper limit of the objective's 95 % interval; the interval covers validation episodes and, with several seeds,
    training seeds
    """
    then: float

    @property
    def estimate(self) -> Estimate:
        """Return the objective with its interval."""
        return Estimate(self.objective, self.low, self.high)

    def plain(self) -> list[float | None]:
        """Return the score as a list for the journal, with None for NaN and infinity, which JSON lacks."""
        return [value if math.isfinite(value) else None for value in astuple(self)]


def of_plain(plain: Any) -> Score:
    """Return the score from a list of the journal (`Score.plain`).

    Raises:
        TypeError, ValueError: the value is not a score.
    """
    return Score(*(math.nan if value is None else float(value) for value in plain))


@dataclass(frozen=True, slots=True)
class Objective:
    """Measures that decide which trial is best: `measure`; if trials have equal rates in `measure`, `then`."""

    measure: Measure
    then: Measure

    def of(self, runs: Sequence[RunDirectory], protocol: str) -> Score:
        """Return the score of a trial's runs, all tested by the protocol.

        Raises:
            RunError: an evaluation is missing or damaged.
        """
        agent = tested(runs, protocol)
        estimate, then = interval(agent, self.measure), interval(agent, self.then).value
        if not math.isfinite(estimate.value):
            raise RunError(f"{runs[0].path}: has no {self.measure.name} on {protocol}")
        score = self._joined(agent, estimate.value, then)
        return Score(score, estimate.value, estimate.low, estimate.high, then)

    def _joined(self, agent: Agent, value: float, then: float) -> float:
        """Return one number that ranks by both measures.

        If the first measure is a rate, the second measure changes the number by less than one episode would. So the second
        measure decides only between equal rates. If the first measure is not a rate, the second measure has no effect.
        """
        score = self.measure.sign * value
        if not self.measure.rate or not math.isfinite(then):
            return score
        least, most = (float(end[0]) for end in self.then.bounds([agent]))
        if math.isfinite(least) and math.isfinite(most) and most > least:
            share = (then - least) / (most - least)
        else:
            share = 0.5 + 0.5 * then / (1 + abs(then))
        return score + self.then.sign * 0.5 * share / agent.outcome.size


def objective(name: str, then: str) -> Objective:
    """Return the objective for two measures.

    Raises:
        ReportError: a measure is unknown.
    """
    return Objective(to_rank_by(name, "tune.objective"), to_rank_by(then, "tune.then"))


def tested(runs: Sequence[RunDirectory], protocol: str) -> Agent:
    """Return the validation episodes of runs as one `Agent`, after a check of the files' digests.

    Raises:
        RunError: an evaluation is missing or damaged, or the runs have different scenarios.
        ReportError: a run is missing.
    """
    records, problems = load([run.path for run in runs], protocol)
    episodes = [r.evaluations[protocol].episodes for r in records if protocol in r.evaluations]
    if len(episodes) == len(runs):
        condition = str(episodes[0]["condition"].iloc[0])
        tested_agents, more = agents(records, protocol=protocol, condition=condition)
        if len(tested_agents) == 1 and len(tested_agents[0].runs) == len(runs):
            return tested_agents[0]
        problems += more
    why = "; ".join(f"{problem.where}: {problem.message}" for problem in problems[:3])
    raise RunError(f"{why or runs[0].path}: remove the evaluation {protocol!r} and run the command again")


def interval(agent: Agent, measure: Measure) -> Estimate:
    """Return the measure's estimate for an agent, with its 95 % interval."""
    table = crossed([measure.values(agent)], rate=measure.rate, paired=False, bounds=measure.bounds([agent]))
    return means(table)[0]


ERROR = "error"
"""Trial attribute with the reason why the trial's settings failed"""


@dataclass(frozen=True, slots=True)
class Step:
    """One step of a search: the training of a trial up to a rung."""

    trial: int
    rung: int


def open_study(plan: Plan, path: Path) -> Study:
    """Return the Optuna study in a journal; create the study if the journal is empty.

    Raises:
        RunError: the journal is damaged, or belongs to another study.
    """
    journal = Journal(path)
    try:
        storage = JournalStorage(journal)
        if not storage.get_all_studies():
            optuna.create_study(storage=storage, study_name="study", direction="maximize")
        study = optuna.load_study(study_name=None, storage=storage)
        trials = study.get_trials(deepcopy=False)
        for trial in trials:
            _check(Trials(plan, study), trial)
    except AuvbenchError:
        raise
    except Exception as error:  # contradictory operations may fail anywhere in Optuna
        raise RunError(
            f"{path}: damaged: its operations do not form a study ({type(error).__name__}: {error}); "
            "restore the file, or "
            f"start over (mv {path} ELSEWHERE)"
        ) from error
    study.sampler = sampler(plan, len(trials))
    study.pruner = pruner(plan)
    return study


def sampler(plan: Plan, begun: int) -> BaseSampler:
    """Return a study's sampler.

    The number of begun trials is added to the seed, since Optuna's samplers repeat their first draws in a new
    process.
    """
    startup, seed = plan.tune.startup, (plan.seed + begun) % (1 << 32)
    if plan.tune.sampler == "random":
        return RandomSampler(seed=seed)
    # constant_liar prevents simultaneous trials from getting similar settings.
    return TPESampler(multivariate=True, constant_liar=True, n_startup_trials=startup, seed=seed)


def pruner(plan: Plan) -> BasePruner:
    if plan.tune.pruner == "none":
        return NopPruner()
    return _Halving(min_resource=1, reduction_factor=plan.tune.reduction)


class _Halving(SuccessiveHalvingPruner):
    """Asynchronous successive halving (Li et al. 2020) with rungs that need not be powers of the reduction factor."""

    def prune(self, study: Study, trial: FrozenTrial) -> bool:
        in_rungs = copy.copy(trial)
        scores = [trial.intermediate_values[step] for step in sorted(trial.intermediate_values)]
        # Optuna would promote all equal scores, e.g. of trials without a success; here the first trial wins.
        scores = [score - max(1.0, abs(score)) * 1e-12 * trial.number for score in scores]
        in_rungs.intermediate_values = {self._reduction_factor**i: score for i, score in enumerate(scores)}
        return super().prune(study, in_rungs)


BEGUN = tuple(state for state in TrialState if state is not TrialState.WAITING)


@dataclass
class Trials:
    """The trials of a study."""

    plan: Plan
    study: Study

    @property
    def trials(self) -> list[FrozenTrial]:
        """Return all begun trials."""
        return self.study.get_trials(deepcopy=False, states=BEGUN)

    @property
    def ranked(self) -> list[FrozenTrial]:
        """Return the trials with a result, best first: by budget, then by score."""

        def place(trial: FrozenTrial) -> tuple[float, float]:
            last = max(trial.intermediate_values)
            return (-last, -trial.intermediate_values[last])

        return sorted(
            (t for t in self.trials if t.intermediate_values and ERROR not in t.user_attrs), key=place
        )

    @property
    def best(self) -> FrozenTrial | None:
        return next(iter(self.ranked), None)

    @property
    def uninformative(self) -> tuple[int, ...]:
        """Return the budgets at which pruning chose nothing, because all trials have the same score."""
        by_budget = {
            budget: [t.intermediate_values[budget] for t in self.trials if budget in t.intermediate_values]
            for budget in self.plan.budgets[:-1]
        }
        fewest = self.plan.tune.reduction + 1
        return tuple(
            budget for budget, scores in by_budget.items() if len(scores) >= fewest and len(set(scores)) == 1
        )

    def algo(self, trial: FrozenTrial) -> dict[str, Any]:
        """Return the plain values of `algo` for a trial."""
        return with_values(self.plan.base["algo"], self.plan.dimensions, trial.params)

    def results(self, trial: FrozenTrial) -> list[Score]:
        """Return a trial's scores by rung.

        Raises:
            TypeError, ValueError: the journal has a value that is not a score.
        """
        reached = self.plan.budgets[: len(trial.intermediate_values)]
        return [of_plain(trial.user_attrs.get(f"result {budget}")) for budget in reached]


def _check(study: Trials, trial: FrozenTrial) -> None:
    space = {dimension.key: dimension.distribution for dimension in study.plan.dimensions}
    if any(space.get(key) != distribution for key, distribution in trial.distributions.items()):
        raise ValueError(f"trial {trial.number} has parameters of another study")
    if tuple(trial.intermediate_values) != study.plan.budgets[: len(trial.intermediate_values)]:
        raise ValueError(f"trial {trial.number} has the rungs of another study")
    study.results(trial)
    if trial.state.is_finished() and len(trial.params) < len(space):
        raise ValueError(f"trial {trial.number} lacks parameters")


class Search(Trials):
    """Decides what to train next; each decision is written to the journal before it takes effect."""

    def __init__(self, plan: Plan, study: Study, base: schema.TrainConfig) -> None:
        super().__init__(plan, study)
        self.base = base  # configuration with which proposals are checked
        self.limit = plan.tune.trials
        self.running: dict[int, Trial] = {}
        self.queue: deque[Step] = deque()
        for frozen in study.get_trials(deepcopy=False, states=(TrialState.RUNNING,)):
            trial = Trial(study, frozen._trial_id)
            for dimension in plan.dimensions:  # After a kill, the journal may lack some parameters.
                trial._suggest(dimension.key, dimension.distribution)
            self._advance(trial)

    def next(self) -> Step | None:
        """Return the next step to train; None if the search waits for a result or is over."""
        if self.plan.tune.preset and not self.trials:
            first = of_preset(self.plan.base["algo"], self.plan.dimensions)
            self.study.enqueue_trial(first, skip_if_exists=True)  # a killed process may have queued `first`
        while not self.queue and len(self.trials) < self.limit:
            self._advance(self.study.ask({d.key: d.distribution for d in self.plan.dimensions}))
        return self.queue.popleft() if self.queue else None

    def _advance(self, trial: Trial) -> None:
        """Queue the trial's next rung, or close the trial."""
        trial_state = self.trials[trial.number]
        shown = trial_state.intermediate_values
        if ERROR in trial_state.user_attrs:
            self.study.tell(trial, state=TrialState.PRUNED)
        elif not shown and (why := self._impossible(trial_state)):
            self._close(trial, why)
        elif len(shown) == len(self.plan.budgets):
            self.study.tell(trial, shown[self.plan.budgets[-1]])
        elif shown and trial.should_prune():
            self.study.tell(trial, state=TrialState.PRUNED)
        else:
            self.running[trial.number] = trial
            self.queue.append(Step(trial.number, len(shown)))

    def _impossible(self, trial: FrozenTrial) -> str:
        try:
            with_groups(self.base, {"algo": self.algo(trial)})
        except ConfigError as error:
            return str(error)
        return ""

    def report(self, step: Step, score: Score) -> None:
        """Record a trial's result at a rung."""
        trial, budget = self.running.pop(step.trial), self.plan.budgets[step.rung]
        trial.set_user_attr(f"result {budget}", score.plain())
        trial.report(score.score, budget)
        self._advance(trial)

    def fail(self, step: Step, why: str) -> None:
        """Close a trial whose settings made its training fail."""
        self._close(self.running.pop(step.trial), why)

    def _close(self, trial: Trial, why: str) -> None:
        trial.set_user_attr(ERROR, why)
        # Optuna's samplers ignore failed trials, but rank a pruned trial without a result as the worst.
        self.study.tell(trial, state=TrialState.PRUNED)
