"""Carry out one run as a job of SLURM: `python -m auvbench.integrations.cluster.job RUN_DIR`.

The job runs `auvbench.training.worker`. Near the job's time limit the worker saves, and the job asks SLURM to requeue it.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from types import FrameType

JOB, ARRAY, TASK = "SLURM_JOB_ID", "SLURM_ARRAY_JOB_ID", "SLURM_ARRAY_TASK_ID"
"""SLURM's environment variables with the job's number and, in a job array, the array's number and the task's number"""


def number() -> str | None:
    """Return the number of the job in which this process runs, as squeue prints it; None outside of a job."""
    if ARRAY in os.environ and TASK in os.environ:
        return f"{os.environ[ARRAY]}_{os.environ[TASK]}"
    return os.environ.get(JOB)


def name() -> str | None:
    """Return the name of the job in which this process runs, in the form of `SlurmJob.mark`; None outside of a job."""
    return f"slurm:{job}" if (job := number()) else None


class Requeue:
    """Handler of SIGUSR1 (SLURM's announcement of the time limit): save, requeue the job, exit."""

    def __init__(self) -> None:
        self.asked = False
        signal.signal(signal.SIGUSR1, self)

    def __call__(self, _number: int, _frame: FrameType | None) -> None:
        self.asked = True
        os.kill(os.getpid(), signal.SIGTERM)

    def finish(self) -> None:
        """If SIGUSR1 has come, ask SLURM to requeue the job; requeuing ends this process."""
        if self.asked:
            job = str(number())
            print(f"time limit near: job {job} is requeued", flush=True)
            answer = subprocess.run(["scontrol", "requeue", job], capture_output=True, text=True, check=False)
            if answer.returncode:
                print(f"auvbench: requeue refused: {answer.stderr.strip()}", file=sys.stderr)
            else:
                time.sleep(30)  # SLURM ends this process; a process that exits first looks like a failed job


def main(arguments: Sequence[str] | None = None) -> int:
    from auvbench.training import worker  # imported here, because `worker` imports this module for `name`

    requeue = Requeue()
    code = worker.main(arguments)
    requeue.finish()
    return code


if __name__ == "__main__":
    sys.exit(main())
