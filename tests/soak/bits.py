"""Every bit that a finished run leaves: what an interrupted one must end with too."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np

from auvbench.training.checkpoint.saver import FIELDS
from auvbench.training.checkpoint.store import CheckpointStore


def bits(run: Path) -> dict[str, str]:
    """A hash per part: weights, optimizers, statistics, generators, replay buffer, tables, scalars, model.

    Two things are left out, because they are times of the wall clock: how long the process ran, and the values
    of TensorBoard's `time/` scalars, of which only the steps count.
    """
    store = CheckpointStore(run)
    checkpoint = store.peek()
    assert checkpoint is not None
    assert checkpoint.step == json.loads((run / "manifest.json").read_text())["steps"]
    found = {}
    for path in sorted(checkpoint.path.iterdir()):
        if path.name == "learner.json":
            value = json.loads(path.read_text())
            found[path.name] = _hash(json.dumps({key: value[key] for key in value if key != "elapsed_ns"}))
        elif path.name not in ("manifest.json", "clock.json"):
            found[path.name] = _hash(path.read_bytes())
    for field in FIELDS if checkpoint.segments else ():
        rows = [(segment.first, _field(store, segment.name, field)) for segment in checkpoint.segments]
        # Where the ring has overwritten the head of a segment, whether its file still holds it is no matter.
        kept = np.concatenate([values for _, values in rows])
        found[f"replay.{field}"] = _hash(kept[-_ring(run, len(kept)) :].tobytes())
    found["episodes.csv"] = _hash((run / "train/episodes.csv").read_bytes())
    found["scalars"] = _hash(repr(scalars(run)))
    for path in (run / "model").iterdir():
        found[f"model/{path.name}"] = _hash(path.read_bytes())
    manifest = json.loads((run / "manifest.json").read_text())
    for key in ("state", "steps", "episodes", "success_rate", "error"):
        found[key] = repr(manifest[key])
    return found


def scalars(run: Path) -> dict[str, list[tuple[int, float]]]:
    """TensorBoard's scalars by name as (step, value); rates of the wall clock by step alone."""
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    accumulator = EventAccumulator(str(run / "train"), size_guidance={"scalars": 0})
    accumulator.Reload()
    return {
        tag: [
            (event.step, 0.0 if tag.startswith("time/") else event.value)
            for event in accumulator.Scalars(tag)
        ]
        for tag in sorted(accumulator.Tags()["scalars"])
    }


def _field(store: CheckpointStore, name: str, field: str) -> Any:
    with np.load(store.replay_folder / name, allow_pickle=False) as arrays:
        return arrays[field]


def _ring(run: Path, rows: int) -> int:
    import yaml

    algo = yaml.safe_load((run / "config.yaml").read_text())["algo"]
    return min(rows, max(1, algo["buffer_size"] // algo["n_envs"]))


def _hash(data: bytes | str) -> str:
    return hashlib.sha256(data.encode() if isinstance(data, str) else data).hexdigest()[:16]
