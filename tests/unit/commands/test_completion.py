"""Tab completion in a real bash."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from auvbench.cli import main
from auvbench.commands import COMMANDS


def complete(line: str) -> list[str]:
    script = f"""
        export PATH={Path(sys.executable).parent}:$PATH
        eval "$(auvbench completion bash)"
        COMP_LINE={line!r} COMP_WORDS=({line}{" ''" if line.endswith(" ") else ""})
        COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1)) COMP_POINT={len(line)}
        _auvbench
        printf '%s\\n' "${{COMPREPLY[@]}}"
    """
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=True)
    return done.stdout.split()


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash here")
@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("auvbench tr", ["train"]),
        ("auvbench train algo=sa", ["algo=sac", "algo=sac_thesis"]),
        ("auvbench train algo=sac algo.buf", ["algo.buffer_size="]),
        ("auvbench train reward.k", ["reward.k="]),
    ],
)
def test_bash_completes(line, expected):
    assert complete(line) == expected


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_scripts_name_every_command(shell, capsys):
    assert main(["completion", shell]) == 0
    out = capsys.readouterr().out
    assert all(command in out for command in COMMANDS)
    assert "@" not in out.replace("[@]", "")


def test_an_unknown_shell_is_named(capsys):
    assert main(["completion", "fsh"]) == 2
    assert "did you mean 'fish'?" in capsys.readouterr().err
