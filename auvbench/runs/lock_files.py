"""The files of a run's lock: `lock/<generation>` in the run directory, the highest of which counts.

It is either free (its holder released it) or held by the process it names. Whoever wants the lock creates the *next*
generation, with link(2), which is atomic on NFS too: of several contenders one wins, and because the highest
generation is never removed or renamed away, a contender that was slow cannot take what somebody else took in
the meantime. So taking over from a dead holder needs no second lock.
"""

from __future__ import annotations

import json
import os
import shlex
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields
from pathlib import Path

from auvbench.runs import processes

FOLDER = "lock"


@dataclass(frozen=True, slots=True)
class Holder:
    """Who holds, or last held, a run."""

    host: str  # of a damaged lock file, the file
    pid: int
    started: str  # the process's start mark, see processes.start_mark
    machine: str  # the boot and pid namespace in which pid and started mean something
    since: str  # ISO 8601, UTC; for people, never compared
    token: str  # unique for each acquisition
    job: str | None = None  # the cluster's job, for example "slurm:17"
    free: bool = False  # released

    @property
    def here(self) -> bool:
        """Whether its process, if it lives, lives among ours."""
        return self.host == processes.host() and self.machine == processes.machine()

    @property
    def unknown(self) -> bool:
        """Whether the file that should name it is damaged."""
        return not self.token

    def __str__(self) -> str:
        if self.unknown:
            file = shlex.quote(self.host)
            return (
                f"an unknown process (its lock file is damaged; if nobody works on it, rm {file} releases it)"
            )
        job = f", {self.job.replace(':', ' job ')}" if self.job else ""
        return f"{self.host}, pid {self.pid}{job}, since {self.since}"


def file_of(run: Path, generation: int) -> Path:
    """What its holder touches to show that it lives."""
    return run / FOLDER / f"{generation:06d}"


def _temporary(run: Path, token: str) -> Path:
    return run / FOLDER / f".{token}"


def generations(run: Path) -> Iterator[int]:
    """Those whose files are there, in no order."""
    try:
        names = os.listdir(run / FOLDER)
    except (FileNotFoundError, NotADirectoryError):
        return
    yield from (int(name) for name in names if name.isdigit())


def highest(run: Path) -> int:
    """The generation that counts; 0 before the first."""
    return max(generations(run), default=0)


def read(run: Path, generation: int) -> tuple[Holder, float] | None:
    """The holder of a generation and its last touch; None when the file is gone."""
    try:
        # Opening it makes an NFS client ask the server for the attributes instead of its cache.
        with file_of(run, generation).open(encoding="utf-8") as file:
            touched = os.fstat(file.fileno()).st_mtime
            text = file.read()
    except FileNotFoundError:
        return None
    try:
        data = json.loads(text)
        return Holder(**{f.name: data[f.name] for f in fields(Holder)}), touched
    except (ValueError, KeyError, TypeError):
        # Being written without link(2), or damaged: only its touches tell whether somebody is there.
        return Holder(str(file_of(run, generation)), 0, "", "", "", ""), touched


def create(run: Path, generation: int, holder: Holder) -> bool:
    """Creates the generation's file for `holder`; False when somebody else was faster."""
    (run / FOLDER).mkdir(exist_ok=True)
    temporary = _write(_temporary(run, holder.token), json.dumps(asdict(holder)))
    target = file_of(run, generation)
    try:
        try:
            os.link(temporary, target)
        except FileExistsError:
            # An NFS server may have done it although its answer was lost: then our file has two names.
            if temporary.stat().st_nlink != 2:
                return False
        except OSError:  # a file system without hard links
            try:
                with target.open("x", encoding="utf-8") as file:
                    file.write(temporary.read_text(encoding="utf-8"))
            except FileExistsError:
                return False
    finally:
        temporary.unlink(missing_ok=True)
    if highest(run) == generation:
        return True
    target.unlink(missing_ok=True)  # we were so slow that the generation had come and gone
    return False


def release(run: Path, generation: int, holder: Holder) -> None:
    """Writes down that `holder` has left; its generation stays, for the next to count on from."""
    text = json.dumps({**asdict(holder), "free": True})
    _write(_temporary(run, holder.token), text).replace(file_of(run, generation))


def _write(path: Path, text: str) -> Path:
    with path.open("w", encoding="utf-8") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    return path
