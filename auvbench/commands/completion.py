"""`auvbench completion SHELL`: prints what a shell needs to complete commands, overrides and paths."""

from __future__ import annotations

from collections.abc import Sequence

from auvbench.commands import COMMANDS
from auvbench.errors import UserError, closest

# Hydra completes overrides when it is asked with the line in COMP_LINE; a command's name must be taken out first.
_HYDRA_COMMANDS = ("train", "tune", "simulate")

_BASH = """\
_auvbench() {
    local word="${COMP_WORDS[COMP_CWORD]}" rest choices
    if [ "$COMP_CWORD" -eq 1 ]; then
        COMPREPLY=($(compgen -W "@COMMANDS@" -- "$word"))
        [ "${#COMPREPLY[@]}" -eq 1 ] && COMPREPLY[0]="${COMPREPLY[0]} "
        return
    fi
    case "${COMP_WORDS[1]}" in
        @HYDRA@)
            if [ "${word#algo.path=}" != "$word" ]; then
                COMPREPLY=($(compgen -f -P "algo.path=" -- "${word#algo.path=}"))
                [ "${#COMPREPLY[@]}" -eq 1 ] && [ -d "${COMPREPLY[0]#algo.path=}" ] && COMPREPLY[0]="${COMPREPLY[0]}/"
                return
            fi
            rest="${COMP_LINE#*"${COMP_WORDS[1]}"}"
            choices=$(COMP_LINE="auvbench$rest" COMP_POINT=0 auvbench "${COMP_WORDS[1]}" -sc query=bash 2>/dev/null)
            COMPREPLY=($(compgen -o nospace -o default -W "$choices" -- "$word"))
            ;;
        *)
            choices=$(auvbench completion query "${COMP_WORDS[@]:1:COMP_CWORD}" 2>/dev/null)
            COMPREPLY=($(compgen -W "$choices" -- "$word"))
            if [ "${#COMPREPLY[@]}" -eq 1 ] && [ "${COMPREPLY[0]: -1}" != "=" ]; then
                COMPREPLY[0]="${COMPREPLY[0]} "
            elif [ "${#COMPREPLY[@]}" -eq 0 ]; then
                COMPREPLY=($(compgen -o default -- "$word"))
            fi
            ;;
    esac
}
COMP_WORDBREAKS=${COMP_WORDBREAKS//=}
complete -o nospace -o default -F _auvbench auvbench
"""

_ZSH = "autoload -U +X compinit && compinit\nautoload -U +X bashcompinit && bashcompinit\n"

_FISH = """\
function _auvbench_overrides
    set -l words (commandline -opc) (commandline -ct)
    COMP_LINE="auvbench $words[3..-1]" COMP_POINT=0 auvbench $words[2] -sc query=bash 2>/dev/null | string split ' '
end
complete -c auvbench -f -n __fish_use_subcommand -a "@COMMANDS@"
complete -c auvbench -f -n "__fish_seen_subcommand_from @HYDRA_WORDS@" -a "(_auvbench_overrides)"
function _auvbench_words
    set -l token (commandline -ct)
    set -l words (commandline -opc) "$token"
    set -l found (auvbench completion query $words[2..-1] 2>/dev/null | string match -v '' | string match -- "$token*")
    if set -q found[1]
        printf '%s\\n' $found
    else
        for path in "$token"*
            test -d $path; and echo $path/; or echo $path
        end
    end
end
complete -c auvbench -f -a "(_auvbench_words)" -n "not __fish_use_subcommand; and not __fish_seen_subcommand_from @HYDRA_WORDS@"
"""

SCRIPTS = {"bash": _BASH, "zsh": _ZSH + _BASH, "fish": _FISH}

USAGE = """\
usage: auvbench completion {bash,zsh,fish}

Prints a script that completes commands, overrides (algo=<TAB>, reward.<TAB>, protocol=<TAB>), flags and their values
(--rank-by <TAB>, --state <TAB>), vehicles and paths.

  bash   eval "$(auvbench completion bash)"      (in ~/.bashrc)
  zsh    eval "$(auvbench completion zsh)"       (in ~/.zshrc)
  fish   auvbench completion fish | source       (in ~/.config/fish/config.fish)
"""


def main(arguments: Sequence[str]) -> int:
    if not arguments or arguments[0] in ("-h", "--help"):
        print(USAGE, end="")
        return 0 if arguments else 2
    if arguments[0] == "query":  # asked by the scripts: the words of the line, the last being typed
        from auvbench.commands.completion_words import candidates

        print("\n".join(candidates(arguments[1:])))
        return 0
    if len(arguments) > 1 or arguments[0] not in SCRIPTS:
        raise UserError(f"completion {' '.join(arguments)}: no such shell; {closest(arguments[0], SCRIPTS)}")
    script = SCRIPTS[arguments[0]]
    for placeholder, text in (
        ("@COMMANDS@", " ".join(COMMANDS)),
        ("@HYDRA@", "|".join(_HYDRA_COMMANDS)),
        ("@HYDRA_WORDS@", " ".join(_HYDRA_COMMANDS)),
    ):
        script = script.replace(placeholder, text)
    print(script, end="")
    return 0
