"""Create the run directories of a study's trials, and carry out a run: train it, then test it."""

from __future__ import annotations

import copy
import time
from collections.abc import Mapping
from typing import Any

from auvbench.config import schema
from auvbench.config.tuning import refuse_test
from auvbench.evaluation.evaluate import evaluate, stale
from auvbench.runs.directory import RunDirectory, freeze, place
from auvbench.training.checkpoint import extending
from auvbench.training.execute import execute
from auvbench.tuning.folder import FRESH, RUNS, Plan, StudyFolder, of_run

TARGET = "auvbench.tuning.runs:carry_out"
"""function that a worker calls with a run directory"""


def configuration(
    plan: Plan, study: StudyFolder, algo: Mapping[str, Any], seed: int, budget: int, folder: str = RUNS
) -> dict[str, Any]:
    """Return the configuration of a run: the study's configuration with an algorithm, a seed and a budget."""
    config = copy.deepcopy(plan.base)
    config["algo"] = dict(algo)
    config["seed"] = seed
    config["output"], config["name"] = str(study.path), folder
    config["train"] = {**config["train"], "total_steps": budget, "progress": False}
    return config


def of_trial(plan: Plan, study: StudyFolder, algo: Mapping[str, Any], rung: int) -> list[RunDirectory]:
    """Return a trial's runs at a rung, one per seed; they may not exist yet."""
    budget = plan.budgets[rung]
    return [place(configuration(plan, study, algo, seed, budget)) for seed in plan.tune.seeds]


def prepare(plan: Plan, study: StudyFolder, algo: Mapping[str, Any], rung: int) -> list[RunDirectory]:
    """Create the runs of a trial at a rung. After the first rung, the runs continue from the checkpoints of the previous rung.

    Raises:
        RunError: the run of the previous rung is missing or damaged.
    """
    directories = []
    for i, run in enumerate(of_trial(plan, study, algo, rung)):
        if rung and not extending.has_begun(run):
            shorter = of_trial(plan, study, algo, rung - 1)[i]
            directories.append(extending.prepare(shorter, plan.budgets[rung]).begin(plan.command))
        else:
            config = configuration(plan, study, algo, plan.tune.seeds[i], plan.budgets[rung])
            directories.append(freeze(config, plan.command))
    return directories


def fresh(plan: Plan, study: StudyFolder, algo: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the configurations of the runs with fresh seeds; only one if the algorithm does not learn."""
    seeds = plan.tune.fresh_seeds if plan.learns else plan.tune.fresh_seeds[:1]
    return [configuration(plan, study, algo, seed, plan.budgets[-1], FRESH) for seed in seeds]


def carry_out(run: RunDirectory) -> dict[str, Any]:
    """Train a run to its budget and test it; return its manifest, whose processor time includes the test.

    Raises:
        TrainingError, KeyboardInterrupt: see `execute`.
        RunError: the test failed (see `test`); the training is complete.
    """
    manifest = execute(run)
    begun = time.process_time()
    test(run, of_run(run.path)[1])
    used = time.process_time() - begun
    return run.update_manifest(cpu_time_s=round(float(manifest["cpu_time_s"] or 0.0) + used, 3))


def test(run: RunDirectory, protocol: schema.Protocol) -> None:
    """Test a complete run, unless its test is up to date.

    Raises:
        ConfigError: the protocol has test scenarios.
        RunError: the run is incomplete, its files are damaged, or another process is testing it.
    """
    refuse_test(protocol)
    if stale(run, protocol) != "":
        evaluate(run, protocol, unless_done=True)
