"""One slow run on all cores: the same rows for any number of workers, and the progress."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from auvbench import cli
from auvbench.agents.classical import pid, random
from auvbench.agents.classical.mpc import MPCController
from auvbench.commands import progress
from auvbench.evaluation import parallel
from auvbench.evaluation.rollout import Rollout
from auvbench.runs.directory import RunDirectory
from auvbench.runs.pool import Pool
from tests import configs
from tests.unit.runs.test_damage import frozen


def protocol(episodes: int, **changes: Any) -> Any:
    found = configs.protocol(f"protocol.episodes={episodes}")
    for key, value in changes.items():
        setattr(found, key, value)
    return found


def rows(run: RunDirectory) -> tuple[bytes, bytes]:
    folder = run.evaluation("test")
    return (folder / "episodes.csv").read_bytes(), (folder / "trajectories.npz").read_bytes()


def summary(run: RunDirectory) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((run.evaluation("test") / "summary.json").read_text())
    return found


@pytest.mark.slow
def test_rows_do_not_depend_on_the_number_of_workers(tmp_path: Path) -> None:
    pytest.importorskip("casadi")
    found = []
    for workers in (1, 3):
        run = frozen(tmp_path / str(workers), "algo=mpc", "algo.horizon=2.0", "task.max_steps=60")
        told: list[tuple[str, int]] = []
        with Pool(workers, parallel.PRELOAD) as pool:
            (result,) = parallel.evaluate_all(
                [run],
                protocol(4, trajectories=2),
                pool,
                report=lambda _, name, ended, told=told: told.append((name, ended)),
            )
        assert result.error == ""
        assert told[0] == ("nominal", 0)
        assert sum(ended for _, ended in told) == 4
        found.append((rows(run), summary(run)["conditions"]))
    assert found[0][0] == found[1][0]
    counts = [conditions[0].pop("notes") for _, conditions in found]
    assert found[0][1] == found[1][1]
    # How many came late is the machine's affair.
    assert all(count["failed_solves"] == 0 for count in counts)
    assert len({count["solves"] for count in counts}) == 1
    steps = sum(int(line.split(",")[5]) for line in found[0][0][0].decode().splitlines()[1:])
    assert counts[0]["solves"] == steps


@pytest.mark.slow
def test_one_pool_tests_whole_runs_and_then_episodes(tmp_path: Path) -> None:
    pytest.importorskip("casadi")
    for algo in ("pid", "random", "mpc"):
        frozen(tmp_path, f"algo={algo}")
    assert cli.main(["evaluate", str(tmp_path), "protocol.episodes=2", "--workers", "2"]) == 0
    assert len(list(tmp_path.glob("*/*/evaluations/test/summary.json"))) == 3


@pytest.mark.slow
def test_workers_receive_disturbances_that_few_configurations_have(tmp_path: Path) -> None:
    pytest.importorskip("casadi")
    for algo in ("pid", "random", "mpc"):
        frozen(tmp_path, f"algo={algo}", "disturbance=tether")
    words = ["evaluate", str(tmp_path), "protocol=own", "protocol.episodes=2", "--workers"]
    assert cli.main([*words, "2"]) == 0
    found = [path.read_bytes() for path in sorted(tmp_path.glob("*/*/evaluations/own/episodes.csv"))]
    assert cli.main([*words, "1", "--force"]) == 0
    alone = [path.read_bytes() for path in sorted(tmp_path.glob("*/*/evaluations/own/episodes.csv"))]
    assert len(found) == 3
    assert found == alone


def test_only_agents_that_say_so_are_shared(tmp_path: Path) -> None:
    assert MPCController.row_by_row
    assert parallel._row_by_row(frozen(tmp_path / "mpc", "algo=mpc"))
    for algo in ("pid", "random", "ppo"):
        assert not parallel._row_by_row(frozen(tmp_path / algo, f"algo={algo}"))
    assert not hasattr(pid.PIDController, "row_by_row")


@pytest.mark.slow
def test_an_episode_that_fails_is_one_line_and_the_next_run_is_tested(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Fork servers import afresh, so the failure is made of a file: a sheet that no longer fits its run's id."""
    monkeypatch.setattr(random.RandomAgent, "row_by_row", True, raising=False)
    good, bad = frozen(tmp_path / "good", "algo=random"), frozen(tmp_path / "bad", "algo=random", "seed=1")
    config = bad.config_path.read_text()
    bad.config_path.write_text(config.replace("seed: 1", "seed: 2"))
    with Pool(2, parallel.PRELOAD) as pool:
        results = {r.run.id: r for r in parallel.evaluate_all([bad, good], protocol(3), pool)}
    assert "config.yaml does not belong to this run" in results[bad.id].error
    assert results[good.id].summary is not None


def test_parts_are_joined_in_order() -> None:
    parts = [
        Rollout([{"episode": i}], {i: None}, 0.1, ("a",), {"solves": 3, "late_solves": i})  # type: ignore[dict-item]
        for i in range(3)
    ]
    whole = Rollout.joined(parts)
    assert [record["episode"] for record in whole.records] == [0, 1, 2]
    assert list(whole.trajectories) == [0, 1, 2]
    assert whole.notes == {"solves": 9, "late_solves": 3}


@pytest.mark.slow
def test_a_summary_says_how_long_an_action_takes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = frozen(tmp_path, "algo=pid")
    assert cli.main(["evaluate", str(run.path), "protocol.episodes=4", "--workers", "1"]) == 0
    before = rows(run)
    timed = summary(run)["inference"]
    assert timed["actions"] >= 100
    assert 0.0 < timed["median_ms"] <= timed["p95_ms"] < 1e3
    assert timed["cores"] >= 1
    assert timed["cpu"]
    assert "notes" not in summary(run)["conditions"][0]
    # Another time on another machine is no reason to test again.
    path = run.evaluation("test") / "summary.json"
    from auvbench.runs import integrity

    path.write_text(
        json.dumps(integrity.sealed(summary(run) | {"inference": {"median_ms": 1.0, "cpu": "other"}}))
    )
    capsys.readouterr()
    assert cli.main(["evaluate", str(run.path), "protocol.episodes=4", "--workers", "1"]) == 0
    assert "already tested" in capsys.readouterr().out
    assert rows(run) == before


def test_a_single_run_tells_of_its_episodes_in_a_log(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = iter(np.arange(0.0, 1e4, 3.0))
    monkeypatch.setattr(progress.time, "monotonic", lambda: float(next(clock)))
    run = RunDirectory("mpc-k1-f10-s0-12345678")
    with progress.RunBar(1, "protocol test", 20) as tell:
        for _ in range(20):
            tell.doing(run, "nominal", 1)
        tell.line("done")
    out, err = capsys.readouterr()
    assert out == "done\n"
    lines = err.splitlines()
    assert 2 <= len(lines) < 20
    assert lines[0].startswith("mpc-k1-f10-s0-12345678: nominal, ")
    assert lines[0].endswith("of 20 episodes")


def test_several_runs_are_counted_as_runs(capsys: pytest.CaptureFixture[str]) -> None:
    with progress.RunBar(2, "protocol test", 20) as tell:
        tell.doing(RunDirectory("a"), "nominal", 20)
        tell.line("a is done")
    assert capsys.readouterr() == ("a is done\n", "")
