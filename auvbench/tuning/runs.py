"""The run directories of a study's trials."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any

from auvbench.runs.directory import RunDirectory, freeze, place
from auvbench.training.checkpoint import extending
from auvbench.training.checkpoint.store import CheckpointStore
from auvbench.tuning.folder import FRESH, RUNS, Plan, StudyFolder


def configuration(
    plan: Plan, study: StudyFolder, algo: Mapping[str, Any], seed: int, budget: int, folder: str = RUNS
) -> dict[str, Any]:
    """Return the configuration of a run: the study's, with an algorithm, a seed and a budget."""
    config = copy.deepcopy(plan.base)
    config["algo"] = dict(algo)
    config["seed"] = seed
    config["output"], config["name"] = str(study.path), folder
    config["train"] = {**config["train"], "total_steps": budget, "progress": False}
    return config


def of_trial(plan: Plan, study: StudyFolder, algo: Mapping[str, Any], rung: int) -> list[RunDirectory]:
    """Return a trial's runs at a rung, one per seed; they may not exist."""
    budget = plan.budgets[rung]
    return [place(configuration(plan, study, algo, seed, budget)) for seed in plan.tune.seeds]


def prepare(plan: Plan, study: StudyFolder, algo: Mapping[str, Any], rung: int) -> list[RunDirectory]:
    """Make the runs that bring a trial to a rung; a later rung goes on from the checkpoint of the rung before.

    Raises:
        RunError: The run of the rung before is missing or damaged.
    """
    made = []
    for i, seed in enumerate(plan.tune.seeds):
        run = of_trial(plan, study, algo, rung)[i]
        if rung and not _has_begun(run):
            shorter = of_trial(plan, study, algo, rung - 1)[i]
            made.append(extending.prepare(shorter, plan.budgets[rung]).begin(plan.command))
        else:
            made.append(freeze(configuration(plan, study, algo, seed, plan.budgets[rung]), plan.command))
    return made


def _has_begun(run: RunDirectory) -> bool:
    return run.exists() and (run.manifest()["state"] == "complete" or bool(CheckpointStore(run.path).steps()))


def prepare_fresh(plan: Plan, study: StudyFolder, algo: Mapping[str, Any]) -> list[RunDirectory]:
    """Make the runs with fresh seeds of some settings."""
    return [freeze(config, plan.command) for config in _fresh(plan, study, algo)]


def of_fresh(plan: Plan, study: StudyFolder, algo: Mapping[str, Any]) -> list[RunDirectory]:
    """Return the runs with fresh seeds of some settings; they may not exist."""
    return [place(config) for config in _fresh(plan, study, algo)]


def _fresh(plan: Plan, study: StudyFolder, algo: Mapping[str, Any]) -> list[dict[str, Any]]:
    # Only a training depends on the seed.
    seeds = plan.tune.fresh_seeds if plan.learns else plan.tune.fresh_seeds[:1]
    return [configuration(plan, study, algo, seed, plan.budgets[-1], FRESH) for seed in seeds]
