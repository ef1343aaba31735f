"""The run directories behind a study's trials."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from typing import Any

from auvbench.config.agents import learns
from auvbench.errors import RunError
from auvbench.runs.directory import RunDirectory, freeze, place
from auvbench.training.checkpoint import extending
from auvbench.tuning.folder import FRESH, RUNS, Plan, StudyFolder


def configuration(
    plan: Plan, study: StudyFolder, algo: Mapping[str, Any], seed: int, budget: int, folder: str = RUNS
) -> dict[str, Any]:
    """The configuration of one run: the study's, with a trial's algorithm, a seed and a budget."""
    config = copy.deepcopy(plan.base)
    config["algo"] = dict(algo)
    config["seed"] = seed
    config["output"], config["name"] = str(study.path), folder
    config["train"] = {**config["train"], "total_steps": budget, "progress": False}
    return config


def of_trial(plan: Plan, study: StudyFolder, algo: Mapping[str, Any], budget: int) -> list[RunDirectory]:
    """Where a trial's runs of a budget lie, one per seed; they may not exist yet."""
    return [place(configuration(plan, study, algo, seed, budget)) for seed in plan.tune.seeds]


def prepare(
    plan: Plan, study: StudyFolder, algo: Mapping[str, Any], rung: int, first: int, budgets: Sequence[int]
) -> list[RunDirectory]:
    """Makes the runs that bring a trial to a rung: new ones, or longer ones that begin where the last rung's ended.

    Raises:
        RunError: a run that is to be extended is gone or damaged.
    """
    made = []
    for seed in plan.tune.seeds:
        config = configuration(plan, study, algo, seed, budgets[rung])
        if rung > first:
            shorter = place(configuration(plan, study, algo, seed, budgets[rung - 1]))
            if not shorter.exists():
                raise RunError(
                    f"{shorter.path}: is gone, and its trial is to go on from there; restore it, or give the study "
                    "another name"
                )
            if not place(config).exists() or not _begun(place(config)):
                made.append(extending.prepare(shorter, budgets[rung]).begin(plan.command))
                continue
        made.append(freeze(config, plan.command))
    return made


def _begun(run: RunDirectory) -> bool:
    """Whether an extension has got as far as its first checkpoint."""
    from auvbench.training.checkpoint.store import CheckpointStore

    return run.manifest()["state"] == "complete" or bool(CheckpointStore(run.path).steps())


def fresh(plan: Plan, study: StudyFolder, algo: Mapping[str, Any]) -> list[RunDirectory]:
    """Makes the runs with fresh seeds of some settings."""
    return [freeze(config, plan.command) for config in _fresh(plan, study, algo)]


def of_fresh(plan: Plan, study: StudyFolder, algo: Mapping[str, Any]) -> list[RunDirectory]:
    """Where these lie; they may not exist yet."""
    return [place(config) for config in _fresh(plan, study, algo)]


def _fresh(plan: Plan, study: StudyFolder, algo: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Runs of the whole budget with seeds that the search has not seen.

    Of what does not learn there is one: it has no training that could be lucky.
    """
    seeds = plan.tune.fresh_seeds if learns(algo) else plan.tune.fresh_seeds[:1]
    return [configuration(plan, study, algo, seed, plan.budgets[-1], FRESH) for seed in seeds]
