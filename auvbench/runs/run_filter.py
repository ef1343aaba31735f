"""Filter runs with `--where` of `auvbench report`, `runs`, `evaluate`, `resume` and `export`, in the grammar
of overrides.

    --where vehicle=rexrov reward.k=1,40 algo!=random

A filter selects the runs that match every term. A term with `=` matches a run that has one of the listed values. A term with
`!=` matches a run that has none of the listed values.
Keys are the configuration's keys, and `state`, `id` and `experiment`; `algo` is short for `algo.name`. Values
may contain the wildcards `*` and `?`.
"""

from __future__ import annotations

import difflib
import fnmatch
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from auvbench.errors import RunError, UserError, closest
from auvbench.runs.directory import RunDirectory, find_runs

Item = TypeVar("Item")

_TERM = re.compile(r"(?P<key>[^=!]+)(?P<no>!?)=(?P<values>.*)", re.DOTALL)


@dataclass(frozen=True, slots=True)
class Term:
    """One condition on a run."""

    key: str
    values: tuple[str, ...]
    negated: bool
    text: str

    def holds(self, value: Any) -> bool:
        """Return whether a run with this value of the key matches."""
        return any(_equal(value, pattern) for pattern in self.values) is not self.negated


def parse(terms: Iterable[str]) -> tuple[Term, ...]:
    """Return the terms typed after `--where`.

    Raises:
        UserError: a term is not KEY=VALUE,... or KEY!=VALUE,...

    >>> parse(["reward.k=1,40"])[0].values
    ('1', '40')
    """
    terms_read = []
    for text in terms:
        match = _TERM.fullmatch(text)
        # Commas inside brackets separate the items of a list.
        values = [] if match is None else [v.strip() for v in re.split(r",(?![^\[]*\])", match["values"])]
        if match is None or not all(values):
            raise UserError(f"--where {text}: must be KEY=VALUE,... or KEY!=VALUE,..., e.g. reward.k=1,40")
        terms_read.append(Term(match["key"].strip(), tuple(values), bool(match["no"]), text))
    return tuple(terms_read)


def select(
    items: Sequence[Item], terms: Sequence[Term], facts: Callable[[Item], Mapping[str, Any]]
) -> list[Item]:
    """Return the items that match all terms; their order does not change.

    Args:
        items: runs in any form.
        terms: result of `parse`.
        facts: function that returns an item's values by dotted key (see `flat`).

    Raises:
        UserError: no item has the key or the value of a term, or no item matches all terms.
    """
    rows = [dict(facts(item)) for item in items]
    indices = list(range(len(items)))
    for term in terms:
        key = _resolve(term, rows)
        for value in term.values:
            if not any(_equal(row.get(key), value) for row in rows):
                valid = {text(row[key]) for row in rows if key in row}
                raise UserError(f"--where {term.text}: no run has {key}={value}; {closest(value, valid)}")
        indices = [index for index in indices if term.holds(rows[index].get(key))]
    if items and not indices:
        typed = " ".join(term.text for term in terms)
        raise UserError(f"--where {typed}: matches none of the {len(items)} runs")
    return [items[index] for index in indices]


def _resolve(term: Term, rows: Sequence[Mapping[str, Any]]) -> str:
    keys: set[str] = set().union(*rows)
    for candidate in (term.key, f"{term.key}.name"):
        if candidate in keys:
            return candidate
    # The hundreds of keys, most of them of the vehicle's sheet, are too many to list: suggest a similar key.
    short = {key.rpartition(".")[2]: key for key in sorted(keys, reverse=True)}
    near = short.get(term.key) or next(iter(difflib.get_close_matches(term.key, keys, n=1)), None)
    hint = f"did you mean {near}?" if near else "auvbench runs --json lists the valid keys"
    raise UserError(f"--where {term.text}: no run has the key {term.key!r}; {hint}")


def flat(config: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return the values of a nested configuration by dotted key; lists are not split.

    >>> flat({"reward": {"k": 1}, "seed": 2})
    {'reward.k': 1, 'seed': 2}
    """
    values: dict[str, Any] = {}
    for key, value in config.items():
        if isinstance(value, Mapping):
            values |= flat(value, f"{prefix}{key}.")
        else:
            values[f"{prefix}{key}"] = value
    return values


def find(paths: Iterable[Path | str], where: Sequence[str]) -> list[RunDirectory]:
    """Return the runs under some paths that match all terms.

    Raises:
        RunError, UserError: see `find_runs`, `parse` and `select`.
    """
    terms = parse(where)
    runs = find_runs(paths)
    return select(runs, terms, facts) if terms else runs


def facts(run: RunDirectory) -> dict[str, Any]:
    """Return the values of a run directory by key; empty if its configuration cannot be read."""
    from auvbench.runs import status

    try:
        values = flat(run.config())
        values["state"] = str(status.of(run).state)
    except (RunError, RecursionError):
        return {}  # The command reports the damage later, when it uses the run.
    return values | {"id": run.id, "experiment": run.path.absolute().parent.name}


def text(value: Any) -> str:
    """Return a value in the form that a user types: 1.0 is 1, True is true, None is null.

    >>> text(1.0), text(None), text([0.0, 1.5])
    ('1', 'null', '[0,1.5]')
    """
    if value is None or isinstance(value, bool):
        return "null" if value is None else str(value).lower()
    if isinstance(value, int | float):
        return f"{value:.12g}"
    if isinstance(value, list):
        return f"[{','.join(map(text, value))}]"
    return str(value)


def _equal(value: Any, pattern: str) -> bool:
    shown = text(value)
    if shown == pattern or fnmatch.fnmatchcase(shown, pattern):
        return True
    if isinstance(value, bool) or not isinstance(value, int | float):
        return shown == pattern.replace(" ", "")
    try:
        return float(pattern) == value
    except ValueError:
        return False
