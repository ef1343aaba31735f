"""Read the search space: ranges of an algorithm's settings, in Hydra's grammar of sweeps."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import ChoiceSweep, IntervalSweep, Override, RangeSweep
from hydra.errors import HydraException
from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution

from auvbench.config import schema, suggestions
from auvbench.config.compose import with_groups
from auvbench.config.overrides import whole_keys
from auvbench.errors import ConfigError
from auvbench.runs.run_filter import flat
from auvbench.untrusted.text import short

GROUP = "algo."
IDENTITY = ("algo.name", "algo.agent", "algo.tuned")
"""Keys that identify the algorithm; they are not settings."""
FORMS = "interval(LOW,HIGH), range(FROM,TO,STEP) or choice(A,B)"

Value = float | int | str
"""Value of a parameter in the journal; a choice is stored as its text."""


@dataclass(frozen=True, slots=True)
class Dimension:
    """A searched key with its range."""

    key: str
    text: str
    """range as written, such as tag(log,interval(0.001,0.05))"""
    distribution: CategoricalDistribution | FloatDistribution | IntDistribution
    values: tuple[Any, ...] = field(default=(), compare=False)
    """configuration values of the choices"""

    @property
    def choices(self) -> tuple[str, ...]:
        """Return the choices in Hydra's grammar, such as 64 or [64,64]; empty for a range of numbers."""
        choices = self.distribution.choices if isinstance(self.distribution, CategoricalDistribution) else ()
        return tuple(str(choice) for choice in choices)

    def plain(self, value: Value) -> Any:
        """Return the configuration value for the value of a trial's parameter."""
        return copy.deepcopy(self.values[self.choices.index(str(value))]) if self.choices else value

    def parameter(self, value: Any) -> Value | None:
        """Return the trial's parameter for a configuration value; None for a value outside of the range."""
        if self.choices:
            return self.choices[self.values.index(value)] if value in self.values else None
        return value if isinstance(value, int | float) and self.distribution._contains(value) else None

    def ends(self) -> Sequence[Value]:
        """Return the values to check before a study starts: the two ends of a range, or all choices."""
        if isinstance(self.distribution, CategoricalDistribution):
            return self.choices
        return (self.distribution.low, self.distribution.high)

    def at_end(self, value: Value) -> bool:
        """Return whether a parameter's distance from an end of its range is at most 2 % of the range. A logarithmic range is measured on a
        log scale.
        """
        distribution = self.distribution
        if isinstance(distribution, CategoricalDistribution) or distribution.single():
            return False
        low, high, at = distribution.low, distribution.high, float(value)
        if distribution.log:
            low, high, at = math.log(low), math.log(high), math.log(at)
        return not 0.02 < (at - low) / (high - low) < 0.98


def keys_of(algo: Mapping[str, Any]) -> list[str]:
    """Return the dotted keys of an algorithm's plain values.

    >>> keys_of({"gamma": 0.9, "residual": {"share": 0.3}})
    ['algo.gamma', 'algo.residual.share']
    """
    return list(flat(algo, GROUP))


def read(
    written: Mapping[str, Any], typed: Mapping[str, str], fixed: Mapping[str, str], keys: Sequence[str]
) -> list[Dimension]:
    """Return the dimensions of a study in the order in which they are written.

    Args:
        written: ranges by key, from the search file.
        typed: ranges by key, from the command line.
        fixed: values by key, from the command line.
        keys: keys of the algorithm.

    Raises:
        ConfigError: a key is unknown or not a setting, a range is invalid, a key is fixed and searched, or
            nothing is left to search.
    """
    for key in typed.keys() & fixed.keys():
        raise ConfigError(
            f"{key}: fixed by {key}={fixed[key]} and searched by {key}={typed[key]}; remove one"
        )
    texts = {**{str(key): text for key, text in written.items()}, **typed}
    dimensions = [_dimension(key, text, keys) for key, text in texts.items() if key not in fixed]
    if not dimensions:
        why = f"; {', '.join(fixed)} fixed" if fixed else ""
        raise ConfigError(
            f"nothing to search: no key has a range{why} (for example 'algo.gamma=interval(0.95,0.999)', "
            "or search=NAME with a file of ranges in ./conf/search)"
        )
    return dimensions


def _dimension(key: str, text: Any, keys: Sequence[str]) -> Dimension:
    if key in IDENTITY or not key.startswith(GROUP):
        raise ConfigError(f"{key}: cannot be searched; only settings of the algorithm (algo.KEY) can")
    if key not in keys:
        raise ConfigError(f"{key}: unknown key; {suggestions.unknown_key(key, keys, 'auvbench tune')}")
    try:
        sweep = OverridesParser.create().parse_override(f"{key}={text}").value()
    except (HydraException, RecursionError, ValueError) as error:
        why = " ".join(str(error).split())
        raise ConfigError(f"{key}={short(text, 200)}: {short(why, 300)}; write {FORMS}") from error
    try:
        if isinstance(sweep, ChoiceSweep):
            choices = tuple(str(Override._get_value_element_as_str(item)) for item in sweep.list)
            values = tuple(Override._convert_value(item) for item in sweep.list)
            return Dimension(key, text, CategoricalDistribution(choices), values)
        if isinstance(sweep, IntervalSweep):
            return Dimension(key, text, _numbers(key, sweep.tags, sweep.start, sweep.end, None))
        if isinstance(sweep, RangeSweep):
            return Dimension(key, text, _numbers(key, sweep.tags, *_ends(sweep)))
    except ValueError as error:
        raise ConfigError(f"{key}={text}: {error}") from error
    raise ConfigError(f"{key}={text}: is not a range; write {FORMS}")


def _ends(sweep: RangeSweep) -> tuple[Decimal, Decimal, Decimal]:
    """Return the first and the last value of a range in rising order, and its step, as exact decimals."""
    first, stop, step = (Decimal(str(value)) for value in (sweep.start, sweep.stop, sweep.step))
    count = math.ceil((stop - first) / step) if step and all(x.is_finite() for x in (first, stop)) else 0
    if count < 1:
        raise ValueError("empty; range(FROM,TO,STEP) ends before TO")
    low, high = sorted((first, first + (count - 1) * step))
    return low, high, abs(step)


def _numbers(
    key: str, tags: set[str], start: Any, end: Any, step: Decimal | None
) -> FloatDistribution | IntDistribution:
    low, high = float(start), float(end)
    if not math.isfinite(low) or not math.isfinite(high) or low > high:
        raise ValueError("empty; the ends must be finite, and the first must not exceed the second")
    if unknown := sorted(tags - {"log"}):
        raise ValueError(f"unknown tag {unknown[0]!r}; valid: log")
    if tags and (low <= 0 or step not in (None, 1)):
        raise ValueError("a logarithmic range must start above 0 and has no step")
    if key not in whole_keys():
        return FloatDistribution(
            low, high, log=bool(tags), step=None if tags or step is None else float(step)
        )
    if not all(float(value).is_integer() for value in (low, high, step or 1)):
        raise ValueError("the values must be whole numbers")
    return IntDistribution(int(low), int(high), log=bool(tags), step=1 if tags else int(step or 1))


def validate_space(
    dimensions: Sequence[Dimension], base: schema.TrainConfig, algo: Mapping[str, Any]
) -> None:
    """Check that the algorithm accepts the ends of every range, and each choice.

    Raises:
        ConfigError: the algorithm rejects a value; the message names the value.
    """
    first = {dimension.key: dimension.ends()[0] for dimension in dimensions}
    for dimension in dimensions:
        for value in dimension.ends():
            try:
                with_groups(base, {"algo": with_values(algo, dimensions, {**first, dimension.key: value})})
            except ConfigError as error:
                raise ConfigError(f"the search space contradicts itself: {error}") from error


def of_preset(algo: Mapping[str, Any], dimensions: Sequence[Dimension]) -> dict[str, Value]:
    """Return the parameters of a trial with the preset's settings; leave out each parameter whose value is outside of its range."""
    values = flat(algo, GROUP)
    found = {d.key: d.parameter(values[d.key]) for d in dimensions}
    return {key: value for key, value in found.items() if value is not None}


def with_values(
    algo: Mapping[str, Any], dimensions: Sequence[Dimension], values: Mapping[str, Value]
) -> dict[str, Any]:
    """Return the plain values of `algo` with a trial's parameters."""
    result = copy.deepcopy(dict(algo))
    for dimension in dimensions:
        *path, last = dimension.key.removeprefix(GROUP).split(".")
        node = result
        for part in path:
            node = node[part]
        node[last] = dimension.plain(values[dimension.key])
    return result
