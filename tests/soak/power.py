"""A power cut without a plug: what would be left of a folder if the power went now.

POSIX promises that the content of a file is on the disk after it was fsynced, and a name after its directory was. What
was neither may be there or not. `Disk` watches the calls of fsync in this process and so knows at any moment what is
promised; `image` makes a copy of the folder that keeps the promises and nothing else, or that loses in other ways that
file systems have been seen to lose. It needs no privileges and no file system of its own.

    with Disk(folder) as disk:
        disk.before = lambda operation: ...      # called before each operation that makes a difference
        work()
        disk.image(target, "names")
"""

from __future__ import annotations

import os
import random
import resource
import stat
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any

LOSSES = ("everything", "contents", "zeros", "some")
"""What of the unsynced is lost: everything; the contents, though all names are there (ext4 after a rename without fsync);
the contents, though the sizes are there (XFS); or some of it, drawn by chance."""

_OPERATIONS = ("fsync", "rename", "replace", "link", "mkdir", "unlink", "rmdir")

Inode = tuple[int, int]


class Disk:
    """Knows what of a folder is on the disk.

    Args:
        folder: watched from now on; what is in it counts as being on the disk.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.before: Callable[[str], object] | None = None
        self._contents: dict[Inode, bytes] = {}
        self._names: dict[Inode, dict[str, Inode]] = {}
        self._kept: dict[Inode, int] = {}  # open descriptors: an inode that is held is given to nobody else
        self._ordinary: dict[str, Any] = {}
        self._busy = False

    def __enter__(self) -> Disk:
        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, min(hard, 65536)), hard))
        for path in [self.folder, *self.folder.rglob("*")]:
            if path.is_dir() or path.is_file():
                self._settle(path)
        for name in _OPERATIONS:
            self._ordinary[name] = getattr(os, name)
            setattr(os, name, self._watched(name))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for name, function in self._ordinary.items():
            setattr(os, name, function)
        for descriptor in self._kept.values():
            os.close(descriptor)
        self._kept.clear()

    def _watched(self, name: str) -> Callable[..., Any]:
        ordinary = self._ordinary[name]

        def call(*arguments: Any, **options: Any) -> Any:
            if self._busy:
                return ordinary(*arguments, **options)
            if self.before is not None:
                self._busy = True
                try:
                    self.before(name)
                finally:
                    self._busy = False
            if name != "fsync":
                return ordinary(*arguments, **options)
            path = Path(os.readlink(f"/proc/self/fd/{arguments[0]}"))
            if path == self.folder or self.folder in path.parents:
                self._settle(path, arguments[0])
            return None

        return call

    def _settle(self, path: Path, descriptor: int | None = None) -> None:
        """Takes over the content of a file, or the names in a directory, as being on the disk."""
        # By its number, for it may have no name any more; anew, for it may have been opened for writing alone.
        own = os.open(path if descriptor is None else f"/proc/self/fd/{descriptor}", os.O_RDONLY)
        inode = _inode(os.fstat(own))
        if stat.S_ISDIR(os.fstat(own).st_mode):
            self._names[inode] = self._listed(path)
        else:
            self._contents[inode] = _content(own)
        self._keep(inode, own)

    def _listed(self, path: Path) -> dict[str, Inode]:
        found = {}
        for entry in os.scandir(path):
            descriptor = os.open(entry.path, os.O_RDONLY)
            found[entry.name] = inode = _inode(os.fstat(descriptor))
            self._keep(inode, descriptor)
        return found

    def _keep(self, inode: Inode, descriptor: int) -> None:
        if inode in self._kept:
            os.close(descriptor)
        else:
            self._kept[inode] = descriptor

    def image(self, target: Path, loss: str, rng: random.Random | None = None) -> Path:
        """Copies what is left after a cut in this moment into a new folder; returns it.

        Args:
            target: where; it must not exist.
            loss: one of `LOSSES`.
            rng: draws what is lost where `loss` is "some".
        """
        was, self._busy = self._busy, True
        try:
            self._copy(_inode(self.folder.stat()), self.folder, target, loss, rng or random.Random(0))
        finally:
            self._busy = was
        return target

    def _copy(self, inode: Inode, path: Path | None, target: Path, loss: str, rng: random.Random) -> None:
        """A directory or file; `path` is where it lies now, None where it has gone."""
        descriptor = self._kept.get(inode)
        if descriptor is None:  # made since, and in no directory that was synced
            assert path is not None
            descriptor = os.open(path, os.O_RDONLY)
            self._kept[inode] = descriptor
        if stat.S_ISDIR(os.fstat(descriptor).st_mode):
            os.makedirs(target)
            for name, child in self._left(inode, path, loss, rng).items():
                there = path / name if path is not None and _same(path / name, child) else None
                self._copy(child, there, target / name, loss, rng)
            return
        now, synced = _content(descriptor), self._contents.get(inode, b"")
        what = rng.choice(["everything", "contents", "zeros", "nothing"]) if loss == "some" else loss
        if what == "nothing":
            synced = now
        elif what == "zeros":
            synced = synced[: len(now)].ljust(len(now), b"\0")
        target.write_bytes(synced)

    def _left(self, inode: Inode, path: Path | None, loss: str, rng: random.Random) -> dict[str, Inode]:
        promised = self._names.get(inode, {})
        if path is None or loss == "everything":
            return promised
        now = self._listed(path)
        if loss != "some":
            return now
        # Each name that was made, or taken away, since its directory was synced made it to the disk, or did not.
        either = {name: rng.choice([promised, now]) for name in sorted({*promised, *now})}
        return {name: names[name] for name, names in either.items() if name in names}


def _inode(status: os.stat_result) -> Inode:
    return status.st_dev, status.st_ino


def _same(path: Path, inode: Inode) -> bool:
    try:
        return _inode(path.stat()) == inode
    except FileNotFoundError:
        return False


def _content(descriptor: int) -> bytes:
    size = os.fstat(descriptor).st_size
    data = b""
    while len(data) < size and (block := os.pread(descriptor, size - len(data), len(data))):
        data += block
    return data
