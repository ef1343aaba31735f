"""The command line: names the commands and imports one only when it is chosen.

Nothing heavy is imported here (a test asserts that torch, hydra, numba and pandas stay out of `--help`), so
that help and completion answer at once.
"""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Sequence

from auvbench import __version__
from auvbench.commands import COMMANDS
from auvbench.errors import AuvbenchError, UserError, closest, plain_warnings


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
    """Runs one command; returns its exit code (0 done, 1 failed, 2 the user's mistake, 130 interrupted)."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    if not arguments or arguments[0] in ("-h", "--help", "help"):
        print(usage())
        return 0
    if arguments[0] in ("-V", "--version"):
        print(f"auvbench {__version__}")
        return 0
    plain_warnings()
    name, rest = arguments[0], arguments[1:]
    try:
        if name not in COMMANDS:
            raise UserError(f"unknown command {name!r}; {closest(name, COMMANDS)}")
        command = importlib.import_module(f"auvbench.commands.{name.replace('-', '_')}")
        return int(command.main(rest) or 0)
    except AuvbenchError as error:
        print(f"auvbench: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt as interruption:
        # One of ours says what is saved and which signal it was.
        print(f"auvbench: {str(interruption) or 'interrupted'}", file=sys.stderr)
        return int(getattr(interruption, "exit_code", 130))
    except BrokenPipeError:
        # The reader of our output (head, less) went away: no error, and no second one at shutdown.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0


if __name__ == "__main__":
    sys.exit(main())
