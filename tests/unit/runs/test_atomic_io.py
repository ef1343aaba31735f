"""Files that are there whole or not at all."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from auvbench.runs import atomic_io


def test_replaces_what_is_there(tmp_path: Path) -> None:
    file = tmp_path / "new" / "file.txt"
    for data in (b"one", b"two"):
        atomic_io.write_atomic(file, data)
        assert file.read_bytes() == data
    assert list(file.parent.iterdir()) == [file]


def test_creates_only_what_is_not_there(tmp_path: Path) -> None:
    file = tmp_path / "file.txt"
    assert atomic_io.create_atomic(file, b"mine")
    assert not atomic_io.create_atomic(file, b"another's")
    assert file.read_text() == "mine"
    assert list(tmp_path.iterdir()) == [file]


def test_creates_without_hard_links_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError("no links here")

    monkeypatch.setattr(os, "link", refuse)
    assert atomic_io.create_atomic(tmp_path / "file.txt", b"text")
    assert (tmp_path / "file.txt").read_text() == "text"
    assert len(list(tmp_path.iterdir())) == 1


def test_a_model_is_written_without_the_drafts_of_a_killed_attempt(tmp_path: Path) -> None:
    from auvbench.runs.directory import RunDirectory

    run = RunDirectory(tmp_path)
    run.model.mkdir()
    (run.model / ".policy.pt.abc").write_bytes(b"half")
    table = run.write_model({"policy.pt": b"whole"})
    assert [path.name for path in run.model.iterdir()] == ["policy.pt"]
    assert table["model/policy.pt"]["bytes"] == 5


def test_a_folder_is_replaced_whole_and_stays_where_that_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "new" / "folder"
    for names in (("one", "two"), ("three",)):
        atomic_io.replace_folder(folder, {name: name.encode() for name in names})
        assert {path.name: path.read_text() for path in folder.iterdir()} == {name: name for name in names}
    rename = Path.rename

    def fails(path: Path, target: Path) -> Path:
        if path.name == ".folder.staged":
            raise OSError(errno.EIO, "no")
        return rename(path, target)

    monkeypatch.setattr(Path, "rename", fails)
    with pytest.raises(OSError, match="no"):
        atomic_io.replace_folder(folder, {"four": b"four"})
    assert [path.name for path in folder.iterdir()] == ["three"]
    assert list(folder.parent.iterdir()) == [folder]


def test_a_replacement_that_was_killed_between_its_renames_loses_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "folder"
    atomic_io.replace_folder(folder, {"old": b"old"})
    folder.rename(tmp_path / ".folder.former")  # what a kill in this moment leaves

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "full")

    monkeypatch.setattr(atomic_io, "write_durable", full)
    with pytest.raises(OSError, match="full"):
        atomic_io.replace_folder(folder, {"new": b"new"})
    assert [path.name for path in tmp_path.glob("**/*")] == ["folder", "old"]
