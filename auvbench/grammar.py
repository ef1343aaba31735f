"""Parse command lines by one grammar: `key=value` sets a configuration key, `--flag` is an option of the command.

An error message is one line, which shows the correct form.
"""

from __future__ import annotations

import argparse
import math
import os
import re
from collections.abc import Callable, Sequence
from typing import Any, NoReturn

from auvbench.config.suggestions import unknown_flag
from auvbench.errors import UserError, closest

WHERE = "--where"
WHERE_HELP = "only runs with these values: --where vehicle=rexrov reward.k=1,40 algo!=random"


def number(low: float, high: float) -> Callable[[str], float]:
    """Return the `type` of a flag that takes a number from `low` to `high`."""

    def read(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"must be a number from {low:g} to {high:g}, got {text}")
        return value

    return read


def whole(low: int, high: int) -> Callable[[str], int]:
    """Return the `type` of a flag that takes a whole number from `low` to `high`."""

    def read(text: str) -> int:
        # The length is checked first, because int() raises ValueError for a number of 5,000 digits.
        if not text.isdecimal() or len(text) > 100 or not low <= int(text) <= high:
            raise argparse.ArgumentTypeError(f"must be a whole number from {low} to {high}, got {text}")
        return int(text)

    return read


def read_named_sheets(arguments: Sequence[str]) -> None:
    """Check that each vehicle sheet in `vehicle=NAME` or `vehicle=A,B` is valid YAML.

    Hydra's own error for broken YAML would lack file and line. Unknown names are ignored here, since Hydra reports them
    with the list of valid names.

    Raises:
        VehicleError: a sheet cannot be read.
    """
    from auvbench.vehicles import reader

    named = [a.removeprefix("vehicle=") for a in arguments if a.startswith("vehicle=")]
    names = {name.strip(" '\"") for choice in named for name in choice.split(",")}
    for name in sorted(names & set(reader.sheet_names())):
        reader.read(name)


def paths_and_overrides(words: Sequence[str]) -> tuple[list[str], list[str]]:
    """Divide words into paths and overrides: a word with `=` that is not an existing path is an override."""
    paths = [word for word in words if "=" not in word or os.path.exists(word)]
    return paths, [word for word in words if word not in paths]


class _Formatter(argparse.HelpFormatter):
    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return text if "\n" in text else super()._fill_text(text, width, indent)


class Parser(argparse.ArgumentParser):
    """Argument parser that reports a mistake in one line, and suggests the flag for a mistaken `key=value` and vice versa.

    Args:
        where: whether to add the flag `--where`; the attribute `where` of the parsed options then contains its terms.
        workers: name of the jobs that run in parallel, for the help of `--workers`; '' adds no flag `--workers`.
        keys: valid keys of `key=value` words, for suggestions.
        options: keyword arguments of `ArgumentParser`.
    """

    def __init__(
        self, *, where: bool = False, workers: str = "", keys: Sequence[str] = (), **options: Any
    ) -> None:
        super().__init__(allow_abbrev=False, formatter_class=_Formatter, **options)
        self._where = where
        self._keys = keys
        if where:
            self.add_argument(
                WHERE, nargs="+", action="extend", default=[], metavar="KEY=VALUE,...", help=WHERE_HELP
            )

        if workers:
            what = f"{workers} at once (default: one per core)"
            self.add_argument("--workers", type=whole(0, 4096), default=0, help=what)

    @property
    def command(self) -> str:
        return self.prog.split()[-1]

    def flags(self) -> list[str]:
        """Return the long flags: `--rank-by`, `--protocol`, ..."""
        return [name for action in self._actions for name in action.option_strings if name.startswith("--")]

    def error(self, message: str) -> NoReturn:
        raise UserError(f"{self.command}: {message} (auvbench {self.command} --help)")

    def read(self, arguments: Sequence[str], overrides: bool = False) -> argparse.Namespace:
        """Parse a command line.

        A word `key=value` that is not a path is an error. With `overrides`, the word is an error only if its key is the name
        of a flag.
        """
        self._refuse_overrides(arguments, overrides)
        options, extra = self.parse_known_intermixed_args(list(arguments))
        for word in extra:
            if word.startswith("-"):
                raise UserError(unknown_flag(self.command, word, self.flags(), self._keys, arguments))
            raise UserError(f"{self.command}: {word}: unexpected argument")
        for term in options.where if self._where else ():
            if "=" not in term:
                raise UserError(f"{WHERE} {term}: must be followed by KEY=VALUE, e.g. {WHERE} reward.k=1,40")
        return options

    def _refuse_overrides(self, arguments: Sequence[str], allowed: bool) -> None:
        flags, in_where = self.flags(), False
        takes_value = {
            name for action in self._actions if action.nargs != 0 for name in action.option_strings
        }
        for before, word in zip(("", *arguments), arguments, strict=False):
            if word.startswith("-"):
                in_where = word == WHERE
            key, separator, value = word.partition("=")
            if (
                word.startswith("-")
                or in_where
                or not separator
                or not re.fullmatch(r"[\w.@/:+~-]+!?", key)  # 'PPO gamma=0.99' is the label of an agent
                or before in takes_value
                or os.path.exists(word)
            ):
                continue
            flag = f"--{key.replace('_', '-')}"
            if flag in flags and key != WHERE[2:]:
                typed = f"{flag} {value}" if flag in takes_value else flag
                raise UserError(f"{word}: {self.command} takes flags: {typed}")
            if allowed:
                continue
            if self._where and re.fullmatch(r"[\w.]+!?", key):
                raise UserError(f"{word}: is not a path; to select runs type {WHERE} {word}")
            raise UserError(f"{word}: {self.command} takes no key=value; {closest(flag, flags)}")
