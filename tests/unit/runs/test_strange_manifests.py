"""Manifests with fields of another kind, and with text that a terminal or rich would obey."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from auvbench import cli
from auvbench.runs import integrity
from tests import fake_training
from tests.unit.runs.test_damage import frozen
from tests.waiting import LIMIT

FIELDS: list[tuple[str, Any]] = [
    ("success_rate", "x"),
    ("success_rate", 7),
    ("created", 1.5),
    ("wall_time_s", "1"),
    ("wall_time_s", True),
    ("wall_time_s", -1),
    ("episodes", [1]),
    ("steps", True),
    ("steps", -5),
    ("seed", 1e3),
    ("algo", ["ppo"]),
    ("id", None),
    ("error", {"message": ["x"]}),
    ("error", {"message": "x", "step": "y"}),
    ("phases", {"setup_s": "x"}),
    ("state", {}),
]


@pytest.mark.parametrize(("field", "value"), FIELDS)
@pytest.mark.parametrize("flag", [[], ["--json"]])
def test_a_field_of_another_kind_is_one_line(
    field: str, value: Any, flag: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good = fake_training.make(tmp_path / "x" / "good")
    bad = fake_training.make(tmp_path / "x" / "bad")
    data = json.loads(bad.manifest_path.read_text())
    bad.manifest_path.write_text(json.dumps(integrity.sealed({**data, field: value})))
    assert cli.main(["runs", str(tmp_path), *flag]) == 1
    captured = capsys.readouterr()
    assert captured.err.count("\n") == 1
    assert f"damaged: {field}" in captured.err
    assert good.id in captured.out  # the other is listed


@pytest.mark.parametrize("text", ["[/b]", "a\x1b]0;owned\x07b", "line\nbreak", "\u202eabc", "\ud800"])
def test_text_of_a_manifest_does_nothing_to_a_terminal(
    text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = fake_training.make(tmp_path / "x" / "run")
    run.update_manifest(state="failed", error={"message": text, "type": "X"}, command=text)
    assert cli.main(["runs", str(tmp_path)]) == 0
    output = capsys.readouterr().out
    assert all(c.isprintable() or c == "\n" for c in output)
    assert "failed" in output


@pytest.mark.parametrize("text", ["a\x1b]0;owned\x07b", "line\nbreak", "\u202eabc", "\ud800", "x" * 20_000])
@pytest.mark.parametrize("field", ["id", "algo", "created"])
def test_a_name_that_no_terminal_shows_is_damage(
    text: str, field: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = fake_training.make(tmp_path / "x" / "run")
    run.update_manifest(**{field: text})
    assert cli.main(["runs", str(tmp_path)]) == 1
    error = capsys.readouterr().err.rstrip("\n")
    assert error.isprintable()
    assert f"damaged: {field}" in error


@pytest.mark.parametrize(
    "content",
    ["NaN", '{"a":' * 100_000, "[" * 100_000, '{"schema_version": 1, "wall_time_s": NaN}', "\x00" * 99],
)
def test_a_manifest_that_is_none_is_one_line(
    content: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = fake_training.make(tmp_path / "x" / "run")
    run.manifest_path.write_text(content)
    for arguments in (["runs"], ["runs", "--json"], ["resume"], ["evaluate"], ["report"], ["replay"]):
        assert cli.main([*arguments, str(run.path)]) in (1, 2)
        error = capsys.readouterr().err
        assert error.count("auvbench: ") >= 1
        assert "defect" not in error


def test_a_pipe_for_a_manifest_does_not_hang(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = fake_training.make(tmp_path / "x" / "run")
    run.manifest_path.unlink()
    os.mkfifo(run.manifest_path)
    for command in ("runs", "resume", "evaluate", "report", "replay"):
        assert cli.main([command, str(run.path)]) in (1, 2)
        assert "defect" not in capsys.readouterr().err


@pytest.mark.slow
def test_a_configuration_without_end_costs_no_other_run(tmp_path: Path) -> None:
    """In a process of its own, which PyYAML's loader ended."""
    good = frozen(tmp_path, "algo=random", "seed=0", state="complete")
    bad = frozen(tmp_path, "algo=random", "seed=1", state="complete")
    bad.config_path.write_bytes(b"x:\r" + b"- " * 100_000)
    code = "import sys; from auvbench import cli; sys.exit(cli.main(sys.argv[1:]))"
    command = [sys.executable, "-c", code, "runs", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT)
    assert done.returncode in (0, 1)
    assert good.id in done.stdout
