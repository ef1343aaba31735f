"""A study read again: what was tried, what it showed, what it cost, and how the best does with fresh seeds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from auvbench.config.agents import learns
from auvbench.errors import RunError
from auvbench.runs.directory import RunDirectory
from auvbench.statistics import crossed, pairs
from auvbench.statistics.estimate import Estimate
from auvbench.tuning import folder, rungs, runs, samplers, scores
from auvbench.tuning.folder import Plan, StudyFolder
from auvbench.tuning.journal import Journal
from auvbench.tuning.search import Search, ladder_of
from auvbench.tuning.space import Value


@dataclass(frozen=True, slots=True)
class Trial:
    """One trial, as far as it came."""

    number: int
    params: Mapping[str, Value]
    rung: int
    """the highest that it reached; -1 where it reached none"""
    results: Mapping[int, Mapping[str, Any]]
    """by rung: what `scores.Score.plain` says"""
    state: str
    """done | pruned | failed | waiting"""
    error: str = ""

    @property
    def result(self) -> Mapping[str, Any]:
        """At the highest rung."""
        return self.results[self.rung]


@dataclass(frozen=True, slots=True)
class Fresh:
    """The best and the untuned settings, trained with seeds and tested on scenarios that the search has not seen."""

    tuned: Estimate
    untuned: Estimate
    difference: Estimate
    """tuned less untuned"""
    p_value: float
    then: tuple[float, float]
    """of the second measure: tuned, untuned"""
    then_difference: Estimate
    seeds: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Cost:
    """What the search took."""

    steps: int
    """environment steps that were trained"""
    restarted: int
    """that would have been trained if each promotion began again"""
    seconds: float
    """of training, over all runs of the search"""
    saved_seconds: float
    """of training that promotions did not do again"""


@dataclass(frozen=True, slots=True)
class Outcome:
    """A study's result."""

    plan: Plan
    folder: StudyFolder
    objective: scores.Objective
    budgets: tuple[int, ...]
    trials: tuple[Trial, ...]
    """best first, then those that showed nothing"""
    importances: Mapping[str, float]
    """share of each key in what tells good trials from bad; empty where there are too few trials"""
    cost: Cost
    fresh: Fresh | None
    broken: tuple[str, ...] = ()
    """what failed with fresh seeds: the best settings' trainings, and the untuned ones', in words"""

    @property
    def best(self) -> Trial | None:
        return self.trials[0] if self.trials and self.trials[0].rung >= 0 else None

    @property
    def learns(self) -> bool:
        return learns(self.plan.base["algo"])


def read(study: StudyFolder) -> Outcome:
    """The study as it is now; nothing is written.

    Raises:
        RunError: there is no study, or it is damaged.
    """
    plan = study.read()
    plan_budgets = ladder_of(plan).budgets
    journal = Journal(study.journal, plan.dimensions, plan_budgets, write=False)
    search = Search(plan, journal)
    objective = scores.objective(plan.tune.objective, plan.tune.then)
    order = rungs.order(journal.progress)
    rest = [trial.number for trial in journal.progress if trial.number not in set(order)]
    trials = tuple(_trial(journal, number) for number in [*order, *rest])
    return Outcome(
        plan,
        study,
        objective,
        plan_budgets,
        trials,
        importances(search),
        _cost(search, study),
        _fresh(search, study, objective),
        _broken(search, study),
    )


def _trial(journal: Journal, number: int) -> Trial:
    progress, results, error = journal.progress[number], journal.results[number], journal.errors[number]
    top = len(journal.budgets) - 1
    reached = max(results, default=-1)
    state = "failed" if error else "done" if reached == top else "pruned" if progress.closed else "waiting"
    return Trial(number, journal.params[number], reached, results, state, error)


def importances(search: Search) -> dict[str, float]:
    """PED-ANOVA's shares (Watanabe, Bansal & Hutter 2023, IJCAI), from what distinguishes the best tenth.

    Of budgets only the order enters: a trial is worth its place in the study's ranking.
    """
    order = rungs.order(search.progress)
    if len(order) < 10:
        return {}
    import optuna
    from optuna.importance import PedAnovaImportanceEvaluator, get_param_importances
    from optuna.trial import TrialState, create_trial

    samplers.quiet()
    space = samplers.distributions_of(search.plan.dimensions)
    study = optuna.create_study(storage=optuna.storages.InMemoryStorage(), direction="maximize")
    for place, number in enumerate(order):
        study.add_trial(
            create_trial(
                state=TrialState.COMPLETE,
                value=-float(place),
                params=dict(search.journal.params[number]),
                distributions=space,
            )
        )
    # A tenth of few trials is one: at least five are needed to see what they share.
    evaluator = PedAnovaImportanceEvaluator(target_quantile=max(0.1, 5 / len(order)))
    return {key: float(share) for key, share in get_param_importances(study, evaluator=evaluator).items()}


def _cost(search: Search, study: StudyFolder) -> Cost:
    plan, budgets = search.plan, search.ladder.budgets
    if not learns(plan.base["algo"]):
        return Cost(0, 0, 0.0, 0.0)
    steps = restarted = 0
    seconds = saved = 0.0
    counted = set()
    for trial in search.progress:
        for rung in sorted(search.journal.results[trial.number]):
            algo = search.algo(trial.number)
            for run in runs.of_trial(plan, study, algo, budgets[rung]):
                if run.path in counted or not run.exists():
                    continue
                counted.add(run.path)
                before = _before(plan, study, algo, rung, trial.first, budgets, run)
                manifest = run.manifest()
                seconds += manifest["wall_time_s"]
                restarted += manifest["steps"]
                steps += manifest["steps"] - sum(earlier.manifest()["steps"] for earlier in before[-1:])
                saved += sum(earlier.manifest()["wall_time_s"] for earlier in before)
    return Cost(steps, restarted, seconds, saved)


def _before(
    plan: Plan,
    study: StudyFolder,
    algo: Mapping[str, Any],
    rung: int,
    first: int,
    budgets: tuple[int, ...],
    run: RunDirectory,
) -> list[RunDirectory]:
    """The shorter runs that a run went on from, the longest last."""
    place = [each.path for each in runs.of_trial(plan, study, algo, budgets[rung])].index(run.path)
    found = [runs.of_trial(plan, study, algo, budgets[r])[place] for r in range(first, rung)]
    return [each for each in found if each.exists()]


def _broken(search: Search, study: StudyFolder) -> tuple[str, ...]:
    """`tuned, seed 1001: <why>` for each training with a fresh seed that failed."""
    best, plan = search.best, search.plan
    if best is None:
        return ()
    found = []
    for label, algo in (("tuned", search.algo(best)), ("untuned", plan.base["algo"])):
        for run, seed in zip(runs.of_fresh(plan, study, algo), plan.tune.fresh_seeds, strict=False):
            manifest = run.manifest() if run.exists() else None
            if manifest is not None and manifest["state"] == "failed":
                why = " ".join(str((manifest["error"] or {}).get("message", "no reason given")).split())
                found.append(f"{label}, seed {seed}: {why}")
    return tuple(found)


def _fresh(search: Search, study: StudyFolder, objective: scores.Objective) -> Fresh | None:
    """None until all of its runs are trained and tested."""
    best = search.best
    if best is None or not search.plan.tune.fresh_seeds:
        return None
    plan = search.plan
    protocol = folder.fresh_protocol(plan).name
    try:
        both = [
            scores.tested(runs.of_fresh(plan, study, algo), protocol)
            for algo in (search.algo(best), plan.base["algo"])
        ]
    except RunError:
        return None
    found = []
    for measure in (objective.measure, objective.then):
        table = crossed(
            [measure.values(agent) for agent in both], rate=measure.rate, bounds=measure.bounds(both)
        )
        difference = pairs(table)
        found.append((difference.estimate(0, 1, table, 0.95), float(difference.p_value[0, 1])))
    tuned, untuned = (scores.interval(agent, objective.measure) for agent in both)
    then = tuple(float(np.nanmean(objective.then.values(agent))) for agent in both)
    return Fresh(
        tuned,
        untuned,
        found[0][0],
        found[0][1],
        (then[0], then[1]),
        found[1][0],
        tuple(plan.tune.fresh_seeds[: len(both[0].outcome)]),
    )
