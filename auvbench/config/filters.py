"""Define the schemas of the `filter` group and the specs of the filters.

A filter may change the agent's command before the vehicle gets it. Importing this module imports no code of a filter.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from auvbench.config.fields import choice, choice_of, later, number
from auvbench.registry import FILTERS, Spec


@dataclass(kw_only=True)
class Filter:
    """Key of every `filter/*.yaml`."""

    acts: ClassVar[bool] = True
    """whether the filter may change a command"""

    name: str = choice_of(lambda: FILTERS.own)


@dataclass(kw_only=True)
class Unfiltered(Filter):
    """No filter."""

    acts: ClassVar[bool] = False


@dataclass(kw_only=True)
class Barrier(Filter):
    """A control barrier function."""

    knows: str = choice("map", "ranges")
    margin: float = number(0.0, 100.0)  # m
    braking: float = number(0.0, 1.0, open_low=True)
    current: float = number(0.0, 10.0)  # m/s
    speed: float | None = number(0.0, 50.0, open_low=True)  # m/s
    tilt: float | None = later(number(0.0, 1.5, open_low=True))  # rad


@dataclass(frozen=True, slots=True)
class FilterSpec(Spec):
    """Description of one value of `filter.name`, available without importing its code."""

    base: ClassVar[type] = Filter

    name: str
    title: str
    """Short description for help and tables"""
    factory: str
    """`module:class` of the filter; empty if the spec means no filter"""
    schema: type


none = FilterSpec("none", "no filter", "", Unfiltered)
cbf = FilterSpec("cbf", "control barrier function", "auvbench.tasks.filters.barrier:BarrierFilter", Barrier)


def unfiltered() -> Unfiltered:
    """Return the schema that means no filter, for runs of earlier versions."""
    return Unfiltered(name="none")
