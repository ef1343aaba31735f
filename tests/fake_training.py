"""What workers carry out in the tests of scheduling: a training that takes no time worth mentioning.

It is resumed exactly: each step hashes the one before, the chain is saved every `SAVE_EVERY` steps, and the
end is written to `result.txt`. A `behaviour.json` in the run directory makes it misbehave.
"""

from __future__ import annotations

import hashlib
import json
import os
import signal
import time
from pathlib import Path
from typing import Any

from auvbench.runs import integrity
from auvbench.runs.directory import RunDirectory
from auvbench.runs.interruption import Interrupted, deferred
from auvbench.runs.progress import Reporter

SAVE_EVERY = 10


def make(path: Path, *, total_steps: int = 50, algo: str = "ppo", **behaviour: Any) -> RunDirectory:
    """A frozen run directory. Behaviour: step_s, fail_at, kill_at (both once per directory with once=True)."""
    path.mkdir(parents=True)
    (path / "behaviour.json").write_text(json.dumps(behaviour))
    manifest = {
        "schema_version": 1,
        "id": path.name,
        "state": "pending",
        "steps": 0,
        "total_steps": total_steps,
        "episodes": 0,
        "success_rate": None,
        "seed": 0,
        "algo": algo,
        "attempts": 0,
        "error": None,
        "wall_time_s": 0.0,
        "files": {},
    }
    (path / "manifest.json").write_text(json.dumps(integrity.sealed(manifest)))
    return RunDirectory(path)


def chain(steps: int) -> str:
    """What a run of so many steps ends with."""
    value = "start"
    for step in range(steps):
        value = hashlib.sha256(f"{value}{step}".encode()).hexdigest()
    return value


def execute(run: RunDirectory) -> None:
    behaviour = json.loads((run.path / "behaviour.json").read_text())
    saved = run.path / "saved.json"
    step, value = json.loads(saved.read_text()) if saved.exists() else (0, "start")
    manifest = run.manifest()
    total = manifest["total_steps"]
    attempts = manifest["attempts"] + 1
    run.update_manifest(state="running", attempts=attempts, error=None)
    misbehaves = not behaviour.get("once") or attempts == 1
    reporter = Reporter(run.path / "progress.json", total)
    with deferred() as request:
        while step < total:
            if misbehaves and step == behaviour.get("fail_at"):
                raise ValueError("the loss is not a number")
            if misbehaves and step == behaviour.get("kill_at"):
                os.kill(os.getpid(), signal.SIGKILL)
            time.sleep(behaviour.get("step_s", 0.0))
            value = hashlib.sha256(f"{value}{step}".encode()).hexdigest()
            step += 1
            reporter.step(step, force=True)
            if step % SAVE_EVERY == 0 or request.signal:
                temporary = saved.with_suffix(".new")
                temporary.write_text(json.dumps([step, value]))
                temporary.replace(saved)
            if request.signal:
                run.update_manifest(state="interrupted", steps=step)
                raise Interrupted(request.signal)
    (run.path / "result.txt").write_text(value)
    run.update_manifest(state="complete", steps=total)


def report_threads(run: RunDirectory) -> None:
    import torch

    threads = {"torch": torch.get_num_threads(), "OMP_NUM_THREADS": os.environ.get("OMP_NUM_THREADS")}
    (run.path / "threads.json").write_text(json.dumps(threads))
    run.update_manifest(state="complete")
