"""`auvbench runs` at the widths of real terminals, its configuration columns, and --discard."""

from __future__ import annotations

import io
import json
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

from auvbench import cli
from auvbench.commands import runs_table
from auvbench.runs import lock
from auvbench.runs.status import State
from auvbench.scheduling.listing import Row
from tests import fake_training


def row(**changes: Any) -> Row:
    values: dict[str, Any] = {
        "id": "ppo_thesis-rexrov-k100-f55-s4-4ef700ae",
        "name": "thesis_faithful",
        "path": "x",
        "state": State.INTERRUPTED,
        "algo": "ppo_thesis",
        "seed": 4,
        "steps": 1_000_000,
        "total_steps": 2_000_000,
        "episodes": 500,
        "success_rate": 1.0,
        "wall_time_s": 2 * 86400 + 5 * 3600,
        "created": None,
        "holder": None,
        "error": None,
        "config": {"algo.name": "ppo_thesis", "disturbance.name": "none", "disturbance.current.speed": 0.0},
    }
    return Row(**values | changes)


ROWS = [
    row(),
    row(state=State.FAILED, error="the loss is not a number, and a long explanation of it " * 3),
    row(config={"algo.name": "x", "disturbance.name": "moderate", "disturbance.current.speed": 0.5}),
    row(name="other", episodes=3),
]


@pytest.mark.parametrize("width", [60, 80, 100, 140, 1000])
def test_steps_success_and_time_are_whole_at_any_width(width: int) -> None:
    lines = [line.plain for line in runs_table.lines(ROWS, (), width)]
    assert max(map(len, lines)) <= max(width, 78)
    heading = lines[0].split("  ")
    assert {"state", "steps", "success", "wall time"} <= {word.strip() for word in heading}
    body = [line for line in lines[1:] if "4ef700ae" in line]
    assert len(body) == 4
    assert all(
        "1,000,000" in line and "2 d 5 h" in line and line.startswith(("ppo_th", "th", "ot")) for line in body
    )
    assert [("100%" in line) for line in body] == [True, True, True, False], "of 3 episodes it says nothing"
    assert any("the loss is not a number" in line for line in lines)


def test_what_differs_is_a_column_and_what_follows_from_it_is_not() -> None:
    heading = runs_table.lines(ROWS, (), 200)[0].plain.split()
    assert "disturbance" in heading
    assert "disturbance.current.speed" not in heading
    assert "algo" not in heading


@pytest.fixture
def outputs(tmp_path: Path) -> Path:
    root = tmp_path / "outputs"
    for number in range(3):
        run = fake_training.make(root / "a" / f"ppo-{number}")
        config = {
            "algo": {"name": "ppo"},
            "reward": {"k": [1, 40, 40][number]},
            "vehicle": {"name": "rexrov", "mass": 1},
        }
        run.config_path.write_text(yaml.safe_dump(config))
    run.update_manifest(state="complete", steps=50)
    return root


def names(root: Path) -> list[str]:
    return sorted(path.name for path in (root / "a").iterdir())


def test_json_has_the_configuration_and_where_asks_for_it(
    outputs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["runs", str(outputs), "--json", "--where", "reward.k=40", "vehicle=rexrov"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [one["id"] for one in found] == ["ppo-1", "ppo-2"]
    assert found[0]["config"] == {"algo.name": "ppo", "reward.k": 40, "vehicle.name": "rexrov"}


def test_columns_are_shown_on_demand(outputs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["runs", str(outputs), "--columns", "reward.k,vehicle"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split()[-2:] == ["reward.k", "vehicle"]
    assert lines[2].split()[-2:] == ["40", "rexrov"]
    assert cli.main(["runs", str(outputs), "--columns", "k"]) == 2
    assert "did you mean reward.k?" in capsys.readouterr().err


def test_discard_removes_pending_runs_and_no_others(
    outputs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["runs", str(outputs), "--discard", "--yes", "--where", "reward.k=40"]) == 0
    out = capsys.readouterr().out
    assert out.index("ppo-1") < out.index("1 run removed"), "shown before it goes"
    assert names(outputs) == ["ppo-0", "ppo-2"]
    assert cli.main(["runs", str(outputs), "--discard", "--yes"]) == 0
    assert names(outputs) == ["ppo-2"]
    assert cli.main(["runs", str(outputs), "--discard", "--yes"]) == 0
    assert "nothing to discard" in capsys.readouterr().out


@pytest.mark.parametrize(("answer", "gone"), [("y", True), ("", False), ("n", False)])
def test_discard_asks(
    outputs: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    answer: str,
    gone: bool,
) -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    monkeypatch.setattr(sys, "stdin", Terminal(f"{answer}\n"))
    assert cli.main(["runs", str(outputs), "--discard"]) == (0 if gone else 1)
    assert "remove these 2 pending runs?" in capsys.readouterr().out
    assert len(names(outputs)) == (1 if gone else 3)


def test_discard_does_not_guess_where_nobody_can_answer(
    outputs: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO("y\n"))
    assert cli.main(["runs", str(outputs), "--discard"]) == 2
    assert "--yes" in capsys.readouterr().err
    assert cli.main(["runs", str(outputs), "--yes"]) == 2
    assert len(names(outputs)) == 3


def test_a_run_that_somebody_begins_is_kept(outputs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from auvbench.commands import discard

    with lock.acquire(outputs / "a" / "ppo-0"):
        assert cli.main(["runs", str(outputs), "--discard", "--yes"]) == 0
    assert names(outputs) == ["ppo-0", "ppo-2"], "held: it is running, whatever its manifest says"

    fake_training.make(outputs / "a" / "ppo-3")
    begun = discard._remove

    def remove(path: Path) -> None:
        fake_training.RunDirectory(path).update_manifest(state="running")
        begun(path)

    monkeypatch.setattr(discard, "_remove", remove)
    assert cli.main(["runs", str(outputs), "--discard", "--yes"]) == 1
    assert len(names(outputs)) == 3
