"""`auvbench completion SHELL`: print a script that completes commands, overrides, flags, values and paths.

The script calls `auvbench completion query WORDS` at each Tab. This call imports nothing heavy, except for commands
whose overrides Hydra completes.
"""

from __future__ import annotations

import glob
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from importlib import import_module

from auvbench.analysis.options import FORMATS, STUDIES
from auvbench.config import folders
from auvbench.errors import UserError, closest
from auvbench.grammar import WHERE, Parser
from auvbench.record import measure_names
from auvbench.registry import COMMANDS

_BASH = """\
_auvbench() {
    local word="${COMP_WORDS[COMP_CWORD]}"
    local choices=$(auvbench completion query "${COMP_WORDS[@]:1:COMP_CWORD}" 2>/dev/null)
    local IFS=$'\\n'
    COMPREPLY=($(compgen -W "$choices" -- "$word"))
    if [ "${#COMPREPLY[@]}" -eq 1 ]; then
        case "${COMPREPLY[0]}" in *=|*/) ;; *) COMPREPLY[0]="${COMPREPLY[0]} " ;; esac
    fi
}
COMP_WORDBREAKS=${COMP_WORDBREAKS//=}
complete -o nospace -F _auvbench auvbench
"""

_ZSH = "autoload -U +X compinit && compinit\nautoload -U +X bashcompinit && bashcompinit\n"

_FISH = """\
function _auvbench
    set -l token (commandline -ct)
    set -l words (commandline -opc)
    auvbench completion query $words[2..-1] "$token" 2>/dev/null
end
complete -c auvbench -f -a "(_auvbench)"
"""

SCRIPTS = {"bash": _BASH, "zsh": _ZSH + _BASH, "fish": _FISH}

USAGE = """\
usage: auvbench completion {bash,zsh,fish}

Prints a script that completes commands, overrides (algo=<TAB>, reward.<TAB>, protocol=<TAB>), flags and their values
(--rank-by <TAB>), vehicles and paths.

  bash   eval "$(auvbench completion bash)"      (in ~/.bashrc)
  zsh    eval "$(auvbench completion zsh)"       (in ~/.zshrc)
  fish   auvbench completion fish | source       (in ~/.config/fish/config.fish)
"""

HYDRA = {
    "train": ("-m", "--cfg", "--help"),
    "tune": ("-m", "--cfg", "--help"),
    "simulate": ("--cfg",),
}
"""Commands whose overrides Hydra completes, each with its flags"""
FILTERED = ("algo", "vehicle", "task", "reward.k", "step.frequency", "seed", "state", "id", "experiment")
"""Keys that completion offers after `--where`"""

VALUES: Mapping[str, Sequence[str]] = {
    **dict.fromkeys(("--rank-by", "--metric"), measure_names()),
    "state": ("pending", "running", "interrupted", "failed", "complete"),
    "frame": ("enu", "ned"),
    "gate": ("on", "off"),
    "--format": FORMATS,
    "--study": STUDIES,
}
"""Values of flags and keys; all other flags and keys take the options of their group in `conf/`"""


def main(arguments: Sequence[str]) -> int:
    if not arguments or arguments[0] in ("-h", "--help"):
        print(USAGE, end="")
        return 0 if arguments else 2
    if arguments[0] == "query":  # a script passes the typed words; the last is unfinished
        with suppress(Exception):  # a half-typed line may be invalid
            print("\n".join(candidates(arguments[1:]) or _paths(arguments[-1])))
        return 0
    if len(arguments) > 1 or arguments[0] not in SCRIPTS:
        raise UserError(f"completion {' '.join(arguments)}: unknown shell; {closest(arguments[0], SCRIPTS)}")
    print(SCRIPTS[arguments[0]], end="")
    return 0


def candidates(words: Sequence[str]) -> list[str]:
    """Return the completions of the last word.

    Args:
        words: words after `auvbench`; the last one is unfinished and may be empty.

    >>> candidates(["evaluate", "outputs", "protocol=th"])
    ['protocol=thesis']
    """
    command, *before, word = words if len(words) > 1 else ("", *words)
    flags = _flags(command)
    flag = before[-1] if before else ""
    if not command:
        offered = list(COMMANDS.names())
    elif word.startswith("-"):
        offered = flags
    elif flag.startswith("--") and flag in flags and (values := _values(flag)):
        offered = _listed(values, word)
    elif command in HYDRA:
        from auvbench.config.compose import complete_override

        offered = complete_override(command, " ".join([*before, word]))
    else:
        offered = _assignments(FILTERED if WHERE in before else _keys(command), word)
        offered += folders.options("vehicle") if command == "vehicles" else []
    return sorted({name for name in offered if name.startswith(word)})


def _flags(command: str) -> list[str]:
    if command in HYDRA or command not in COMMANDS.own:
        return list(HYDRA.get(command, ()))
    own = COMMANDS[command].code.partition(":")[0]
    module = import_module("auvbench.commands.report_options" if command == "report" else own)
    parser = module.parser() if hasattr(module, "parser") else None
    return parser.flags() if isinstance(parser, Parser) else []


def _keys(command: str) -> Sequence[str]:
    return COMMANDS[command].completed if command in COMMANDS.own else ()


def _values(name: str) -> Sequence[str]:
    """Return the valid values of a flag or a key."""
    group = "algo" if name == "--baseline" else name.removeprefix("--")
    return VALUES[name] if name in VALUES else folders.options(group)


def _assignments(keys: Sequence[str], word: str) -> list[str]:
    """Return completions `key=` while the user types the key, and completions `key=value` after the `=`."""
    key, separator, value = word.partition("=")
    if not separator:
        return [f"{name}=" for name in keys]
    return [f"{key}={item}" for item in _listed(_values(key), value)] if key in keys else []


def _listed(values: Sequence[str], word: str) -> list[str]:
    """Return completions for the last item of a comma-separated list."""
    done, comma, _ = word.rpartition(",")
    return [f"{done}{comma}{value}" for value in values if value not in done.split(",")]


def _paths(word: str) -> list[str]:
    """Return the paths that start with the word or, for a word with `=`, with the text after the `=`."""
    key, separator, start = word.rpartition("=")
    matches = sorted(glob.glob(f"{glob.escape(start)}*"))
    return [f"{key}{separator}{path}{'/' if os.path.isdir(path) else ''}" for path in matches]
