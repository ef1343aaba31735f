"""Proposing a trial: a function of the study's seed, the trial's number and what the trials before it gave, nothing else.

A sampler is made anew for each trial and handed the history in the order of the trials' numbers, so that a study
that was killed and goes on proposes what it would have proposed. Optuna's own way, a sampler that lives as long as
its process, repeats its first proposals after a restart; its CMA-ES also keeps itself pickled in the storage, which
is not read here.
"""

from __future__ import annotations

import hashlib
import math
import warnings
from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cache, lru_cache
from typing import TYPE_CHECKING

import numpy as np

from auvbench.errors import ConfigError, MissingExtraError
from auvbench.tuning.rungs import FAILED, Progress, order
from auvbench.tuning.space import Dimension, Value, share_of

if TYPE_CHECKING:
    from optuna.distributions import BaseDistribution
    from optuna.samplers import BaseSampler
    from optuna.storages import InMemoryStorage
    from optuna.study import Study
    from optuna.trial import FrozenTrial, TrialState

Params = Mapping[str, Value]


@dataclass(frozen=True, slots=True)
class Sampler:
    """How a study proposes its trials."""

    name: str
    """tpe | random | gp | cmaes | grid"""
    seed: int
    startup: int
    """trials drawn at random before the others are looked at"""
    dimensions: tuple[Dimension, ...]
    budgets: tuple[int, ...]
    """of the rungs"""

    def propose(self, params: Sequence[Params], trials: Sequence[Progress]) -> dict[str, Value]:
        """The parameters of trial number `len(trials)`.

        Args:
            params: of the trials before it, in their order.
            trials: what they have shown.
        """
        number = len(trials)
        if self.name == "grid":
            return _on_grid(self.dimensions, number)
        if self.name == "cmaes":
            return _cmaes(self, params, trials)
        return _optuna(self, params, trials)

    def draw(self, number: int) -> int:
        """The seed of a trial's own random numbers."""
        return int.from_bytes(hashlib.sha256(f"{self.seed} {number}".encode()).digest()[:4], "big")


def check(name: str, dimensions: Sequence[Dimension]) -> int | None:
    """That a sampler can search a space here; returns the number of trials that it can make, None: any.

    Raises:
        ConfigError: it cannot.
        MissingExtraError: it needs a package that is not installed.
    """
    if name == "grid":
        return math.prod(len(dimension.points()) for dimension in dimensions)
    if name == "cmaes":
        try:
            import cmaes  # noqa: F401
        except ImportError as error:
            raise MissingExtraError("cmaes", extra="cmaes", purpose="tune.sampler=cmaes") from error
        numeric = [dimension for dimension in dimensions if dimension.kind != "choice"]
        if len(numeric) < 2:
            raise ConfigError(
                f"tune.sampler=cmaes: needs at least two ranges of numbers, here are {len(numeric)}; tune.sampler=tpe takes any"
            )
    return None


def _on_grid(dimensions: Sequence[Dimension], number: int) -> dict[str, Value]:
    """The last dimension varies fastest."""
    values: dict[str, Value] = {}
    for dimension in reversed(dimensions):
        points = dimension.points()
        number, place = divmod(number, len(points))
        values[dimension.key] = points[place]
    return {dimension.key: values[dimension.key] for dimension in dimensions}


def _cmaes(sampler: Sampler, params: Sequence[Params], trials: Sequence[Progress]) -> dict[str, Value]:
    """Numbers by CMA-ES (Hansen 2016, arXiv:1604.00772), choices at random.

    Generations are consecutive trials, of the size that `cmaes` takes for so many dimensions; only the order of the
    scores enters, and a trial that has shown nothing yet is last. The population is told anew for each trial.
    """
    from cmaes import CMA

    numeric = [dimension for dimension in sampler.dimensions if dimension.kind != "choice"]
    draws = sampler.draw(len(trials))
    n = len(numeric)
    optimizer = CMA(mean=np.full(n, 0.5), sigma=1 / 6, bounds=np.tile([0.0, 1.0], (n, 1)), seed=draws)
    size = optimizer.population_size
    place = {number: rank for rank, number in enumerate(order(trials))}
    for start in range(0, len(trials) - size + 1, size):
        generation = range(start, start + size)
        points = [np.array([share_of(d, params[i][d.key]) for d in numeric]) for i in generation]
        optimizer.tell(
            [(point, float(place.get(i, len(trials)))) for point, i in zip(points, generation, strict=True)]
        )
    point = optimizer.ask()
    random = np.random.default_rng(draws)
    values: dict[str, Value] = {d.key: _from_unit(d, float(u)) for d, u in zip(numeric, point, strict=True)}
    for dimension in sampler.dimensions:
        if dimension.kind == "choice":
            values[dimension.key] = dimension.choices[int(random.integers(len(dimension.choices)))]
    return {dimension.key: values[dimension.key] for dimension in sampler.dimensions}


def _from_unit(dimension: Dimension, share: float) -> Value:
    low, high = dimension.low, dimension.high
    if dimension.log:
        value = math.exp(math.log(low) + share * (math.log(high) - math.log(low)))
    else:
        value = low + share * (high - low)
    if dimension.step is not None:
        value = low + round((value - low) / dimension.step) * dimension.step
    value = min(max(value, low), high)
    return round(value) if dimension.kind == "int" else value


@cache
def distribution(dimension: Dimension) -> BaseDistribution:
    """The dimension as Optuna has it."""
    from optuna import distributions

    if dimension.kind == "choice":
        return distributions.CategoricalDistribution(dimension.choices)
    if dimension.kind == "int":
        step = 1 if dimension.step is None else int(dimension.step)
        return distributions.IntDistribution(int(dimension.low), int(dimension.high), dimension.log, step)
    return distributions.FloatDistribution(dimension.low, dimension.high, dimension.log, dimension.step)


def distributions_of(dimensions: Sequence[Dimension]) -> dict[str, BaseDistribution]:
    """By key."""
    return {dimension.key: distribution(dimension) for dimension in dimensions}


def quiet() -> None:
    """Optuna's log goes to nobody: the study has a view of its own."""
    import optuna

    optuna.logging.set_verbosity(optuna.logging.ERROR)
    # Multivariate TPE and the Gaussian process are marked experimental: their interface may change, which is pinned.
    warnings.filterwarnings("ignore", category=optuna.exceptions.ExperimentalWarning)


def _optuna(sampler: Sampler, params: Sequence[Params], trials: Sequence[Progress]) -> dict[str, Value]:
    """TPE, a Gaussian process or random draws."""
    import optuna

    quiet()
    history: list[FrozenTrial] = []
    if len(trials) < sampler.startup or sampler.name == "random":
        made: BaseSampler = optuna.samplers.RandomSampler(seed=sampler.draw(len(trials)))
    else:
        made = _SAMPLERS[sampler.name](sampler, sampler.draw(len(trials)))
        seen = _on_one_rung if sampler.name == "gp" else _with_unfinished
        history = seen(sampler, params, trials)
    study = optuna.create_study(storage=_storage(history), sampler=made, direction="maximize")
    return dict(study.ask(distributions_of(sampler.dimensions)).params)


def _storage(history: list[FrozenTrial]) -> InMemoryStorage:
    """A storage that has these trials, numbered from 1, beside the one that is asked for: without copying them all."""
    from optuna.storages import InMemoryStorage

    class Storage(InMemoryStorage):
        def get_all_trials(
            self, study_id: int, deepcopy: bool = True, states: Container[TrialState] | None = None
        ) -> list[FrozenTrial]:
            own = super().get_all_trials(study_id, deepcopy, states)
            return [*own, *(trial for trial in history if states is None or trial.state in states)]

    return Storage()


@lru_cache(maxsize=1 << 17)
def _seen(
    dimensions: tuple[Dimension, ...],
    number: int,
    params: tuple[Value, ...],
    value: float | None,
    shown: tuple[tuple[int, float], ...],
    running: bool,
) -> FrozenTrial:
    """A trial as a sampler sees it; most are as they were for the trial before."""
    from optuna.trial import FrozenTrial, TrialState

    ended = TrialState.PRUNED if value is None else TrialState.COMPLETE
    now = datetime.fromtimestamp(0, UTC)
    return FrozenTrial(
        number=number + 1,
        trial_id=number + 1,
        state=TrialState.RUNNING if running else ended,
        value=value,
        datetime_start=now,
        datetime_complete=None if running else now,
        params=dict(zip([dimension.key for dimension in dimensions], params, strict=True)),
        distributions=distributions_of(dimensions),
        user_attrs={},
        system_attrs={},
        intermediate_values=dict(shown),
    )


def _tpe(sampler: Sampler, seed: int) -> BaseSampler:
    from optuna.samplers import TPESampler

    class Sampler(TPESampler):
        """The space is known; Optuna would look for it in all trials."""

        def infer_relative_search_space(
            self, study: Study, trial: FrozenTrial
        ) -> dict[str, BaseDistribution]:
            return distributions_of(sampler.dimensions)

    # The startup trials were drawn before; constant_liar keeps trials that run side by side apart.
    return Sampler(multivariate=True, constant_liar=True, n_startup_trials=1, seed=seed)


def _gp(sampler: Sampler, seed: int) -> BaseSampler:
    from optuna.samplers import GPSampler

    return GPSampler(n_startup_trials=1, deterministic_objective=False, seed=seed)


_SAMPLERS: dict[str, Callable[[Sampler, int], BaseSampler]] = {"tpe": _tpe, "gp": _gp}


def _with_unfinished(
    sampler: Sampler, params: Sequence[Params], trials: Sequence[Progress]
) -> list[FrozenTrial]:
    """What TPE sees: who reached the last rung as complete, who did not as pruned where it was last looked at.

    Optuna's TPE takes complete trials for better than pruned ones, and of these those for better that came farther.
    """
    top = len(sampler.budgets) - 1
    found = []
    for values, trial in zip(params, trials, strict=True):
        shown = {sampler.budgets[rung]: score for rung, score in trial.scores.items() if score > FAILED}
        value = trial.scores.get(top, FAILED)
        found.append(
            _seen(
                sampler.dimensions,
                trial.number,
                tuple(values[dimension.key] for dimension in sampler.dimensions),
                value if value > FAILED else None,
                tuple(sorted(shown.items())),
                not trial.scores,
            )
        )
    return found


def _on_one_rung(sampler: Sampler, params: Sequence[Params], trials: Sequence[Progress]) -> list[FrozenTrial]:
    """What a Gaussian process sees: scores of one rung, the highest with more results than dimensions.

    Scores of different budgets are no values of one function. The rule is that of BOHB (Falkner, Klein & Hutter 2018,
    ICML, section 4.1). A failed trial counts as the worst that was seen.
    """

    def at(rung: int) -> dict[int, float]:
        return {trial.number: trial.scores[rung] for trial in trials if rung in trial.scores}

    rungs = range(len(sampler.budgets) - 1, -1, -1)
    enough = [rung for rung in rungs if len(at(rung)) > len(sampler.dimensions) + 1]
    scores = at(enough[0] if enough else min(rungs, key=lambda rung: (-len(at(rung)), rung)))
    worst = min((score for score in scores.values() if score > FAILED), default=0.0)
    return [
        _seen(
            sampler.dimensions,
            number,
            tuple(params[number][dimension.key] for dimension in sampler.dimensions),
            max(score, worst),
            (),
            False,
        )
        for number, score in sorted(scores.items())
    ]
