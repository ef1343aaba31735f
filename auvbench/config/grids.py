"""Compute the jobs of a grid: the union of the Cartesian products in an experiment, narrowed by the command line.

A grid maps keys to axes, for example `{algo: "sac,ppo", reward.k: "1,40,100"}`: 2 x 3 jobs. An experiment may
have several grids, for example `{algo: pid}` as well. Rules for each key that the command line gives:

* If no grid varies the key, it applies to all jobs; several values make it an axis.
* Otherwise, the values on the command line replace the axis in each grid that varies the key. Values that only the axes of other grids
  contain are left out, and a grid without a remaining value is dropped. Grids that do not vary the key stay
  unchanged. For example, `reward.k=40` selects K = 40 in the first grid above. The grid of PID does not vary K, so its
  job stays as the baseline.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.types import RunMode
from omegaconf import DictConfig, ListConfig, open_dict

from auvbench.config.copies import copied
from auvbench.config.overrides import whole_numbers
from auvbench.errors import ConfigError

MOST_JOBS = 10_000
"""largest number of jobs of a grid: each job has a folder, and all jobs are composed before the first starts"""

Axis = list[str]
Grid = dict[str, Axis]


@dataclass(frozen=True, slots=True)
class Job:
    """One job of a grid."""

    config: DictConfig
    overrides: tuple[str, ...]
    """overrides of the job, from the command line and from the grid"""


Load = Callable[[tuple[str, ...], RunMode], DictConfig]
"""Function that returns Hydra's configuration, including the node `hydra`, for overrides and a run mode; the caller must not change
the configuration"""


def compose(loader: ConfigLoaderImpl, load: Load, overrides: Sequence[str], multirun: bool) -> list[Job]:
    """Return all jobs of a grid; if neither `multirun` nor `hydra.mode: MULTIRUN` asks for a grid, return a single job.

    Raises:
        ConfigError, HydraException, OmegaConfBaseException: the configuration of at least one job is wrong.
    """
    parser = OverridesParser.create(config_loader=loader)
    parsed = parser.parse_overrides(list(overrides))
    own = [line for line, item in zip(overrides, parsed, strict=True) if item.is_hydra_override()]
    choices = tuple(
        line for line, item in zip(overrides, parsed, strict=True) if not _sets_a_value(loader, item)
    )
    _refuse_several_grids(load, parsed)
    # Set values later, in each job. In `algo=sac,td3 algo.learning_starts=300`, only the files of a job's algorithm have the key.
    chosen = load(choices, RunMode.MULTIRUN).hydra
    if not multirun and chosen.mode != RunMode.MULTIRUN:
        return [Job(single(loader, load, overrides), tuple(overrides))]
    union, shared = chosen.sweeper.get("grids"), chosen.sweeper.get("params") or {}
    common = from_config(parser, [shared])[0]
    typed = axes(parser, [line for line in overrides if line not in own])
    product = [{**common, **grid} for grid in from_config(parser, union)]
    lines = jobs(narrow(product or [common], typed))
    if not lines:
        raise ConfigError(
            f"{' '.join(overrides)}: no job of the experiment's grids has all these values; leave one of them out"
        )

    def of_job(files: tuple[str, ...], mode: RunMode) -> DictConfig:
        job = load((*own, *files), mode)
        if job.hydra.sweeper.get("grids") != union:
            raise ConfigError(
                f"{' '.join(files)}: an experiment with grids must be the only one; give one experiment"
            )
        return job

    return [Job(single(loader, of_job, line), tuple(line)) for line in lines]


def _refuse_several_grids(load: Load, parsed: Sequence[Override]) -> None:
    """Raise ConfigError for experiment=[A,B] if A and B have grids, because the grids of B would replace the grids of A."""
    for override in parsed:
        names = override.value() if override.key_or_group == "experiment" else None
        if not isinstance(names, list) or len(names) < 2:
            continue
        words = [f"experiment={name}" for name in names]
        sweepers = [load((word,), RunMode.MULTIRUN).hydra.sweeper for word in words]
        if sum(bool(sweeper.get("grids")) for sweeper in sweepers) > 1:
            raise ConfigError(
                f"{override.input_line}: an experiment with grids must be the only one; give one experiment"
            )


def single(loader: ConfigLoaderImpl, load: Load, overrides: Sequence[str]) -> DictConfig:
    """Return the configuration of one job: load its files with `load`, and set its values in a copy."""
    parsed = OverridesParser.create(config_loader=loader).parse_overrides(list(overrides))
    # A sweep such as seed=1,2 is passed to `load`, where Hydra rejects it.
    values = [item for item in parsed if _sets_a_value(loader, item) and not item.is_sweep_override()]
    files = tuple(line for line, item in zip(overrides, parsed, strict=True) if item not in values)
    config = copied(load(files, RunMode.RUN))
    with open_dict(config):
        del config["hydra"]
    loader._apply_overrides_to_config(values, config)
    return config


def _sets_a_value(loader: ConfigLoaderImpl, override: Override) -> bool:
    """Return whether an override sets a value; other overrides choose files. Hydra sets values after it has composed the files."""
    if override.is_hydra_override() or override.package is not None:
        return False
    if not override.is_sweep_override() and isinstance(override.value(), dict):
        return False
    return not loader.repository.group_exists(override.key_or_group)


def axes(parser: OverridesParser, lines: Iterable[str]) -> Grid:
    """Return the values of each key, as written in its override; if a key has several overrides, the last one counts.

    Raises:
        ConfigError: a sweep that is not a list of values.
    """
    result: Grid = {}
    for override in parser.parse_overrides(list(lines)):
        key = override.get_key_element()
        result.pop(key, None)  # The position of the last override decides the order of the axes.
        result[key] = _values(override)
    return result


def _values(override: Override) -> Axis:
    if override.is_delete() and override.value() is None:
        return [""]  # the override `~key`, which is not the same as `~key=null`
    if not override.is_sweep_override():
        return [override.get_value_element_as_str()]
    if not override.is_discrete_sweep():
        raise ConfigError(f"{override.input_line}: a grid takes lists of values, e.g. 1,2,3 or range(0,5)")
    values = list(itertools.islice(override.sweep_string_iterator(), MOST_JOBS + 1))
    if len(values) > MOST_JOBS:
        raise ConfigError(
            f"{override.input_line}: has more values than the {MOST_JOBS:,} runs that a grid may have"
        )
    return values


def from_config(parser: OverridesParser, node: Any) -> list[Grid]:
    """Return the grids that a configuration lists, for example in `hydra.sweeper.grids`.

    Raises:
        ConfigError: an entry of the list does not map keys to values.
    """
    grids = []
    for entry in node or ():
        if not isinstance(entry, Mapping | DictConfig):
            raise ConfigError(
                f"hydra.sweeper.grids: {entry} must map keys to values, e.g. {{algo: 'sac,ppo'}}"
            )
        grids.append(
            axes(
                parser, [f"{key}={whole_numbers(str(key), _written(value))}" for key, value in entry.items()]
            )
        )
    return grids


def _written(value: Any) -> str:
    """Return a YAML value in the grammar of overrides; a list becomes an axis."""
    if isinstance(value, Sequence | ListConfig) and not isinstance(value, str):
        return ",".join(map(_written, value))
    if value is None:
        return "null"
    return str(value).lower() if isinstance(value, bool) else str(value)


def _override(key: str, value: str) -> str:
    return key if key.startswith("~") and not value else f"{key}={value}"  # ~key deletes the key


def narrow(grids: Sequence[Grid], typed: Grid) -> list[Grid]:
    """Narrow the grids to the values on the command line, by the rules in the module's docstring; return the remaining grids."""
    varied = {key for grid in grids for key in grid}
    narrowed = []
    for grid in grids or [{}]:
        result = dict(grid)
        for key, values in typed.items():
            if key not in varied:
                result[key] = values
            elif key in grid:
                result[key] = _restrict(grid[key], values, [other[key] for other in grids if key in other])
        if all(result.values()):
            narrowed.append(result)
    return narrowed


def _restrict(axis: Axis, values: Axis, every: Sequence[Axis]) -> Axis:
    """Return the values on the command line that apply to a grid's axis.

    A value applies if this axis contains the value, or if no axis in `every` does. If the axis contains the value, the axis's
    spelling of the value is returned.
    """
    own = {_plain(value): value for value in axis}
    values_of_grids = {_plain(value) for other in every for value in other}
    return [
        own.get(_plain(value), value)
        for value in values
        if _plain(value) in own or _plain(value) not in values_of_grids
    ]


def _plain(value: str) -> object:
    """Return a value in a form for comparisons, in which 1 equals 1.0, and 'ppo' equals ppo."""
    text = value.strip()
    if len(text) >= 2 and text[0] == text[-1] and text[0] in "'\"":
        return text[1:-1]
    try:
        return float(text)
    except ValueError:
        return text


def jobs(grids: Iterable[Grid]) -> list[list[str]]:
    """Return the overrides of each job, grid by grid, without duplicates; the last axis varies fastest.

    Raises:
        ConfigError: the grid has more than `MOST_JOBS` jobs.
    """
    grids = list(grids)
    if (count := sum(math.prod(map(len, grid.values())) for grid in grids)) > MOST_JOBS:
        raise ConfigError(
            f"the grid has {count:,} runs, must be at most {MOST_JOBS:,}; sweep fewer values at once"
        )
    lines = dict.fromkeys(
        tuple(_override(key, value) for key, value in zip(grid, values, strict=True))
        for grid in grids
        for values in itertools.product(*grid.values())
    )
    return list(map(list, lines))
