"""`auvbench runs` at the widths of real terminals, and its configuration columns."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import pytest
import yaml
from rich.console import Console

from auvbench import cli
from auvbench.commands.runs import Row, table
from auvbench.runs.status import State
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


def shown(width: int) -> list[str]:
    console = Console(file=(text := io.StringIO()), width=width)
    console.print(table(ROWS, console))
    return text.getvalue().splitlines()


@pytest.mark.parametrize("width", [80, 100, 140, 1000])
def test_steps_success_and_time_are_whole_at_any_width(width: int) -> None:
    lines = shown(width)
    assert max(map(len, lines)) <= width
    assert all(word in lines[0] for word in ("state", "steps", "success", "wall time"))
    body = [line for line in lines[1:] if "1,000,000" in line]
    assert len(body) == 4
    assert all("2 d 5 h" in line for line in body)
    assert [line.count("100%") for line in body] == [1, 1, 1, 0], "of 3 episodes it says nothing"


def test_what_differs_is_a_column_and_what_follows_from_it_is_not() -> None:
    heading = shown(400)[0].split()
    assert "disturbance" in heading
    assert "disturbance.current.speed" not in heading
    assert "algo" not in heading
    assert "disturbance" not in shown(80)[0].split()


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
