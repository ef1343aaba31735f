"""Carry out runs as jobs of a SLURM cluster.

Each run is a batch script in the run's folder, submitted with sbatch. More than a hundred runs at once are submitted as
one job array.

One `squeue` every `poll` seconds shows which jobs still exist, and the manifest says how a run ended, so SLURM's accounting
is not needed. Near the time limit, a job saves its run and asks SLURM to requeue it, as often as necessary. The next
sweep finds the jobs again by a file in each run's folder.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, ClassVar

from auvbench.errors import RunError, UserError
from auvbench.integrations.cluster.spec import Slurm
from auvbench.runs.atomic_io import write_atomic
from auvbench.scheduling.loop import MANY, Phase, Status, SubmitError
from auvbench.training.worker import LOG, TARGET
from auvbench.untrusted import path_safety, typed_json
from auvbench.untrusted.typed_json import Range

SCRIPT = "slurm.sh"
"""Batch script in the run directory, as last submitted."""

RESERVED = frozenset(
    [
        "-a",
        "--array",
        "-e",
        "--error",
        "-H",
        "--hold",
        "-J",
        "--job-name",
        "-o",
        "--output",
        "--open-mode",
        "--parsable",
        "-Q",
        "--quiet",
        "--requeue",
        "--no-requeue",
        "--signal",
        "--test-only",
        "-V",
        "--version",
        "-W",
        "--wait",
        "--wrap",
    ]
)
"""options of sbatch that `launcher.sbatch` may not contain: auvbench sets them itself, or they change sbatch's answer"""

JOB_FILE = "slurm.json"
"""File in the run directory that names the last submitted job, so that the next sweep finds it."""

WAITING = {
    "PENDING",
    "CONFIGURING",
    "REQUEUED",
    "REQUEUE_HOLD",
    "REQUEUE_FED",
    "RESV_DEL_HOLD",
    "SPECIAL_EXIT",
}
RUNNING = {"RUNNING", "COMPLETING", "STAGE_OUT", "SIGNALING", "SUSPENDED", "STOPPED", "RESIZING"}


@dataclass(frozen=True, slots=True)
class _Submitted:
    """Content of `slurm.json`."""

    job: Annotated[str, Range(1, 40)]
    name: Annotated[str, Range(0, 400)] = ""
    """name of the job array; '' for a job outside an array, whose name is the run's name"""


@dataclass(slots=True, eq=False)
class SlurmJob:
    """One job of the cluster."""

    run: Path
    number: str
    backend: SlurmBackend
    status: Status = field(default_factory=lambda: Status(Phase.QUEUED))
    gone_since: float | None = None  # monotonic time at which the job was first missing

    @property
    def mark(self) -> str | None:
        return f"slurm:{self.number}"

    def poll(self) -> Status:
        self.backend.update()
        return self.status

    def cancel(self, *, force: bool = False) -> None:
        if self.status.ended:
            return
        if force:
            command(["scancel", self.number], check=False)
        else:
            # A waiting job has nothing to save, so it is cancelled. A running job and its batch process get a signal like Ctrl-C.
            command(["scancel", "--state=PENDING", self.number], check=False)
            command(["scancel", "--signal=TERM", "--full", self.number], check=False)
        self.backend.look_again()

    def __str__(self) -> str:
        return f"slurm job {self.number}"


class SlurmBackend:
    """Backend for a SLURM cluster that this machine can submit to; the cluster shares the file system of the
    run directories.
    """

    largest_array: ClassVar[int] = 1000
    """largest number of tasks of an array; by default SLURM refuses indices above 1000"""

    def __init__(self, options: Slurm, *, target: str = TARGET) -> None:
        for program in ("sbatch", "srun", "squeue", "scontrol", "scancel"):
            if shutil.which(program) is None:
                raise UserError(f"launcher=slurm: {program} not found; run this on a login node")
        for option in options.sbatch:
            if option.split("=")[0] in RESERVED:
                raise UserError(
                    f"launcher.sbatch={option}: auvbench sets this option itself, or it changes sbatch's "
                    "answer; leave it out"
                )
        self.options = options
        self.target = target
        self.limit = options.workers or None
        self.jobs: dict[str, SlurmJob] = {}
        self._next = 0.0

    def submit(self, run: Path) -> SlurmJob:
        run = _prepared(run)
        number = self._sbatch(run, self.script(run))
        _note(run, number)
        return self._watch(run, number)

    def submit_array(self, runs: Sequence[Path]) -> dict[Path, SlurmJob]:
        """Submit runs as one job array; return the job of each run.

        The script is in the folder of the first run. A run whose folder cannot be used gets no job; a later `submit` of the run
        reports the reason. If at most `MANY` runs can be used, no array is submitted and the result is empty.

        Raises:
            SubmitError: sbatch refused the array.
        """
        ready: dict[Path, Path] = {}
        for run in runs:
            with contextlib.suppress(OSError, RunError):
                ready[run] = _prepared(run)
        if len(ready) <= MANY:
            return {}
        places = list(ready.values())
        array = self._sbatch(places[0], self.script(*places))
        jobs: dict[Path, SlurmJob] = {}
        for task, (run, place) in enumerate(ready.items()):
            with contextlib.suppress(OSError):  # only later sweeps need the job file, to find the job
                _note(place, f"{array}_{task}", _array_name(places))
            jobs[run] = self._watch(place, f"{array}_{task}")
        return jobs

    def _sbatch(self, run: Path, script: str) -> str:
        """Write a batch script to a run's folder, submit it, and return the job's number."""
        write_atomic(run / SCRIPT, script.encode())
        # A sweep inside a job must not pass that job's settings on to the jobs that it submits.
        environment = {key: value for key, value in os.environ.items() if not key.startswith("SBATCH_")}
        done = subprocess.run(
            ["sbatch", *self.options.sbatch, str(run / SCRIPT)],
            capture_output=True,
            text=True,
            check=False,
            env=environment,
            timeout=120,
        )
        answer = re.search(r"job (\d+)", done.stdout)
        if done.returncode or answer is None:
            lines = [re.sub(r"^(sbatch: )?(error: )?", "", line) for line in done.stderr.splitlines()]
            reason = "; ".join(line for line in lines if line.strip() and not line.startswith("Try "))
            raise SubmitError(f"sbatch refused: {reason or 'no reason given'}")
        return answer[1]

    def adopt(self, run: Path) -> SlurmJob | None:
        try:
            submitted = typed_json.read(run / JOB_FILE, _Submitted)
        except (OSError, ValueError):
            return None
        state = self._states([submitted.job]).get(submitted.job)
        # A reinstalled SLURM uses the same job numbers again, so the job's name is also compared.
        if state is None or state[0] not in WAITING | RUNNING or state[1] != (submitted.name or run.name):
            return None
        return self._watch(run, submitted.job)

    def wait(self, seconds: float) -> None:
        time.sleep(seconds)

    def close(self) -> None:
        """Do nothing: queued and running jobs continue, and the next sweep finds them (`adopt`)."""

    def script(self, *runs: Path) -> str:
        """Return the batch script of a run, or of an array of runs: sbatch's options, the lines of `setup`, and the worker's command.

        The worker replaces the batch shell, without srun, so that signals reach only the worker. SIGUSR1, which announces the
        time limit, is ignored until the worker handles signals. If the job ignored SIGUSR1, the SIGTERM at the limit makes
        the run save.
        """
        options = self.options
        several = len(runs) > 1
        log = runs[0] / LOG
        given = {
            "job-name": _array_name(runs) if several else runs[0].name,
            "array": f"0-{len(runs) - 1}" if several else None,
            "time": options.time,
            "partition": options.partition,
            "account": options.account,
            "mem": options.mem,
            "nodes": 1,
            "ntasks-per-node": 1,
            "cpus-per-task": options.cpus,
            # In an array, the script redirects each task's output to the log of the task's run.
            "output": "/dev/null" if several else str(log).replace("%", "%%"),
            "open-mode": "append",
            "signal": f"B:USR1@{options.signal_before}",
        }
        words = [
            sys.executable,
            "-P",
            "-m",
            "auvbench.integrations.cluster.job",
        ]
        chosen = []
        if several:
            chosen = [
                "runs=(",
                *(shlex.quote(str(run)) for run in runs),
                ")",
                "run=${runs[SLURM_ARRAY_TASK_ID]}",
            ]
            chosen.append(f'exec >>"$run"/{shlex.quote(str(LOG))} 2>&1')
        run = '"$run"' if several else shlex.quote(str(runs[0]))
        lines = [
            "#!/bin/bash",
            *(
                f"#SBATCH --{key}={shlex.quote(str(value))}"
                for key, value in given.items()
                if value is not None
            ),
            "#SBATCH --requeue",
            *chosen,
            "trap '' USR1",
            *options.setup,
            f"exec {shlex.join(words)} {run} --target {shlex.quote(self.target)}",
        ]
        return "\n".join(lines) + "\n"

    def update(self) -> None:
        """Query the cluster about all jobs, at most once every `poll` seconds."""
        now = time.monotonic()
        open_jobs = {number: job for number, job in self.jobs.items() if not job.status.ended}
        if now < self._next or not open_jobs:
            return
        self._next = now + self.options.poll
        try:
            states = self._states(list(open_jobs))
        except SubmitError:
            return  # SLURM's controller does not answer, so the states of the jobs are unknown
        for number, job in open_jobs.items():
            state = states.get(number, ("", ""))[0]
            if state in WAITING:
                job.status = Status(Phase.QUEUED)
            elif state in RUNNING:
                job.status = Status(Phase.RUNNING)
            else:
                self._missing(job, state)
                continue
            job.gone_since = None

    def look_again(self) -> None:
        """Let the next `update` query the cluster at once."""
        self._next = 0.0

    def _missing(self, job: SlurmJob, state: str) -> None:
        """Mark a missing job as ended if its run's manifest says that the run ended, or after the time `grace`.

        The time `grace` allows for a slow file server.
        """
        job.gone_since = job.gone_since or time.monotonic()
        if _settled(job.run) or time.monotonic() - job.gone_since >= self.options.grace:
            job.status = Status(Phase.ENDED, reason=self._reason(job.number, state))
        else:
            self._next = min(self._next, time.monotonic() + 1.0)

    def _reason(self, number: str, state: str) -> str:
        shown = command(["scontrol", "--oneliner", "show", "job", number], check=False)
        fields = dict(word.split("=", 1) for word in shown.split() if "=" in word)
        if not fields:
            return f"slurm job {number} is no longer known to the cluster"
        code, _, caught = fields.get("ExitCode", "0:0").partition(":")
        how = f"killed by signal {caught}" if caught not in ("", "0") else f"exit code {code}"
        hint = (
            ", possibly out of memory" if caught == "9" or fields.get("JobState") == "OUT_OF_MEMORY" else ""
        )
        return f"slurm job {number} ended as {fields.get('JobState', state)} ({how}{hint})"

    def _watch(self, run: Path, number: str) -> SlurmJob:
        self.jobs[number] = SlurmJob(run, number, self)
        return self.jobs[number]

    def _states(self, numbers: Sequence[str]) -> dict[str, tuple[str, str]]:
        """Return, by job number, the state and the name of each job in `numbers` that the cluster still knows."""
        # --me instead of --jobs: squeue rejects a list with a job that it has forgotten.
        # --array: one line for each task, including waiting tasks.
        text = command(["squeue", "--me", "--noheader", "--array", "--states=all", "--format=%i|%T|%j"])
        rows = [line.split("|", 2) for line in text.splitlines() if line.count("|") >= 2]
        return {number: (state, name) for number, state, name in rows if number in numbers}


def _prepared(run: Path) -> Path:
    """Return the absolute path of a run after making the folder of its log."""
    run = run.absolute()
    path_safety.refuse_links(run)
    (run / LOG).parent.mkdir(exist_ok=True)
    return run


def _note(run: Path, number: str, name: str = "") -> None:
    """Write a job's number to the folder of its run, with the job's name if this is not the run's name."""
    named = {"name": name} if name else {}
    write_atomic(run / JOB_FILE, json.dumps({"job": number, **named, "submitted": time.time()}).encode())


def _array_name(runs: Sequence[Path]) -> str:
    return f"{runs[0].name}+{len(runs) - 1}"


def _settled(run: Path) -> bool:
    from auvbench.runs.directory import RunDirectory

    try:
        return RunDirectory(run).manifest()["state"] in ("complete", "failed", "interrupted")
    except RunError:  # removed or damaged meanwhile: do not wait for it
        return True


def command(arguments: Sequence[str], *, check: bool = True) -> str:
    """Run one of SLURM's query or cancel programs and return its output.

    Raises:
        SubmitError: the program failed (with `check`); the message contains the last line of its output.
    """
    environment = {**os.environ, "SLURM_TIME_FORMAT": "standard"}
    done = subprocess.run(
        arguments,
        capture_output=True,
        text=True,
        check=False,
        env=environment,
        timeout=120,
        # a second Ctrl-C must reach auvbench, but not the scancel that the first Ctrl-C started
        start_new_session=True,
    )
    if done.returncode and check:
        last = (done.stderr.strip() or done.stdout.strip() or f"exit code {done.returncode}").splitlines()[-1]
        raise SubmitError(f"{arguments[0]} refused: {last}")
    return done.stdout


def make(options: Slurm, target: str, learning: bool) -> SlurmBackend:
    """Return the backend; see `config.launchers.LauncherSpec.factory`."""
    return SlurmBackend(options, target=target)
