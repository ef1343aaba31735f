"""Fixtures for all tests: folders that one process makes and all processes of the session read."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from filelock import FileLock

if TYPE_CHECKING:
    from auvbench.runs.directory import RunDirectory

Once = Callable[[str, Callable[[Path], object]], Path]
Trained = Callable[[str], "RunDirectory"]


@pytest.fixture(scope="session", autouse=True)
def state(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """One state directory for all processes of the session: its key signs the runs that they share."""
    root = tmp_path_factory.getbasetemp()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(root.parent if "PYTEST_XDIST_WORKER" in os.environ else root))
        yield


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
        (path,) = (once(case, lambda folder: make(folder, case)) / "trained").iterdir()
        return RunDirectory(path)

    return run
