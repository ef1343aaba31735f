"""One grammar for all commands: `key=value` is configuration, `--flag` is how something is done or shown.

The wrong one gets one line with the right one.
"""

from __future__ import annotations

import argparse
import difflib
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

from auvbench.config.suggestions import unknown_flag
from auvbench.errors import UserError, closest

WHERE = "--where"
WHERE_HELP = "only runs of these values: --where vehicle=rexrov reward.k=1,40 algo!=random"


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, and which flag a `key=value` stands for.

    With `where=True` the parsed options have `where`, the terms after `--where`.
    """

    def __init__(self, *arguments: Any, where: bool = False, **options: Any) -> None:
        super().__init__(*arguments, **{"allow_abbrev": False, **options})
        self._where = where
        if where:  # taken out before argparse sees it; here for the help alone
            self.add_argument(WHERE, nargs="*", default=[], metavar="KEY=VALUE,...", help=WHERE_HELP)

    @property
    def command(self) -> str:
        return self.prog.split()[-1]

    def flags(self) -> list[str]:
        """`--rank-by`, `--protocol`, ...: the long ones."""
        return [name for action in self._actions for name in action.option_strings if name.startswith("--")]

    def error(self, message: str) -> NoReturn:
        unknown = re.match(r"unrecognized arguments: (.*)", message, re.DOTALL)
        if unknown:
            words = unknown[1].split()
            flag = next((word for word in words if word.startswith("-")), None)
            if flag is not None:
                raise UserError(unknown_flag(self.command, flag, self.flags()))
            message = f"{words[0]}: one word too many"
        raise UserError(f"{self.command}: {message} (auvbench {self.command} --help)")

    def read(self, arguments: Sequence[str], overrides: bool = False) -> argparse.Namespace:
        """Parses a command line; a `key=value` that is no path is refused, with `overrides` only if it is a flag."""
        rest, terms = take_where(arguments) if self._where else (list(arguments), [])
        self._refuse_overrides(rest, overrides)
        given = self.parse_args(rest)
        if self._where:
            given.where = terms
        return given

    def _refuse_overrides(self, arguments: Sequence[str], allowed: bool) -> None:
        flags = self.flags()
        takes_value = {
            name for action in self._actions if action.nargs != 0 for name in action.option_strings
        }
        for before, word in zip(("", *arguments), arguments, strict=False):
            key, separator, value = word.partition("=")
            if word.startswith("-") or not separator or before in takes_value:
                continue
            if Path(word).exists():
                continue
            flag = f"--{key.replace('_', '-')}"
            if flag in flags and not (self._where and flag == WHERE):
                shown = flag if flag not in takes_value else f"{flag} {value}"
                raise UserError(f"{word}: {self.command} takes flags: {shown}")
            if allowed:
                continue
            if key in {action.dest for action in self._actions if not action.option_strings}:
                raise UserError(f"{word}: {self.command} takes it without the key: {value}")
            near = difflib.get_close_matches(flag, flags, n=1, cutoff=0.75)
            if near:
                raise UserError(f"{word}: {self.command} takes flags; did you mean {near[0]} {value}?")
            if self._where and re.fullmatch(r"[\w.]+!?", key):
                raise UserError(f"{word}: to keep only such runs type {WHERE} {word}")
            raise UserError(f"{word}: {self.command} takes no key=value; {closest(flag, flags)}")


def take_where(arguments: Sequence[str]) -> tuple[list[str], list[str]]:
    """The command line without `--where` and the terms that follow it, and these terms.

    Every word with a `=` that follows is a term, up to the first word without one.

    >>> take_where(["outputs", "--where", "seed=0", "reward.k=1,40", "--json"])
    (['outputs', '--json'], ['seed=0', 'reward.k=1,40'])
    """
    rest: list[str] = []
    terms: list[str] = []
    words = list(arguments)
    while words:
        word = words.pop(0)
        if word.startswith(f"{WHERE}="):
            terms.append(word.removeprefix(f"{WHERE}="))
        elif word == WHERE:
            taken = []
            while words and "=" in words[0] and not words[0].startswith("-"):
                taken.append(words.pop(0))
            if not taken:
                follows = f"{WHERE} {words[0]}" if words else WHERE
                raise UserError(f"{follows}: must be followed by KEY=VALUE, e.g. {WHERE} reward.k=1,40")
            terms += taken
        else:
            rest.append(word)
    return rest, terms
