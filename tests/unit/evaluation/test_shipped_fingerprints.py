"""The code meets the scenarios of the published studies, as their fingerprints say, and new metrics and blocks leave them be."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pandas as pd
import pytest

from auvbench import metrics, record
from auvbench.evaluation import reference
from auvbench.evaluation.protocol import fingerprint, resolve_conditions
from auvbench.registry import TASKS
from auvbench.tasks import base
from auvbench.tasks import fingerprint as frozen
from tests import configs

RESULTS = Path(__file__).parents[3] / "results"
STUDIES = sorted(path.parent.name for path in RESULTS.glob("*/runs.parquet"))

NEWER = {
    # Paths begin at the point next to the vehicle, and their reference stands still at the end.
    "726992aad6f64924": "bebd47bf3c5b9aa4",
    "43fd6ba0eb92bc54": "209578c6c38f1609",
    # Docks at 5 m have no start nearer than 5 m.
    "2c0b245d566b7a2c": "29886cabb51efb7a",
    # Two vehicles were added.
    "07e9a483e3d9a2e5": "d2264e6ac145166b",
}
"""Published fingerprints of scenarios that have changed, and those of today."""


@pytest.mark.slow
@pytest.mark.parametrize("study", STUDIES)
def test_scenarios_are_those_of_the_published_studies(study: str) -> None:
    runs = pd.read_parquet(RESULTS / study / "runs.parquet")
    seen = set()
    for config, evaluations in zip(runs["config"], runs["evaluations"], strict=True):
        for name, summary in json.loads(evaluations).items():
            published = summary["fingerprint"]
            if published in seen:
                continue
            seen.add(published)
            protocol = configs.protocol(f"protocol={name}")
            today = fingerprint(protocol, resolve_conditions(protocol, json.loads(config)))
            assert today == NEWER.get(published, published), (study, name)
    assert seen


@pytest.mark.parametrize("task", TASKS.own)
def test_fingerprints_cover_columns_and_blocks_that_a_task_declares(task: str) -> None:
    kind, spec = base.factory(task), TASKS[task]
    assert set(kind.reference_columns) <= set(record.record_columns(task))
    assert set(kind.reference_blocks) <= set(spec.blocks)
    assert kind.reference_columns
    assert kind.reference_blocks
    assert set(frozen.BLOCKS) <= set(kind.reference_blocks) or not spec.has_yaw


@pytest.mark.slow
@pytest.mark.parametrize("task", TASKS.own)
def test_a_new_metric_and_a_new_block_change_no_fingerprint(
    task: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = configs.training(f"task={task}", "vehicle=bluerov2_heavy")
    before = reference.digest(config, None)
    added = metrics.Metric("effort_J", "J", "effort", "energy once more", lambda t: 1.0 + t.energy)
    monkeypatch.setattr(metrics, "METRICS", [*metrics.METRICS, added])
    record.forget()
    # A block that the task did not have, and none that it has twice.
    more = {"docking": "preview", "rendezvous": "preview", "waypoint": "velocity_error"}.get(
        task, "goal_error"
    )
    spec = dataclasses.replace(TASKS[task], blocks=(more, *TASKS[task].blocks))
    monkeypatch.setitem(TASKS.entered, task, spec)
    try:
        assert "effort_J" in record.record_columns(task)
        assert reference.digest(config, None) == before
    finally:
        record.forget()
