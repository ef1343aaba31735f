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

MEANT = {
    **dict.fromkeys(("list", "ls", "status", "ps"), "runs"),
    **dict.fromkeys(("test", "eval", "benchmark"), "evaluate"),
    **dict.fromkeys(("rank", "table", "plot", "show"), "report"),
    **dict.fromkeys(("learn", "run", "fit", "start"), "train"),
    **dict.fromkeys(("view", "render", "play", "film"), "replay"),
    **dict.fromkeys(("continue", "extend"), "resume"),
    **dict.fromkeys(("optimise", "optimize", "search"), "tune"),
    **dict.fromkeys(("diff", "versus"), "compare"),
    **dict.fromkeys(("new", "create"), "init"),
}
"""Commands of other programs, and what does the same here."""


def usage() -> str:
    width = max(map(len, COMMANDS))
    lines = [f"  {name:<{width}}  {text}" for name, text in COMMANDS.items()]
    return "\n".join(
        [
            "usage: auvbench COMMAND [ARGUMENTS]",
            "",
            "A benchmark of classical control and reinforcement learning for underwater vehicles.",
            "",
            "commands:",
            *lines,
            "",
            "  auvbench COMMAND --help   what a command takes",
            "  auvbench --version        the version",
            "",
            "first steps:",
            "  auvbench train algo=ppo reward.k=1",
            "  auvbench train -m algo=pid,ppo seed=0,1,2,3,4",
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
        hint = f"did you mean {MEANT[name]!r}?" if name in MEANT else closest(short(name), COMMANDS)
        raise UserError(f"unknown command {short(name)!r}; {hint}")
    command = importlib.import_module(f"auvbench.commands.{name.replace('-', '_')}")
    return int(command.main(rest) or 0)


if __name__ == "__main__":
    sys.exit(main())
