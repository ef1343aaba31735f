"""What is searched: ranges of an algorithm's settings, written in the grammar in which Hydra writes sweeps."""

from __future__ import annotations

import copy
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import ChoiceSweep, IntervalSweep, Override, RangeSweep
from hydra.errors import HydraException

from auvbench.config import hints, schema
from auvbench.config.compose import with_algorithm
from auvbench.config.overrides import whole_keys
from auvbench.errors import ConfigError

GROUP = "algo."
NEVER = ("algo.name", "algo.agent", "algo.tuned")
"""Say what an algorithm is, not how it is set."""
FORMS = "interval(LOW,HIGH), range(FROM,TO,STEP) or choice(A,B)"
"""What a range looks like"""
COMBINATIONS = 128
"""Combinations of choices that are checked before a study begins; of more, each choice by itself."""

Value = float | int | str
"""What Optuna knows of a parameter; a choice is its text."""


@dataclass(frozen=True, slots=True)
class Dimension:
    """One key that is searched."""

    key: str
    text: str
    """as written: tag(log,interval(0.001,0.05))"""
    kind: str
    """float | int | choice"""
    low: float = 0.0
    high: float = 0.0
    log: bool = False
    step: float | None = None
    choices: tuple[str, ...] = ()
    """in Hydra's grammar: 64, [64,64], relu"""
    values: tuple[Any, ...] = field(default=(), compare=False)
    """what they stand for"""

    def plain(self, value: Value) -> Any:
        """The value for the configuration."""
        if self.kind == "choice":
            return copy.deepcopy(self.values[self.choices.index(str(value))])
        return int(value) if self.kind == "int" else float(value)

    def ends(self) -> Sequence[Value]:
        """Values that stand for all of them where it is checked whether they are possible."""
        if self.kind == "choice":
            return self.choices
        return (int(self.low), int(self.high)) if self.kind == "int" else (self.low, self.high)

    def points(self) -> Sequence[Value]:
        """All of its values, in order.

        Raises:
            ConfigError: there are infinitely many.
        """
        if self.kind == "choice":
            return self.choices
        if self.kind == "int" and not self.log:
            return list(range(int(self.low), int(self.high) + 1, int(self.step or 1)))
        if self.step is not None:
            count = round((self.high - self.low) / self.step)
            return [self.low + i * self.step for i in range(count + 1)]
        raise ConfigError(
            f"{self.key}={self.text}: a grid needs values: {self.key}=choice(A,B) or range(FROM,TO,STEP)"
        )


def share_of(dimension: Dimension, value: Value) -> float:
    """Where a number lies in its range, in [0, 1]; of a choice, the middle of its place.

    >>> round(share_of(Dimension("algo.a", "", "float", 1e-4, 1e-2, log=True), 1e-3), 9)
    0.5
    """
    if dimension.kind == "choice":
        return (dimension.choices.index(str(value)) + 0.5) / len(dimension.choices)
    low, high, at = dimension.low, dimension.high, float(value)
    if dimension.log:
        low, high, at = math.log(low), math.log(high), math.log(at)
    return (at - low) / (high - low) if high > low else 0.5


def keys_of(algo: Mapping[str, Any], prefix: str = GROUP) -> list[str]:
    """The dotted keys of an algorithm's plain values.

    >>> keys_of({"gamma": 0.9, "residual": {"share": 0.3}})
    ['algo.gamma', 'algo.residual.share']
    """
    found = []
    for key, value in algo.items():
        found += keys_of(value, f"{prefix}{key}.") if isinstance(value, Mapping) else [f"{prefix}{key}"]
    return found


def read(
    written: Mapping[str, Any], typed: Mapping[str, str], fixed: Mapping[str, str], known: Sequence[str]
) -> list[Dimension]:
    """The dimensions of a study, in the order in which they are written.

    Args:
        written: range by key, of the search's file.
        typed: of the command line; replaces what is written for a key.
        fixed: value by key, as typed; a key that has one is not searched.
        known: the keys that the algorithm has.

    Raises:
        ConfigError: a key is unknown or no setting, a range is empty, a key is both fixed and searched, or nothing
            is left to search.
    """
    for key, text in typed.items():
        if key in fixed:
            raise ConfigError(
                f"{key}: fixed by {key}={fixed[key]} and searched by {key}={text}; leave out one"
            )
    texts = {**{str(key): text for key, text in written.items()}, **typed}
    found = [_dimension(key, text, known) for key, text in texts.items() if key not in fixed]
    if not found:
        why = f"; {', '.join(fixed)} fixed" if fixed else ""
        raise ConfigError(
            f"nothing to search: no key has a range{why} (e.g. 'algo.gamma=interval(0.95,0.999)', "
            "or a file of ranges in ./conf/search, chosen by search=NAME)"
        )
    return found


def _dimension(key: str, text: Any, known: Sequence[str]) -> Dimension:
    if key in NEVER or not key.startswith(GROUP):
        raise ConfigError(
            f"{key}: settings of the algorithm are searched, keys of algo; what else a run has is the question"
        )
    if key not in known:
        raise ConfigError(f"{key}: unknown key; {hints.unknown_key(key, known, {}, 'auvbench tune')}")
    if not isinstance(text, str):
        raise ConfigError(f"{key}={text}: no range; write {FORMS}")
    try:
        override = OverridesParser.create().parse_override(f"{key}={text}")
    except HydraException as error:
        raise ConfigError(f"{key}={text}: {' '.join(str(error).split())}; write {FORMS}") from error
    sweep = override.value()
    if isinstance(sweep, IntervalSweep):
        return _interval(key, text, sweep)
    if isinstance(sweep, RangeSweep):
        return _range(key, text, sweep)
    if isinstance(sweep, ChoiceSweep):
        return _choice(key, text, sweep)
    raise ConfigError(f"{key}={text}: no range; write {FORMS}")


def _interval(key: str, text: str, sweep: IntervalSweep) -> Dimension:
    low, high = float(sweep.start or 0.0), float(sweep.end or 0.0)
    log = _logarithmic(key, text, sweep.tags)
    if not (math.isfinite(low) and math.isfinite(high)) or low >= high:
        raise ConfigError(f"{key}={text}: empty; its first end must be below its second")
    if log and low <= 0:
        raise ConfigError(f"{key}={text}: a logarithmic range must begin above 0")
    if key not in whole_keys():
        return Dimension(key, text, "float", low, high, log)
    if not (low.is_integer() and high.is_integer()):
        raise ConfigError(f"{key}={text}: takes whole numbers, so its ends must be")
    return Dimension(key, text, "int", low, high, log)


def _range(key: str, text: str, sweep: RangeSweep) -> Dimension:
    log = _logarithmic(key, text, sweep.tags)
    if not sweep.step:
        raise ConfigError(f"{key}={text}: a step of 0 gets nowhere")
    points = list(itertools.islice(sweep.range(), 100_001))
    if not points:
        raise ConfigError(f"{key}={text}: empty; range(FROM,TO,STEP) ends before TO")
    if len(points) == 1:
        raise ConfigError(_one_value(key, text, points[0]))
    if len(points) > 100_000:
        raise ConfigError(f"{key}={text}: more than 100000 values; interval(LOW,HIGH) has all of them")
    low, high = float(min(points)), float(max(points))
    if log and low <= 0:
        raise ConfigError(f"{key}={text}: a logarithmic range must begin above 0")
    whole = all(float(point).is_integer() for point in points)
    if log and (not whole or abs(sweep.step) != 1):
        raise ConfigError(f"{key}={text}: a logarithmic range has no step; use tag(log,interval(LOW,HIGH))")
    if key in whole_keys() and not whole:
        raise ConfigError(f"{key}={text}: takes whole numbers")
    kind = "int" if key in whole_keys() else "float"
    return Dimension(key, text, kind, low, high, log, None if log else abs(float(sweep.step)))


def _choice(key: str, text: str, sweep: ChoiceSweep) -> Dimension:
    _logarithmic(key, text, sweep.tags, allowed=False)
    choices = tuple(str(Override._get_value_element_as_str(item)) for item in sweep.list)
    if len(set(choices)) < len(choices):
        raise ConfigError(f"{key}={text}: has a choice twice")
    if len(choices) == 1:
        raise ConfigError(_one_value(key, text, choices[0]))
    return Dimension(
        key,
        text,
        "choice",
        choices=choices,
        values=tuple(Override._convert_value(item) for item in sweep.list),
    )


def _one_value(key: str, text: str, value: object) -> str:
    return f"{key}={text}: has one value, so there is nothing to choose; {key}={value} fixes it"


def _logarithmic(key: str, text: str, tags: set[str], *, allowed: bool = True) -> bool:
    for tag in sorted(tags):
        if tag != "log" or not allowed:
            raise ConfigError(
                f"{key}={text}: tag {tag!r} means nothing here"
                + ("; valid: log" if allowed else " of a choice")
            )
    return "log" in tags


def check(dimensions: Sequence[Dimension], base: schema.TrainConfig, algo: Mapping[str, Any]) -> None:
    """That the algorithm takes what is searched: the ends of every range, and the choices together.

    Args:
        dimensions: what is searched.
        base: a checked configuration of a run.
        algo: its plain values of `algo`.

    Raises:
        ConfigError: names the values that it does not take.
    """
    single = [dimension.ends()[0] for dimension in dimensions]
    for values in _to_check(dimensions, single):
        try:
            with_algorithm(base, with_values(algo, dimensions, values))
        except ConfigError as error:
            raise ConfigError(f"a space that contradicts itself: {error}") from error


def _to_check(dimensions: Sequence[Dimension], single: Sequence[Value]) -> Iterator[dict[str, Value]]:
    first = {dimension.key: value for dimension, value in zip(dimensions, single, strict=True)}
    for dimension in dimensions:
        if dimension.kind != "choice":
            for end in dimension.ends():
                yield {**first, dimension.key: end}
    choices = [dimension for dimension in dimensions if dimension.kind == "choice"]
    if math.prod(len(dimension.choices) for dimension in choices) <= COMBINATIONS:
        for values in itertools.product(*(dimension.choices for dimension in choices)):
            yield {**first, **{d.key: value for d, value in zip(choices, values, strict=True)}}
        return
    for dimension in choices:
        for value in dimension.choices:
            yield {**first, dimension.key: value}


def with_values(
    algo: Mapping[str, Any], dimensions: Sequence[Dimension], values: Mapping[str, Value]
) -> dict[str, Any]:
    """The plain values of `algo` with those of a trial in their places."""
    result = copy.deepcopy(dict(algo))
    for dimension in dimensions:
        *path, last = dimension.key.removeprefix(GROUP).split(".")
        node = result
        for part in path:
            node = node[part]
        node[last] = dimension.plain(values[dimension.key])
    return result
