"""One entry in the registry is a metric everywhere, and changes no fingerprint."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from auvbench import metrics, record
from auvbench.registry import TASKS

ROOT = Path(__file__).parents[2]
ADDED = '''
import math
from auvbench import metrics

metrics.METRICS += [
    metrics.Metric(
        "jerk_m_s3", "m/s³", "jerk", "change of acceleration, mean over the steps",
        lambda t: t.change / (t.steps * t.step_s), latex=r"mean $j$",
    ),
]
'''  # fmt: skip
USED = """
import numpy as np
from auvbench.analysis.ranking import rank
from auvbench.commands.completion import measure_names
from auvbench.envs.batch import Batch
from auvbench.evaluation.protocol import resolve_conditions, fingerprint
from auvbench.reporting import tables
from auvbench.reporting.page.parts import metrics_table
from auvbench.reporting.tables.main import main_table
from tests import configs
from tests.unit.analysis.agents import agent
from dataclasses import replace

batch = Batch(configs.training("algo=pid", "task.max_steps=2"), 1, seed=0)
batch.reset()
for _ in range(2):
    records = batch.step(np.ones((1, 6))).records
assert records[0]["jerk_m_s3"] == records[0]["smoothness_per_s"] > 0, records

agents = [agent("sac"), agent("ppo")]
agents = [replace(a, metrics={**a.metrics, "jerk_m_s3": a.metrics["steps"] / 100}) for a in agents]
ranking = rank(agents)
shown = main_table(replace(ranking, columns=("mean_jerk_m_s3",)))
assert ("jerk", "m/s³") in [(heading.title, heading.unit) for heading in shown.headings]
page = metrics_table(ranking)
(heading,) = [heading for heading in page.headings if heading.title == "jerk"]
assert heading.hint == "change of acceleration, mean over the steps"
assert "mean $j$" in tables.latex(replace(ranking, columns=("mean_jerk_m_s3",)))
assert "mean_jerk_m_s3" in measure_names()
assert "| `jerk_m_s3` | m/s³ | lower | change of acceleration, mean over the steps |" in metrics.definitions()

protocol = configs.protocol("protocol=test")
assert fingerprint(protocol, resolve_conditions(protocol, configs.plain())) == "cc8e88038a09e4a8"
"""


@pytest.mark.slow
def test_an_entry_is_found_in_records_tables_page_latex_docs_and_completion() -> None:
    done = subprocess.run([sys.executable, "-c", ADDED + USED], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_the_docs_define_every_metric() -> None:
    """`python -m auvbench.metrics` prints the table."""
    assert metrics.definitions() in (ROOT / "docs" / "protocol.md").read_text()


def test_a_task_brings_its_own_metrics() -> None:
    """`metrics.py` has no metric of one task only."""
    names = [metric.name for metric in metrics.METRICS]
    placed = [metric.name for metric in metrics.registered()]
    assert placed.index("deviation_std_m") == placed.index("final_distance_m") + 2
    for name, spec in TASKS.items():
        assert not spec.fault()
        for metric in spec.metrics:
            assert metric.name not in names
            assert metric.name in record.record_columns(name)
            assert not any(metric.name in record.record_columns(other) for other in TASKS if other != name)


def test_names_are_unique_and_measured_metrics_are_defined() -> None:
    names = [metric.name for metric in metrics.registered()]
    assert len(set(names)) == len(names)
    for metric in metrics.registered():
        assert metric.low < metric.high
        assert (metric.definition and metric.better) or metric.kind in ("key", "scenario"), metric.name
