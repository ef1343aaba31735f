"""What a worker does with the run of a trial: trains it as any run, then tests it on the study's validation scenarios."""

from __future__ import annotations

from typing import Any

from auvbench.config import schema
from auvbench.config.tuning import refuse_test
from auvbench.errors import AuvbenchError
from auvbench.evaluation.evaluate import evaluate, stale
from auvbench.evaluation.protocol import circumstances, fingerprint_parts
from auvbench.runs.directory import RunDirectory
from auvbench.training.execute import execute
from auvbench.tuning import folder

TARGET = "auvbench.tuning.trial:carry_out"
"""What a worker calls with the run directory of a trial."""


PRELOAD = ("auvbench.tuning.trial:warm",)
"""What the workers of one machine share."""


def warm(run: RunDirectory) -> None:
    """Draws and plays what a test's fingerprint is made of, once for all trials."""
    plan = folder.of_run(run.path).read()
    protocol = folder.protocol_of(plan, run.path)
    fingerprint_parts(protocol, circumstances(protocol, run.check()))


def carry_out(run: RunDirectory) -> dict[str, Any]:
    """Trains a run to its budget and tests it; returns its manifest.

    Raises:
        TrainingError, KeyboardInterrupt: as `execute`.
    """
    manifest = execute(run)
    try:
        plan = folder.of_run(run.path).read()
        test(run, folder.protocol_of(plan, run.path))
    except AuvbenchError as error:
        # The training stands; whoever wants its score tests it again and says what is wrong.
        print(f"auvbench: {error}", flush=True)
    return manifest


def test(run: RunDirectory, protocol: schema.Protocol) -> None:
    """Tests a complete run unless that is done.

    Raises:
        ConfigError: the protocol is one of test scenarios; nothing here ever meets one.
        RunError: the run is not complete, its files are damaged, or another process is testing it.
    """
    refuse_test(protocol)
    if stale(run, protocol) != "":
        evaluate(run, protocol, unless_done=True)
