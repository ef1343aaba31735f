"""Work that is cut in two comes back whole, in order, and with its errors."""

import gc
import os
from pathlib import Path

import pytest

from auvbench.analysis import processes
from auvbench.analysis.load import load
from tests.synthetic import damage, set_state, write_experiment


@pytest.mark.parametrize("forks", [True, False])
@pytest.mark.parametrize("count", [0, 1, processes.MANY, 3 * processes.MANY + 1])
def test_each_keeps_the_order(forks: bool, count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes, "can_fork", lambda: forks)
    assert processes.each(lambda i: i * i, range(count)) == [i * i for i in range(count)]


def test_a_child_that_dies_or_fails_leaves_its_work_to_the_parent(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes, "can_fork", lambda: True)
    parent = os.getpid()

    def dies() -> str:
        if os.getpid() != parent:
            os._exit(9)
        return "done here"

    def fails() -> str:
        raise ValueError("seen once")

    with processes.beside(dies) as result:
        assert result() == "done here"
    with pytest.raises(ValueError, match="seen once"), processes.beside(fails) as failing:
        failing()


def test_an_error_of_the_child_is_not_printed(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(processes, "can_fork", lambda: True)
    with processes.beside(lambda: 1 // 0) as result, pytest.raises(ZeroDivisionError):
        result()
    assert capfd.readouterr().err == ""


def test_two_processes_read_what_one_reads(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folders = write_experiment(tmp_path / "grid", algorithms=("ppo", "pid"), seeds=range(6), episodes=4)
    set_state(folders[1:2], "running")
    for i, how in ((0, "nan"), (-2, "cut")):
        damage(folders[i] / "evaluations" / "test" / "episodes.csv", how)
    (folders[-3] / "manifest.json").write_text("{}")
    monkeypatch.setattr(processes, "MANY", 2)
    read = {}
    for forks in (True, False):
        monkeypatch.setattr(processes, "can_fork", lambda forks=forks: forks)
        runs, problems = load([tmp_path])
        frames = [run.evaluations["test"].episodes.to_csv() for run in runs if run.evaluations]
        read[forks] = [run.id for run in runs], [run.config for run in runs], frames, problems
    assert read[True] == read[False]
    assert len(read[True][3]) == 4


def test_the_collector_is_as_before(monkeypatch: pytest.MonkeyPatch) -> None:
    assert gc.isenabled()
    with processes.uncollected():
        assert not gc.isenabled()
        with processes.uncollected():
            pass
        assert not gc.isenabled()
    assert gc.isenabled()
