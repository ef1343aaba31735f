"""Tests on validation scenarios during training: the rows they leave, and that training does not notice them."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from auvbench.agents.learned.sb3 import Follower
from auvbench.evaluation import evaluate as evaluation
from auvbench.evaluation.protocol import fingerprint, resolve_conditions
from auvbench.runs.directory import RunDirectory
from auvbench.training.execute import execute
from auvbench.training.validation import columns
from tests import configs
from tests.conftest import Once, Trained
from tests.soak.bits import bits
from tests.soak.campaign import frozen

WATCHED = "train.evaluate_every=700"


def rows(run: RunDirectory) -> list[dict[str, str]]:
    with (run.path / "train/validation.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def without_wall_time(run: RunDirectory) -> list[dict[str, str]]:
    return [{key: value for key, value in row.items() if key != "wall_s"} for row in rows(run)]


@pytest.fixture(scope="module", params=["ppo-8", pytest.param("sac-8", marks=pytest.mark.slow)])
def case(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def watched(case: str, once: Once) -> RunDirectory:
    folder = once(f"watched-{case}", lambda folder: execute(frozen(folder, "watched", case, [WATCHED])))
    path = next((folder / "watched").glob("*/manifest.json")).parent
    return RunDirectory(path)


@pytest.mark.slow
def test_training_does_not_notice_that_it_is_watched(
    case: str, watched: RunDirectory, trained: Trained
) -> None:
    alone = trained(case)
    expected, found = bits(alone.path), bits(watched.path)
    different = {key for key in expected.keys() | found.keys() if expected.get(key) != found.get(key)}
    assert different == {"scalars"}, "TensorBoard has the validation's rates besides"
    assert alone.id != watched.id
    assert not (alone.path / "train/validation.csv").exists()


def test_a_row_every_so_many_steps_and_one_at_the_end(watched: RunDirectory) -> None:
    found = rows(watched)
    assert tuple(found[0]) == columns("waypoint")
    steps = [int(row["step"]) for row in found]
    n, total = 8, watched.manifest()["steps"]
    assert steps[-1] == total
    assert steps[:-1] == [-(-k * 700 // n) * n for k in range(1, total // 700 + 1)][: len(steps) - 1]
    assert {int(row["episodes"]) for row in found} == {100}
    for row in found:
        rates = [float(row[f"{name}_rate"]) for name in ("success", "collision", "timeout")]
        assert sum(rates) == pytest.approx(1.0, abs=1e-12)
        assert float(row["simulated_s"]) == int(row["step"]) / watched.config()["step"]["frequency"]
    times = [float(row["wall_s"]) for row in found]
    assert times == sorted(times)
    assert int(found[-1]["training_episodes"]) <= watched.manifest()["episodes"]
    assert watched.manifest()["phases"]["validation_s"] > 0


@pytest.mark.slow
def test_the_last_row_is_what_evaluate_finds_on_the_validation_scenarios(watched: RunDirectory) -> None:
    protocol = configs.protocol("protocol=validation")
    summary = evaluation.evaluate(watched, protocol)
    (condition,) = summary["conditions"]
    last = rows(watched)[-1]
    assert float(last["success_rate"]) == condition["success_rate"]
    assert float(last["mean_steps"]) == condition["mean_steps"]
    assert last["fingerprint"] == fingerprint(protocol, resolve_conditions(protocol, watched.config()))
    assert last["fingerprint"] == summary["fingerprint"]


@pytest.mark.parametrize(
    "step", [pytest.param(650, marks=pytest.mark.slow), 710, pytest.param(950, marks=pytest.mark.slow)]
)
def test_a_run_that_was_stopped_writes_the_same_rows(
    case: str, watched: RunDirectory, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: int
) -> None:
    run = frozen(tmp_path, "stopped", case, [WATCHED, "train.checkpoint.steps=200"])
    ordinary, armed = Follower._on_step, [True]

    def die_once(self: Follower) -> bool:
        if armed and self.num_timesteps >= step:
            armed.clear()
            raise KeyboardInterrupt
        return ordinary(self)

    monkeypatch.setattr(Follower, "_on_step", die_once)
    with pytest.raises(KeyboardInterrupt):
        execute(run)
    execute(run)
    assert without_wall_time(run) == without_wall_time(watched)
    assert bits(run.path) == bits(watched.path)
