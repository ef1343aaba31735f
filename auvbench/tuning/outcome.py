"""A study's result: its trials, and how the best settings do with fresh seeds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from optuna.importance import PedAnovaImportanceEvaluator, get_param_importances
from optuna.study import Study
from optuna.trial import FrozenTrial, TrialState

from auvbench.errors import UserError
from auvbench.statistics import crossed, pairs
from auvbench.statistics.estimate import Estimate
from auvbench.tuning import runs, scores
from auvbench.tuning.folder import Plan, StudyFolder
from auvbench.tuning.scores import Score
from auvbench.tuning.search import ERROR, open_study, ranked, results
from auvbench.tuning.space import with_values

FEWEST_TRIALS = 10
"""complete trials of different scores from which importances are computed"""

_STATES = {TrialState.COMPLETE: "done", TrialState.PRUNED: "pruned", TrialState.RUNNING: "running"}


@dataclass(frozen=True, slots=True)
class Fresh:
    """The best and the untuned settings, with seeds and scenarios that the search has not seen."""

    tuned: Estimate
    untuned: Estimate
    difference: Estimate
    """tuned less untuned"""
    then: tuple[float, float]
    """second measure: tuned, untuned"""
    then_difference: Estimate
    seeds: tuple[int, ...]


@dataclass(frozen=True)
class Outcome:
    """The result of a study."""

    plan: Plan
    folder: StudyFolder
    study: Study
    """Optuna's, not to be written"""
    fresh: Fresh | None = None
    broken: tuple[str, ...] = ()
    """trainings with fresh seeds that failed"""

    @cached_property
    def objective(self) -> scores.Objective:
        """Return the measures of the study."""
        return scores.objective(self.plan.tune.objective, self.plan.tune.then)

    @cached_property
    def trials(self) -> list[FrozenTrial]:
        """Return the trials, best first, then those without a result."""
        found = [t for t in self.study.get_trials(deepcopy=False) if t.state is not TrialState.WAITING]
        first = ranked(found)
        numbers = {trial.number for trial in first}
        return [*first, *(trial for trial in found if trial.number not in numbers)]

    @property
    def best(self) -> FrozenTrial | None:
        """Return the best trial that has a result."""
        return next(iter(ranked(self.trials)), None)

    @property
    def steps(self) -> int:
        """Return the environment steps of training in the search."""
        seeds = len(self.plan.tune.seeds) if self.plan.learns else 0
        return seeds * sum(trial.last_step or 0 for trial in self.trials)

    def results(self, trial: FrozenTrial) -> list[Score]:
        """Return a trial's scores by rung."""
        return results(self.plan, trial)

    def algo(self, trial: FrozenTrial) -> dict[str, Any]:
        """Return the plain values of `algo` of a trial."""
        return with_values(self.plan.base["algo"], self.plan.dimensions, trial.params)

    @property
    def complete(self) -> int:
        """Return the number of trials with the whole budget."""
        return sum(trial.state is TrialState.COMPLETE for trial in self.trials)

    @property
    def evaluator(self) -> PedAnovaImportanceEvaluator:
        """Return PED-ANOVA (Watanabe, Bansal & Hutter 2023), which asks what the best tenth of the trials shares."""
        return PedAnovaImportanceEvaluator(target_quantile=max(0.1, 5 / max(FEWEST_TRIALS, self.complete)))

    @cached_property
    def importances(self) -> Mapping[str, float]:
        """Return each key's share of the importance; empty for few trials."""
        values = {trial.value for trial in self.trials if trial.state is TrialState.COMPLETE}
        if len(values) < FEWEST_TRIALS:
            return {}
        return get_param_importances(self.study, evaluator=self.evaluator)


def state_of(trial: FrozenTrial) -> str:
    """Return done, pruned, failed or running."""
    return "failed" if ERROR in trial.user_attrs else _STATES.get(trial.state, "failed")


def read(folder: StudyFolder) -> Outcome:
    """Return the study as it is; write nothing.

    Raises:
        RunError: The study is missing or damaged.
    """
    plan = folder.read()
    found = Outcome(plan, folder, open_study(plan, folder.journal, write=False))
    if found.best is None or not plan.tune.fresh_seeds:
        return found
    both = {"tuned": found.algo(found.best), "untuned": plan.base["algo"]}
    return Outcome(plan, folder, found.study, _fresh(found, both), _broken(found, both))


def _broken(of: Outcome, both: Mapping[str, Mapping[str, Any]]) -> tuple[str, ...]:
    found = []
    for label, algo in both.items():
        for run, seed in zip(runs.of_fresh(of.plan, of.folder, algo), of.plan.tune.fresh_seeds, strict=False):
            manifest = run.manifest() if run.exists() else {}
            if manifest.get("state") == "failed":
                why = " ".join(str((manifest["error"] or {}).get("message", "no reason given")).split())
                found.append(f"{label}, seed {seed}: {why}")
    return tuple(found)


def _fresh(of: Outcome, both: Mapping[str, Mapping[str, Any]]) -> Fresh | None:
    """Return None until all runs with fresh seeds are tested."""
    protocol, objective = of.plan.fresh_protocol.name, of.objective
    try:
        agents = [scores.tested(runs.of_fresh(of.plan, of.folder, algo), protocol) for algo in both.values()]
    except UserError:
        return None
    differences = []
    for measure in (objective.measure, objective.then):
        values = [measure.values(agent) for agent in agents]
        table = crossed(values, rate=measure.rate, bounds=measure.bounds(agents))
        differences.append(pairs(table).estimate(0, 1, table, 0.95))
    tuned, untuned = (scores.interval(agent, objective.measure) for agent in agents)
    then = [float(np.nanmean(objective.then.values(agent))) for agent in agents]
    seeds = tuple(of.plan.tune.fresh_seeds[: len(agents[0].outcome)])
    return Fresh(tuned, untuned, differences[0], (then[0], then[1]), differences[1], seeds)
