"""The README of a study: places for its author, computed blocks between markers, and the commands behind the runs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from auvbench.analysis.records import RunRecord
from auvbench.analysis.sources import RunFolder
from auvbench.errors import UserError
from auvbench.reporting import readme

BLOCKS = {"provenance": "how", "table": "numbers"}


def run(**manifest: Any) -> RunRecord:
    return RunRecord("x", RunFolder(Path("x")), "complete", 0, {}, manifest)


def test_a_new_one_has_question_answer_and_blocks_in_order(tmp_path: Path) -> None:
    text = readme.fill(tmp_path / "README.md", "Study", BLOCKS)
    heads = [line for line in text.splitlines() if line.startswith("#")]
    assert heads == ["# Study", "## Question", "## Answer", "## Result", "## Caveats"]
    assert readme.QUESTION in text
    assert readme.ANSWER in text
    assert "<details><summary>How the numbers came about</summary>\n\nhow\n\n</details>" in text


def test_what_the_author_wrote_stays(tmp_path: Path) -> None:
    path = tmp_path / "README.md"
    text = readme.fill(path, "Study", BLOCKS).replace(readme.ANSWER, "PID. It is enough.")
    path.write_text(text)
    again = readme.fill(path, "Other", BLOCKS | {"table": "other numbers"})
    assert again == text.replace("\nnumbers\n", "\nother numbers\n")


def test_a_block_without_its_place_is_named(tmp_path: Path) -> None:
    path = tmp_path / "README.md"
    path.write_text(readme.fill(path, "Study", BLOCKS))
    with pytest.raises(UserError, match="the block policies is missing"):
        readme.check(path, [*BLOCKS, "policies"])
    path.write_bytes(b"\xff")
    with pytest.raises(UserError, match="cannot be read"):
        readme.check(path, BLOCKS)


def test_commands_of_training_each_once_those_of_most_runs_first() -> None:
    many = [run(command=f"auvbench train seed={i}") for i in range(7)]
    text = readme.provenance([run(command="auvbench train -m algo=ppo")] * 3 + many, "auvbench publish x")
    lines = [line.strip() for line in text.splitlines() if line.startswith("    ")]
    assert lines[0] == "auvbench train -m algo=ppo"
    assert lines[1:5] == [f"auvbench train seed={i}" for i in range(4)]
    assert lines[5] == "auvbench publish x"
    assert "and 3 more different commands" in text
    assert (
        "not recorded"
        in readme.provenance([run()], "auvbench publish x").partition("The runs were copied")[0]
    )


def test_a_command_from_a_stranger_is_one_line() -> None:
    text = readme.provenance([run(command="a\n\n<!-- end: provenance -->\n# owned")], "auvbench publish x")
    assert not any(line.startswith(("<!--", "# owned")) for line in text.splitlines())


def test_wall_and_core_time() -> None:
    timed = [run(wall_time_s=60.0, cpu_time_s=200.0), run(wall_time_s=60.0, cpu_time_s=100.0)]
    taken = (
        "trained in 2 min by the clock, one run after another; 5 min of processor cores; how long the tests"
    )
    assert taken in readme.provenance(timed, "x")
    before = [run(wall_time_s=60.0)]  # of a version that did not record the time of cores
    text = readme.provenance(timed + before, "x")
    assert "trained in 3 min" in text
    assert "5 min of processor cores, without 1 run that did not record them" in text
