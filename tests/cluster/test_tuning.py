"""Studies whose trials are tasks of a real Ray and jobs of a real SLURM: PPO, two rungs, two runs at once."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from auvbench import cli
from auvbench.runs.directory import RunDirectory
from auvbench.tuning import outcome
from auvbench.tuning.folder import StudyFolder
from tests.cluster import slurm_cluster
from tests.cluster.slurm_cluster import ask, until

pytestmark = pytest.mark.cluster
NICENESS = "RAY_worker_niceness"
ROOT = Path(__file__).parents[2]
STUDY = [
    "algo=ppo",
    "launcher.workers=2",
    "algo.n_envs=4",
    "algo.n_steps=choice(16,32)",
    "algo.batch_size=64",
    "algo.net_arch=[8]",
    "tune.trials=4",
    "tune.startup=2",
    "tune.rungs=[128,384]",
    "tune.reduction=2",
    "protocol.episodes=2",
]
RAY = ["launcher=ray", "tune.fresh_seeds=[9]"]
SLURM = ["launcher=slurm", "launcher.mem=1500M", "launcher.poll=1", "tune.fresh_seeds=[]"]


@pytest.fixture(autouse=True)
def workers_find_this_code(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", str(ROOT))


@pytest.fixture
def ray(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    module = pytest.importorskip("ray")
    monkeypatch.setenv(NICENESS, "0")  # Ray's own 15 starves on a busy machine
    module.init(num_cpus=2, log_to_driver=False, include_dashboard=False)
    yield
    module.shutdown()


@pytest.fixture
def slurm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with slurm_cluster.running(tmp_path_factory.mktemp("slurm")):
        yield


def models(study: StudyFolder) -> dict[Path, int]:
    """When each run's policy was written."""
    return {path: path.stat().st_mtime_ns for path in study.runs.glob("*/model/policy.pt")}


@pytest.mark.usefixtures("ray")
def test_a_study_over_ray_goes_on_where_it_was(tmp_path: Path) -> None:
    assert cli.main(["tune", *STUDY, *RAY, f"output={tmp_path}"]) == 0
    study = StudyFolder(tmp_path / "tune" / "ppo")
    found = outcome.read(study)
    assert len(found.trials) == 4
    assert {outcome.state_of(t) for t in found.trials} <= {"done", "pruned"}
    assert found.gains
    before = models(study)
    # Trained in tasks, not in this process: each run has the log of a worker.
    assert all((path.parents[1] / "train" / "log.txt").is_file() for path in before)
    assert cli.main(["tune", *STUDY, *RAY, f"output={tmp_path}", "tune.trials=5"]) == 0
    assert len(outcome.read(study).trials) == 5
    assert all(path.stat().st_mtime_ns == time for path, time in before.items())


def job_of(run: Path) -> str:
    return str(json.loads((run / "slurm.json").read_text())["job"])


@pytest.mark.usefixtures("slurm")
def test_a_study_over_slurm_finds_its_jobs_again_after_a_kill(tmp_path: Path) -> None:
    words = ["tune", *STUDY, *SLURM, f"output={tmp_path}"]
    study = StudyFolder(tmp_path / "tune" / "ppo")
    with open(tmp_path / "log.txt", "wb") as log:
        controller = subprocess.Popen([sys.executable, "-m", "auvbench", *words], stdout=log, stderr=log)
        until(lambda: controller.poll() is not None or len(list(study.runs.glob("*/slurm.json"))) == 2, 120)
    controller.send_signal(signal.SIGKILL)
    assert controller.wait() == -signal.SIGKILL, (tmp_path / "log.txt").read_text()
    jobs = {path.parent: job_of(path.parent) for path in study.runs.glob("*/slurm.json")}
    assert cli.main(words) == 0
    assert {run: job_of(run) for run in jobs} == jobs  # nothing was submitted twice
    assert all(RunDirectory(run).manifest()["attempts"] == 1 for run in jobs)
    found = outcome.read(study)
    assert len(found.trials) == 4
    assert {outcome.state_of(t) for t in found.trials} <= {"done", "pruned"}
    assert all((path.parents[1] / "slurm.json").is_file() for path in models(study))
    assert ask("squeue", "-h") == ""
    before = models(study)
    assert cli.main(words) == 0
    assert models(study) == before
