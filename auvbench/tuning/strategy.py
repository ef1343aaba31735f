"""Optuna's samplers and pruners, as a study's configuration names them."""

from __future__ import annotations

import copy
import itertools
import math
import warnings
from collections.abc import Sequence
from typing import Any

import optuna
from optuna.pruners import BasePruner, HyperbandPruner, MedianPruner, NopPruner, SuccessiveHalvingPruner
from optuna.samplers import BaseSampler, CmaEsSampler, GPSampler, RandomSampler, TPESampler
from optuna.study import Study
from optuna.trial import FrozenTrial

from auvbench.errors import ConfigError, MissingExtraError
from auvbench.tuning.folder import Plan
from auvbench.tuning.space import Dimension, Value

optuna.logging.set_verbosity(optuna.logging.ERROR)  # the study has its own view
# Multivariate TPE and the Gaussian process are experimental: their interface may change, and Optuna's version is pinned.
warnings.filterwarnings("ignore", category=optuna.exceptions.ExperimentalWarning)


def trial_limit(name: str, dimensions: Sequence[Dimension]) -> int | None:
    """Return how many trials a sampler can propose; None for any number.

    Raises:
        ConfigError: The sampler cannot search this space.
        MissingExtraError: The sampler needs a package that is not installed.
    """
    if name == "grid":
        return math.prod(len(dimension.points()) for dimension in dimensions)
    if name == "cmaes":
        try:
            import cmaes  # noqa: F401
        except ImportError as error:
            raise MissingExtraError("cmaes", extra="cmaes", purpose="tune.sampler=cmaes") from error
        numeric = sum(not dimension.choices for dimension in dimensions)
        if numeric < 2:
            raise ConfigError(
                f"tune.sampler=cmaes: needs at least two ranges of numbers, got {numeric}; tune.sampler=tpe takes any space"
            )
    return None


def grid_point(dimensions: Sequence[Dimension], number: int) -> dict[str, Value]:
    """Return the grid's parameters of a trial; the last key in alphabetical order varies fastest."""
    ordered = sorted(dimensions, key=lambda dimension: dimension.key)
    points = itertools.product(*(dimension.points() for dimension in ordered))
    values = next(itertools.islice(points, number, None))
    return {dimension.key: value for dimension, value in zip(ordered, values, strict=True)}


def sampler(plan: Plan, begun: int) -> BaseSampler:
    """Return a study's sampler.

    The number of trials that have begun moves the seed: Optuna's samplers repeat their first draws in a new process.
    """
    startup, seed = plan.tune.startup, (plan.seed + begun) % (1 << 32)
    match plan.tune.sampler:
        case "tpe":
            # constant_liar keeps trials that run at the same time apart.
            return TPESampler(multivariate=True, constant_liar=True, n_startup_trials=startup, seed=seed)
        case "gp":
            return GPSampler(n_startup_trials=startup, deterministic_objective=False, seed=seed)
        case "cmaes":
            return _CmaEs(n_startup_trials=startup, seed=seed)
    return RandomSampler(seed=seed)  # of a grid, every parameter is set before


class _CmaEs(CmaEsSampler):
    """CMA-ES with its state in memory.

    Optuna keeps this state pickled in the journal, and auvbench unpickles nothing. After a restart, each proposal
    replays one generation of the journal.
    """

    _state: Any = None

    def _init_optimizer(self, *arguments: Any, **options: Any) -> Any:
        self._state = super()._init_optimizer(*arguments, **options)
        return self._state

    def _restore_optimizer(self, completed_trials: list[FrozenTrial]) -> Any:
        return self._state

    def _split_optimizer_str(self, optimizer_str: str) -> dict[str, str]:
        return {}


def pruner(plan: Plan) -> BasePruner:
    """Return a study's pruner."""
    reduction, top = plan.tune.reduction, len(plan.budgets) - 1
    match plan.tune.pruner:
        case "halving":
            return _Halving(min_resource=1, reduction_factor=reduction)
        case "hyperband":
            # Hyperband takes a floored logarithm; the 1 keeps it from rounding down.
            return _Hyperband(min_resource=1, max_resource=reduction**top + 1, reduction_factor=reduction)
        case "median":
            return MedianPruner()
    return NopPruner()


class _ByRung:
    """Count rungs instead of steps, since a study's rungs need not be powers of the reduction factor."""

    _reduction_factor: int

    def prune(self, study: Study, trial: FrozenTrial) -> bool:
        in_rungs = copy.copy(trial)
        scores = [trial.intermediate_values[step] for step in sorted(trial.intermediate_values)]
        # Optuna promotes all equal scores, such as those of trials without a success; here the first trial wins.
        scores = [score - max(1.0, abs(score)) * 1e-12 * trial.number for score in scores]
        in_rungs.intermediate_values = {self._reduction_factor**i: score for i, score in enumerate(scores)}
        return bool(super().prune(study, in_rungs))  # type: ignore[misc]


class _Halving(_ByRung, SuccessiveHalvingPruner):
    """Asynchronous successive halving (Li et al. 2020)."""


class _Hyperband(_ByRung, HyperbandPruner):
    """Hyperband (Li et al. 2018), in brackets that prune from different rungs on."""
