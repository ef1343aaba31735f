"""The command line: names the commands and imports one only when it is chosen.

Nothing heavy is imported here (a test asserts that torch, hydra, numba and pandas stay out of `--help`), so
that help and completion answer at once.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Sequence

from auvbench import __version__
from auvbench.commands import COMMANDS
from auvbench.errors import UserError, closest, plain_warnings
from auvbench.guard import guarded
from auvbench.untrusted.text import short


def usage() -> str:
    width = max(map(len, COMMANDS))
    lines = [f"  {name:<{width}}  {text}" for name, text in COMMANDS.items()]
    return "\n".join(
        [
            "usage: auvbench COMMAND [ARGUMENTS]",
            "",
            "Which controller tracks waypoints best on an underwater vehicle, and how sure are we?",
            "",
            "commands:",
            *lines,
            "",
            "  auvbench COMMAND --help   what a command takes",
            "  auvbench --version        the version",
            "",
            "first steps:",
            "  auvbench train algo=ppo reward.k=1",
            "  auvbench train -m algo=sac,ppo reward.k=1,40,100 step.frequency=10,25,55 seed=0,1,2",
            "  auvbench evaluate outputs && auvbench report outputs",
        ]
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Runs one command; returns its exit code.

    0 done, 1 failed, 2 the user's mistake, 70 a defect of auvbench (see guard.py), 130 interrupted.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    return guarded(lambda: _dispatch(arguments), arguments)


def _dispatch(arguments: Sequence[str]) -> int:
    if not arguments or arguments[0] in ("-h", "--help", "help"):
        print(usage())
        return 0
    if arguments[0] == "-V" or (arguments[0] in (*COMMANDS, "--version") and "--version" in arguments):
        print(f"auvbench {__version__}")
        return 0
    plain_warnings()
    name, rest = arguments[0], arguments[1:]
    if name not in COMMANDS:
        raise UserError(f"unknown command {short(name)!r}; {closest(short(name), COMMANDS)}")
    command = importlib.import_module(f"auvbench.commands.{name.replace('-', '_')}")
    return int(command.main(rest) or 0)


if __name__ == "__main__":
    sys.exit(main())
