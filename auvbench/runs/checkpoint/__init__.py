"""Checkpoints that continue a run with the same bits; docs/resume.md says what that means exactly."""

from auvbench.runs.checkpoint.callback import Checkpointer
from auvbench.runs.checkpoint.signals import RunInterruptedError, StopRequest, stop_on_signals
from auvbench.runs.checkpoint.store import Checkpoint, CheckpointStore, CheckpointWarning

__all__ = [
    "Checkpoint",
    "CheckpointStore",
    "CheckpointWarning",
    "Checkpointer",
    "RunInterruptedError",
    "StopRequest",
    "stop_on_signals",
]
