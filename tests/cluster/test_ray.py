"""The Ray backend on a real Ray, started on this machine."""

from __future__ import annotations

import io
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from rich.console import Console

from auvbench.errors import UserError
from auvbench.integrations.cluster.ray import RayBackend
from auvbench.integrations.cluster.spec import Ray
from auvbench.runs import lock
from auvbench.runs.directory import RunDirectory
from auvbench.scheduling.grid import sweep
from auvbench.scheduling.loop import Outcome, Result
from tests import fake_training
from tests.cluster.slurm_cluster import until

ray = pytest.importorskip("ray")
pytestmark = pytest.mark.cluster
ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module", autouse=True)
def cluster() -> Iterator[None]:
    os.environ["PYTHONPATH"] = str(ROOT)  # workers find the tests
    ray.init(num_cpus=2, log_to_driver=False, include_dashboard=False)
    yield
    ray.shutdown()
    del os.environ["PYTHONPATH"]


def backend() -> RayBackend:
    options = Ray(name="ray", workers=0, address=None, cpus=1.0, memory=0)
    return RayBackend(options, target="tests.fake_training:execute")


def carry_out(runs: list[RunDirectory]) -> tuple[Result, str]:
    text = io.StringIO()
    return sweep(runs, backend(), Console(file=text, width=200)), text.getvalue()


def meanwhile(action: Callable[[], None]) -> threading.Thread:
    thread = threading.Thread(target=action)
    thread.start()
    return thread


def test_a_grid_completes_with_failures_among_it(tmp_path: Path) -> None:
    good = [fake_training.make(tmp_path / f"good{number}") for number in range(3)]
    bad = fake_training.make(tmp_path / "bad", fail_at=20)
    shot = fake_training.make(tmp_path / "shot", kill_at=30, once=True)
    result, text = carry_out([bad, shot, *good])
    assert result.exit_code == 1
    assert result.of(Outcome.FAILED) == {
        bad.path: "the loss is not a number",
        shot.path: "killed by signal 9 (SIGKILL), possibly out of memory",
    }
    assert "running as ray task" in text
    for run in good:
        assert (run.path / "result.txt").read_text() == fake_training.chain(50)
        assert "worker, pid" in (run.path / "train" / "log.txt").read_text()
    result, _ = carry_out([shot, *good])
    assert result.exit_code == 0
    assert (shot.path / "result.txt").read_text() == fake_training.chain(50)


def test_a_killed_process_of_ray_takes_its_worker_with_it_and_no_other(tmp_path: Path) -> None:
    unlucky = fake_training.make(tmp_path / "unlucky", step_s=0.1)
    other = fake_training.make(tmp_path / "other", step_s=0.05)

    def kill() -> None:
        until(lambda: (unlucky.path / "saved.json").exists(), 60)
        holder = lock.living_holder(unlucky.path)
        assert holder is not None
        stat = Path(f"/proc/{holder.pid}/stat").read_text()
        os.kill(int(stat.rpartition(")")[2].split()[1]), signal.SIGKILL)

    thread = meanwhile(kill)
    result, _ = carry_out([unlucky, other])
    thread.join()
    assert set(result.of(Outcome.FAILED)) == {unlucky.path}
    assert set(result.of(Outcome.COMPLETE)) == {other.path}
    assert lock.living_holder(unlucky.path) is None
    assert carry_out([unlucky])[0].exit_code == 0
    assert (unlucky.path / "result.txt").read_text() == fake_training.chain(50)


def test_ctrl_c_reaches_the_workers_which_save(tmp_path: Path) -> None:
    runs = [fake_training.make(tmp_path / f"run{i}", step_s=0.05, total_steps=1000) for i in range(3)]

    def interrupt() -> None:
        until(lambda: sum((run.path / "saved.json").exists() for run in runs) == 2, 60)
        time.sleep(0.2)
        os.kill(os.getpid(), signal.SIGINT)

    thread = meanwhile(interrupt)
    result, text = carry_out(runs)
    thread.join()
    assert result.exit_code == 130, text
    assert sorted(run.manifest()["state"] for run in runs) == ["interrupted", "interrupted", "pending"]
    assert all(lock.living_holder(run.path) is None for run in runs)


def test_an_address_where_no_ray_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ray, "is_initialized", lambda: False)

    def refuse(**_: object) -> None:
        raise ConnectionError("Could not find any running Ray instance.")

    monkeypatch.setattr(ray, "init", refuse)
    with pytest.raises(UserError, match="Could not find any running Ray"):
        RayBackend(Ray(name="ray", workers=0, address="auto", cpus=1.0, memory=0))
