"""Tab completion in a real bash."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from auvbench.cli import main
from auvbench.registry import COMMANDS


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


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash here")
@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("auvbench tr", ["train"]),
        (
            "auvbench train algo=sa",
            ["algo=sac", "algo=sac_residual", "algo=sac_residual_tuned", "algo=sac_thesis", "algo=sac_tuned"],
        ),
        ("auvbench train algo=sac algo.buf", ["algo.buffer_size="]),
        ("auvbench train reward.k", ["reward.k="]),
        ("auvbench evaluate outputs protocol=fr", ["protocol=frequency_sweep"]),
        ("auvbench report outputs --rank-by mean_en", ["mean_energy_J"]),
        ("auvbench vehicles rex", ["rexrov"]),
        ("auvbench submit outputs --protocol frequ", ["frequency_sweep"]),
        ("auvbench verify entry.zip --t", ["--to"]),
        ("auvbench runs outputs --hi", ["--history"]),
    ],
)
def test_bash_completes(line, expected):
    assert complete(line) == expected


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash here")
def test_the_file_of_a_policy_is_completed_as_a_path(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "policies").mkdir()
    (tmp_path / "policies" / "mine.onnx").touch()
    assert complete("auvbench train algo=onnx algo.path=pol") == ["algo.path=policies/"]
    assert complete("auvbench train algo=onnx algo.path=policies/m") == ["algo.path=policies/mine.onnx"]


def test_an_unknown_shell_is_named(capsys):
    assert main(["completion", "fsh"]) == 2
    assert "did you mean 'fish'?" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "some"),
    [
        ([""], list(COMMANDS)),
        (["evaluate", "outputs", "protocol="], ["protocol=robustness", "protocol=thesis"]),
        (["evaluate", "outputs", "--where", "vehicle="], ["vehicle=lrauv", "vehicle=rexrov"]),
        (["evaluate", "outputs", "--"], ["--where", "--cfg"]),
        (["report", "outputs", "--"], ["--baseline", "--rank-by", "--where", "--no-figures"]),
        (["report", "outputs", "--protocol", "t"], ["test", "thesis", "transfer"]),
        (["report", "outputs", "--rank-by", ""], ["success_rate", "mean_steps", "mean_time_to_goal_s"]),
        (["report", "outputs", "--format", "md,"], ["md,html", "md,tex"]),
        (["report", "--study", ""], ["thesis"]),
        (["runs", "outputs", "--where", "seed=0", "state=failed,"], ["state=failed,pending"]),
        (["replay", "outputs/x", "--protocol", ""], ["test", "long"]),
        (["vehicles", ""], ["bluerov2", "rexrov"]),
        (["vehicles", "--"], ["--sdf", "--sheet"]),
        (["resume", "outputs", "train."], ["train.total_steps="]),
    ],
)
def test_names_flags_and_values_are_known(words, some, capsys):
    assert main(["completion", "query", *words]) == 0
    offered = capsys.readouterr().out.split()
    assert set(some) <= set(offered)
    assert all(one.startswith(words[-1]) for one in offered)


def test_what_is_offered_is_what_commands_accept():
    from auvbench.analysis.measures import measure, measures
    from auvbench.commands import completion
    from auvbench.runs.status import State

    for name in completion.measure_names():
        measure(name)
    assert set(measures()) <= set(completion.measure_names())
    assert list(completion.VALUES["state"]) == [str(state) for state in State]


def test_nobody_waits_for_heavy_imports():
    code = (
        "import sys; from auvbench.cli import main; main(['completion', 'query', 'report', '--rank-by', '']);"
        "print([name for name in ('torch', 'pandas', 'hydra', 'numba', 'scipy') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


def typed_in_fish(line: str, folder: Path) -> list[str]:
    script = "auvbench completion fish | source; complete -C $argv[1]"
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["fish", "--no-config", "-c", script, line],
        cwd=folder,
        env={**os.environ, "PATH": path, "HOME": str(folder)},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.split()


@pytest.mark.skipif(shutil.which("fish") is None, reason="needs fish")
def test_fish_completes_commands_flags_overrides_and_paths(tmp_path: Path) -> None:
    (tmp_path / "outputs").mkdir()
    assert {"replay", "report", "resume"} <= set(typed_in_fish("auvbench re", tmp_path))
    assert "--rank-by" in typed_in_fish("auvbench report --r", tmp_path)
    assert "success_rate" in typed_in_fish("auvbench report --rank-by ", tmp_path)
    assert "algo=ppo" in typed_in_fish("auvbench train algo=", tmp_path)
    assert "protocol=test" in typed_in_fish("auvbench evaluate protocol=", tmp_path)
    assert typed_in_fish("auvbench report ou", tmp_path) == ["outputs/"]
    assert "outputs/" in typed_in_fish("auvbench replay ", tmp_path)
