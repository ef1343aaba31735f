from __future__ import annotations

import errno
import io
import json
import os
import subprocess
import time
import warnings
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from auvbench.agents.base import Components
from auvbench.errors import RunError, TrainingError
from auvbench.training.checkpoint.logs import GrowingLog
from auvbench.training.checkpoint.store import CheckpointStore, CheckpointWarning
from tests.soak.killing import forked, kill_at_operation


def components(step: int) -> Components:
    return Components(
        tensors={"policy": {"w": torch.full((3,), float(step)), "nested": {"lr": 0.1, "betas": (0.9, 0.99)}}},
        arrays={"learner": {"x": np.arange(step % 7), "empty": np.zeros((0, 2)), "scalar": np.asarray(2.5)}},
        values={"counters": {"step": step, "big": 2**100}},
    )


def assert_is(found: Components, step: int) -> None:
    assert torch.equal(found.tensors["policy"]["w"], torch.full((3,), float(step)))
    assert found.tensors["policy"]["nested"] == {"lr": 0.1, "betas": (0.9, 0.99)}
    np.testing.assert_array_equal(found.arrays["learner"]["x"], np.arange(step % 7))
    assert found.arrays["learner"]["scalar"].shape == ()
    assert found.values["counters"] == {"step": step, "big": 2**100}


def test_what_is_written_is_read_back_and_the_last_two_stay(tmp_path: Path) -> None:
    store = CheckpointStore(tmp_path)
    for step in (100, 20, 3000):
        store.save(step, components(step))
    assert store.steps() == [3000, 100]
    found = CheckpointStore(tmp_path).latest_valid()
    assert found is not None
    assert found.step == 3000
    assert_is(found.components, 3000)


def test_no_checkpoint_is_none(tmp_path: Path) -> None:
    assert CheckpointStore(tmp_path / "nowhere").latest_valid() is None


def test_objects_are_refused_because_only_a_pickle_could_hold_them(tmp_path: Path) -> None:
    parts = Components(arrays={"learner": {"bad": np.array([{}], dtype=object)}})
    with pytest.raises(TypeError, match=r"learner\.bad"):
        CheckpointStore(tmp_path).save(1, parts)
    assert not (tmp_path / "checkpoints").exists()


def files_of(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize("name", ["policy.pt", "learner.npz", "counters.json", "manifest.json"])
@pytest.mark.parametrize("damage", ["flip", "truncate", "empty", "remove", "append"])
def test_a_damaged_newest_checkpoint_falls_back_with_a_warning(
    tmp_path: Path, name: str, damage: str
) -> None:
    store = CheckpointStore(tmp_path)
    store.save(100, components(100))
    folder = store.save(200, components(200))
    path = folder / name
    data = bytearray(path.read_bytes())
    if damage == "flip":
        data[len(data) // 2] ^= 0x04
    elif damage == "truncate":
        data = data[: len(data) // 2]
    elif damage == "empty":
        data = bytearray()
    else:
        data += b" "
    path.unlink() if damage == "remove" else path.write_bytes(data)
    if (name, damage) == ("manifest.json", "append"):
        assert store.latest_valid().step == 200  # type: ignore[union-attr]  # white space changes nothing
        return
    with pytest.warns(CheckpointWarning, match=rf"step 200.*damaged \(.*{name}.*using the one of step 100"):
        found = store.latest_valid()
    assert found is not None
    assert found.step == 100
    assert_is(found.components, 100)
    assert store.steps() == [100]
    store.save(200, components(200))  # the run gets there again
    assert store.latest_valid().step == 200  # type: ignore[union-attr]


def test_every_flipped_bit_of_a_manifest_is_noticed(tmp_path: Path) -> None:
    store = CheckpointStore(tmp_path)
    path = store.save(7, components(7)) / "manifest.json"
    good = path.read_bytes()
    rng = np.random.default_rng(0)
    for at in rng.choice(len(good), 60, replace=False):
        data = bytearray(good)
        data[at] ^= 1 << int(rng.integers(8))
        path.write_bytes(data)
        try:
            same = json.loads(bytes(data)) == json.loads(good)
        except ValueError:
            same = False
        if not same:
            with pytest.raises(ValueError, match=r"manifest\.json"):
                store.read(7)


def test_all_damaged_starts_over_and_says_so(tmp_path: Path) -> None:
    store = CheckpointStore(tmp_path)
    for step in (1, 2):
        (store.save(step, components(step)) / "policy.pt").write_bytes(b"")
    with pytest.warns(CheckpointWarning, match="starting at step 0"):
        assert store.latest_valid() is None
    assert store.steps() == []


def test_a_kill_at_any_file_operation_leaves_a_whole_checkpoint(tmp_path: Path) -> None:
    """The saving of a third checkpoint, which also deletes the first, is killed before its 1st, 2nd, ... operation."""
    killed = 0
    for count in range(1, 200):
        run = tmp_path / str(count)
        store = CheckpointStore(run)
        store.save(1, components(1))
        store.save(2, components(2))

        def work(run: Path = run, count: int = count) -> None:
            kill_at_operation(run, count)
            CheckpointStore(run).save(3, components(3))

        status = forked(work)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            found = CheckpointStore(run).latest_valid()
        assert found is not None
        assert found.step in (2, 3)
        assert_is(found.components, found.step)
        assert all(name.isdigit() for name in files_of(run / "checkpoints"))
        if status == 0:
            break
        killed += 1
    assert found.step == 3
    assert killed > 10


@pytest.fixture
def small_disk(tmp_path: Path):
    """A file system of 1 MB."""
    mount = tmp_path / "disk"
    mount.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(mount)]
    try:
        done = subprocess.run(command, capture_output=True, check=False).returncode == 0
    except FileNotFoundError:
        done = False
    if not done:
        pytest.skip("mounting a small tmpfs needs root")
    yield mount
    subprocess.run(["umount", str(mount)], check=True)


def test_a_full_disk_is_named_and_the_last_checkpoint_stays(small_disk: Path) -> None:
    store = CheckpointStore(small_disk)
    store.save(10, components(10))
    big = components(20)
    big.arrays["learner"]["much"] = np.ones(300_000)
    with pytest.raises(TrainingError, match=r"step 20 \(the one of step 10 is intact\).*disk is full"):
        store.save(20, big)
    assert files_of(store.folder) == ["10"]
    assert_is(store.latest_valid().components, 10)  # type: ignore[union-attr]


def test_a_read_only_disk_is_named(small_disk: Path) -> None:
    store = CheckpointStore(small_disk)
    store.save(10, components(10))
    subprocess.run(["mount", "-o", "remount,ro", str(small_disk)], check=True)
    with pytest.raises(TrainingError, match=r"step 20.*read-only"):
        store.save(20, components(20))
    assert_is(store.latest_valid().components, 10)  # type: ignore[union-attr]


FALLIBLE = ("fsync", "rename", "mkdir", "replace", "unlink", "rmdir")


def failing(monkeypatch: pytest.MonkeyPatch, first: int, last: int) -> list[int]:
    """A disk whose operations from the `first` to the `last` fail; counts them."""
    count = [0]

    def faulty(ordinary: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any, **options: Any) -> Any:
            count[0] += 1
            if first <= count[0] <= last:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            return ordinary(*arguments, **options)

        return call

    for name in FALLIBLE:
        monkeypatch.setattr(os, name, faulty(getattr(os, name)))
    monkeypatch.setattr(io, "open", faulty(io.open))
    return count


@pytest.mark.parametrize("length", [1, 3])
def test_a_checkpoint_that_could_not_be_written_leaves_nothing(tmp_path: Path, length: int) -> None:
    """The disk fails at each operation in turn, also at those that clean up after the failure."""
    for at in range(1, 100):
        store = CheckpointStore(tmp_path / str(at))
        store.save(1, components(1))
        store.save(2, components(2))
        with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            count = failing(patch, at, at + length - 1)
            with suppress(TrainingError):
                store.save(3, components(3))
        store.prune()  # as the training does when it stops for that, and after each checkpoint
        assert all(name.isdigit() for name in files_of(store.folder)), at
        found = store.latest_valid()
        assert found is not None
        assert found.step in (2, 3)
        if count[0] < at:
            break
    assert at > 15


def test_a_log_is_followed_and_a_foreign_change_is_refused(tmp_path: Path) -> None:
    log = tmp_path / "episodes.csv"
    log.write_text("a\nb\n")
    follower = GrowingLog(log)
    store = CheckpointStore(tmp_path)
    store.save(1, components(1), logs={"episodes.csv": follower.mark()})
    with log.open("a") as file:
        file.write("c\n")
    second = follower.mark()
    assert second == GrowingLog(log).mark()
    assert second.bytes == 6
    store.save(2, components(2), logs={"episodes.csv": second})
    with log.open("a") as file:
        file.write("d, after the checkpoint")
    assert store.latest_valid().logs == {"episodes.csv": second}  # type: ignore[union-attr]
    log.write_text("a\nb\nX\n")
    with pytest.warns(CheckpointWarning, match=r"step 2 .*episodes\.csv"):
        assert store.latest_valid().step == 1  # type: ignore[union-attr]
    log.write_text("edited")
    with pytest.raises(RunError, match=r"episodes\.csv no longer begins"):
        store.latest_valid()
    assert store.steps() == [1]  # nothing is thrown away for a log


def test_nothing_written_needs_unpickling(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import pickle

    store = CheckpointStore(tmp_path)
    folder = store.save(1, components(1))

    def refuse(*args: object, **kwargs: object) -> None:
        raise AssertionError("unpickled")

    monkeypatch.setattr(pickle, "load", refuse)
    monkeypatch.setattr(pickle, "loads", refuse)
    assert store.latest_valid() is not None
    for path in folder.rglob("*"):
        assert path.suffix in {".pt", ".npz", ".json"}


def test_a_tensor_file_with_code_in_it_is_not_executed(tmp_path: Path) -> None:
    class Evil:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return os.mkdir, (str(tmp_path / "executed"),)

    store = CheckpointStore(tmp_path)
    store.save(1, Components(tensors={"policy": {"w": Evil()}}))
    with pytest.raises(Exception, match=r"(?i)weights.only|unsupported"):
        store.read(1)
    assert not (tmp_path / "executed").exists()


def test_the_wall_clock_may_jump_backwards(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = CheckpointStore(tmp_path)
    store.save(1, components(1))
    monkeypatch.setattr(time, "time", lambda: 0.0)
    monkeypatch.setattr(time, "time_ns", lambda: 0)
    os.utime(store.save(2, components(2)), (0, 0))
    assert store.latest_valid().step == 2  # type: ignore[union-attr]
