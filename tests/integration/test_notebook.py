"""The notebook in examples/ runs from top to bottom: shell lines as commands, other cells as Python."""

from __future__ import annotations

import json
import shlex
from pathlib import Path
from typing import Any

import pytest

from auvbench.cli import main

NOTEBOOK = Path(__file__).parents[2] / "examples" / "first_study.ipynb"


def cells() -> list[str]:
    document = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    return ["".join(cell["source"]) for cell in document["cells"] if cell["cell_type"] == "code"]


@pytest.mark.slow
def test_every_cell_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    space: dict[str, Any] = {}
    for cell in cells():
        # A test needs no good policy: with a short training each command still does all of its work.
        cell = cell.replace("train.total_steps=60000", "train.total_steps=4096")
        if cell.startswith("!"):
            program, *words = shlex.split(cell[1:])
            assert program == "auvbench"
            assert main(words) == 0, cell
        else:
            exec(compile(cell, NOTEBOOK.name, "exec"), space)
    table = space["table"].set_index("agent")
    assert table.index.size == 3
    assert table.loc["PID", "success_rate"] > 0.9
    low, high = space["ends"]
    assert (low >= 0).all()
    assert (high >= 0).all()
    assert space["ax"].get_lines()[0].get_xdata().size == 3
