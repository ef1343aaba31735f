"""A study whose trials are tasks of a real Ray: PPO, two rungs, several at once."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from auvbench import cli
from auvbench.tuning import outcome
from auvbench.tuning.folder import StudyFolder

ray = pytest.importorskip("ray")
pytestmark = pytest.mark.cluster
NICENESS = "RAY_worker_niceness"
ROOT = Path(__file__).parents[2]
STUDY = [
    "algo=ppo",
    "launcher=ray",
    "launcher.workers=2",
    "algo.n_envs=4",
    "algo.n_steps=choice(16,32)",
    "algo.batch_size=64",
    "algo.net_arch=[8]",
    "tune.trials=4",
    "tune.startup=2",
    "tune.rungs=[128,384]",
    "tune.reduction=2",
    "tune.fresh_seeds=[9]",
    "protocol.episodes=2",
]


@pytest.fixture(scope="module", autouse=True)
def cluster() -> Iterator[None]:
    os.environ["PYTHONPATH"] = str(ROOT)
    os.environ[NICENESS] = "0"  # Ray's own 15 starves on a busy machine
    ray.init(num_cpus=2, log_to_driver=False, include_dashboard=False)
    yield
    ray.shutdown()
    del os.environ["PYTHONPATH"], os.environ[NICENESS]


def test_a_study_over_ray_goes_on_where_it_was(tmp_path: Path) -> None:
    assert cli.main(["tune", *STUDY, f"output={tmp_path}"]) == 0
    study = StudyFolder(tmp_path / "tune" / "ppo")
    found = outcome.read(study)
    assert len(found.trials) == 4
    assert {t.state for t in found.trials} <= {"done", "pruned"}
    assert any(t.state == "done" for t in found.trials)
    assert found.fresh is not None
    before = {path: path.stat().st_mtime_ns for path in study.runs.glob("*/model/policy.pt")}
    # Trained in tasks, not in this process: each run has the log of a worker.
    assert all((path.parents[1] / "train" / "log.txt").is_file() for path in before)
    assert cli.main(["tune", *STUDY, f"output={tmp_path}", "tune.trials=5"]) == 0
    assert len(outcome.read(study).trials) == 5
    assert all(path.stat().st_mtime_ns == time for path, time in before.items())
