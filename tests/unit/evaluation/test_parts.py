"""A test that is interrupted keeps its slow conditions, and goes on with the others to the same bytes."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from auvbench.config import schema
from auvbench.evaluation import parts
from auvbench.evaluation.evaluate import Report, evaluate, in_process
from auvbench.evaluation.protocol import ResolvedCondition
from auvbench.evaluation.rollout import Rollout
from auvbench.runs.directory import RunDirectory
from auvbench.runs.plan import load_config
from tests import configs
from tests.unit.runs.test_damage import frozen

FILES = ("episodes.csv", "trajectories.npz")


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> RunDirectory:
    monkeypatch.setattr(parts, "SLOW", 0.0)
    return frozen(tmp_path, "algo=random", "task.max_steps=20")


PROTOCOL = replace(
    configs.protocol("protocol=robustness", "protocol.episodes=3", "protocol.trajectories=1"),
    conditions=configs.protocol("protocol=robustness").conditions[:3],
)


class Rolled:
    """Rolls out as a test does, and writes down which conditions; `fatal` is interrupted."""

    def __init__(self, run: RunDirectory, fatal: int = -1) -> None:
        self.conditions: list[str] = []
        self.fatal = fatal
        self._roll = in_process(load_config(run))

    def __call__(
        self, run: RunDirectory, protocol: schema.Protocol, condition: ResolvedCondition, report: Report
    ) -> Rollout:
        if len(self.conditions) == self.fatal:
            raise KeyboardInterrupt
        self.conditions.append(condition.name)
        return self._roll(run, protocol, condition, report)


def contents(run: RunDirectory) -> dict[str, bytes]:
    return {name: (run.evaluation("robustness") / name).read_bytes() for name in FILES}


def interrupted(run: RunDirectory) -> Path:
    """Test until the third condition; return the folder of what is kept."""
    with pytest.raises(KeyboardInterrupt):
        evaluate(run, PROTOCOL, roll=Rolled(run, fatal=2), unless_done=True)
    kept = run.evaluation("robustness").with_name(".robustness") / "parts"
    assert sorted(path.name for path in kept.iterdir()) == ["0", "1"]
    return kept


@pytest.mark.slow
def test_an_interrupted_test_computes_no_condition_twice(run: RunDirectory) -> None:
    names = [condition.name for condition in PROTOCOL.conditions]
    whole = Rolled(run)
    summary = evaluate(run, PROTOCOL, roll=whole)
    assert whole.conditions == names
    straight = contents(run)
    shutil.rmtree(run.evaluation("robustness"))

    kept = interrupted(run)
    told: list[tuple[str, int]] = []
    rest = Rolled(run)
    again = evaluate(
        run, PROTOCOL, lambda name, count: told.append((name, count)), roll=rest, unless_done=True
    )
    assert rest.conditions == names[2:]
    assert told[:4] == [(names[0], 0), (names[0], 3), (names[1], 0), (names[1], 3)]
    assert contents(run) == straight
    assert summary is not None
    assert again is not None
    assert again["conditions"] == summary["conditions"]
    assert not kept.exists()


@pytest.mark.slow
def test_what_is_damaged_or_of_another_test_is_computed_again(run: RunDirectory) -> None:
    kept = interrupted(run)
    rows = kept / "0" / "rows.csv"
    rows.write_bytes(rows.read_bytes().replace(b"0", b"1", 1))
    rest = Rolled(run)
    # The second condition is of a test with another seed now.
    evaluate(run, replace(PROTOCOL, seed=PROTOCOL.seed + 1), roll=rest, unless_done=True)
    assert rest.conditions == [condition.name for condition in PROTOCOL.conditions]

    interrupted_again = interrupted(run)
    rows = interrupted_again / "0" / "rows.csv"
    rows.write_bytes(rows.read_bytes().replace(b"0", b"1", 1))
    rest = Rolled(run)
    evaluate(run, PROTOCOL, roll=rest, unless_done=True)
    assert rest.conditions == [PROTOCOL.conditions[0].name, PROTOCOL.conditions[2].name]


@pytest.mark.slow
def test_a_test_that_is_repeated_on_purpose_uses_nothing_that_was_kept(run: RunDirectory) -> None:
    interrupted(run)
    rest = Rolled(run)
    evaluate(run, PROTOCOL, roll=rest)
    assert rest.conditions == [condition.name for condition in PROTOCOL.conditions]
