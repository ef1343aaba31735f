"""Fixtures for all tests: folders that one process makes and all processes of the session read."""

from __future__ import annotations

import os
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from multiprocessing import forkserver
from pathlib import Path
from typing import TYPE_CHECKING, Any

import psutil
import pytest
from filelock import FileLock
from hypothesis import HealthCheck, settings

if TYPE_CHECKING:
    from auvbench.runs.directory import RunDirectory

# How long an example takes depends on what else the machine does.
settings.register_profile("any machine", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any machine")

FILES = 60
"""files whose times are printed"""

Once = Callable[[str, Callable[[Path], object]], Path]
Trained = Callable[[str], "RunDirectory"]


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Print the seconds of the slowest files, where the slowest tests are printed too."""
    if not terminalreporter.config.getoption("durations"):
        return
    reports = [report for found in terminalreporter.stats.values() for report in found]
    seconds: Counter[str] = Counter()
    for report in reports:
        if isinstance(report, pytest.TestReport):
            seconds[report.nodeid.partition("::")[0]] += report.duration
    terminalreporter.section(f"seconds of the slowest {FILES} files, {seconds.total():.0f} in total")
    for file, duration in seconds.most_common(FILES):
        terminalreporter.write_line(f"{duration:7.1f} {file}")


@pytest.hookimpl(trylast=True)  # after the choice of -m
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Let each process begin with its share of the long tests, so that none is left when the others have ended."""
    processes = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
    long = [item for item in items if item.get_closest_marker("long")]
    rest = [item for item in items if not item.get_closest_marker("long")]
    # xdist cuts the list into as many equal pieces.
    cuts = [len(rest) * part // processes for part in range(processes + 1)]
    items[:] = [
        item
        for part in range(processes)
        for item in (*long[part::processes], *rest[cuts[part] : cuts[part + 1]])
    ]


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Leave out the long tests that a slow machine has not begun in time."""
    if item.get_closest_marker("long") and time.time() > float(os.environ.get("AUVBENCH_LONG_UNTIL", "inf")):
        pytest.skip("left out on a slow machine: `make test-long` runs it, before a release")


@pytest.fixture(scope="session", autouse=True)
def state_home(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """One state directory for all processes of the session: its key signs the runs that they share. Trackers reach no server."""
    root = tmp_path_factory.getbasetemp()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(root.parent if "PYTEST_XDIST_WORKER" in os.environ else root))
        patch.setenv("WANDB_MODE", "offline")
        patch.setenv("MLFLOW_DISABLE_TELEMETRY", "true")
        yield


@pytest.fixture(scope="session", autouse=True)
def one_fork_server(state_home: None) -> Iterator[dict[str, Any]]:
    """Keep the fork server between the commands of this process: each would import torch anew, 3 s of processor time.

    A command that ends kills its workers one by one, where outside of tests they die with their server. A command with
    another environment or import path gets another server; the usual one is put aside meanwhile.
    """
    from auvbench.runs import pool

    server: Any = forkserver._forkserver
    modules: set[str] = set()
    aside: dict[str, Any] = {}

    def surroundings() -> list[object]:
        return [{k: v for k, v in os.environ.items() if k != "PYTEST_CURRENT_TEST"}, list(sys.path)]

    usual = surroundings()
    ground = [*usual]

    def running() -> psutil.Process | None:
        with suppress(psutil.NoSuchProcess):
            process = psutil.Process(server._forkserver_pid) if server._forkserver_pid else None
            return None if process is None or process.status() == psutil.STATUS_ZOMBIE else process
        return None

    def start_server(preload: Sequence[str]) -> None:
        here = surroundings()
        if here != ground:
            if ground == usual and running() is not None:
                aside.update(vars(server))
                vars(server).update(vars(forkserver.ForkServer()), _lock=server._lock)
            else:
                stop()
            if here == usual:
                vars(server).update(aside)
                aside.clear()
            ground[:] = here
        if running() is None or not modules.issuperset(preload):
            from auvbench.evaluation.parallel import PRELOAD
            from auvbench.scheduling.local import LEARNERS

            # All at once, since a server for one more module would import torch again.
            modules.update(preload, PRELOAD, LEARNERS)
            stop()  # `start` calls the function that keeps it
            start(sorted(modules))

    def stop_server() -> None:
        if (process := running()) is not None:
            for worker in process.children():
                with suppress(psutil.NoSuchProcess):
                    worker.kill()

    start, stop = pool.start_server, pool.stop_server
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pool, "start_server", start_server)
        patch.setattr(pool, "stop_server", stop_server)
        yield {"start_server": start, "stop_server": stop}
    stop()
    vars(server).update(aside)
    stop()


@pytest.fixture
def own_fork_servers(one_fork_server: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """Give each command a fork server of its own, as outside of tests."""
    for name, function in one_fork_server.items():
        monkeypatch.setattr(f"auvbench.runs.pool.{name}", function)


@pytest.fixture(scope="session")
def once(tmp_path_factory: pytest.TempPathFactory) -> Once:
    """Return `once(name, make)`: the folder that `make` fills in the first process that asks for the name.

    Tests read it; a test that writes copies it first.
    """
    root = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        root = root.parent  # of all workers of this session

    def folder(name: str, make: Callable[[Path], object]) -> Path:
        made = root / "once" / name
        made.parent.mkdir(exist_ok=True)
        done = made.with_suffix(".done")
        with FileLock(made.with_suffix(".lock")):
            if not done.exists():
                made.mkdir()
                make(made)
                done.touch()
        return made

    return folder


@pytest.fixture(scope="session")
def trained(once: Once) -> Trained:
    """Return `trained(case)`: the complete run of a case of `tests.soak.campaign`; tests read it only."""
    from auvbench.runs.directory import RunDirectory

    def make(folder: Path, case: str) -> None:
        from auvbench.training.execute import execute
        from tests.soak.campaign import frozen

        execute(frozen(folder, "trained", case, []))

    def run(case: str) -> RunDirectory:
        (path,) = (once(case, lambda folder: make(folder, case)) / "trained").glob("*/")
        return RunDirectory(path)

    return run
