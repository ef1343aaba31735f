"""The work of a worker on a trial's run: train it like any run, then test it on the study's validation scenarios."""

from __future__ import annotations

from typing import Any

from auvbench.config import schema
from auvbench.config.tuning import refuse_test
from auvbench.errors import AuvbenchError
from auvbench.evaluation.evaluate import evaluate, stale
from auvbench.runs.directory import RunDirectory
from auvbench.training.execute import execute
from auvbench.tuning import folder

TARGET = "auvbench.tuning.trial:carry_out"
"""function that a worker calls with a run directory"""


def carry_out(run: RunDirectory) -> dict[str, Any]:
    """Train a run to its budget and test it; return its manifest.

    Raises:
        TrainingError, KeyboardInterrupt: As `execute`.
    """
    manifest = execute(run)
    try:
        test(run, folder.of_run(run.path)[1])
    except AuvbenchError as error:
        # The training is complete; the controller tests it again and reports the error.
        print(f"auvbench: {error}", flush=True)
    return manifest


def test(run: RunDirectory, protocol: schema.Protocol) -> None:
    """Test a complete run, unless its test is up to date.

    Raises:
        ConfigError: The protocol has test scenarios.
        RunError: The run is not complete, its files are damaged, or another process is testing it.
    """
    refuse_test(protocol)
    if stale(run, protocol) != "":
        evaluate(run, protocol, unless_done=True)
