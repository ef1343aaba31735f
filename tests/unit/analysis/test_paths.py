"""The trajectories of a test, read within bounds."""

from __future__ import annotations

import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from auvbench.analysis.damage import Damage
from auvbench.analysis.load import load
from auvbench.analysis.recorded import paths
from auvbench.analysis.sources import NAME
from tests.synthetic import seal, write_experiment


def drawn(run: Path, **arrays: Any) -> list[Any]:
    """The paths of a run whose trajectories have other arrays."""
    file = run / "evaluations" / "test" / NAME
    with np.load(file) as there:
        whole = dict(there) | arrays
    np.savez_compressed(file, **whole)
    seal(file.with_name("summary.json"))
    assert file.stat().st_size < 150_000
    (record,), _ = load([run])
    tracemalloc.start()
    try:
        return list(paths(record, "test", "nominal", 3))
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < 100e6


@pytest.mark.parametrize("dtype", [np.int8, np.float32])
def test_a_small_file_does_not_fill_the_memory(dtype: type, tmp_path: Path) -> None:
    (run,) = write_experiment(tmp_path, algorithms=("pid",), seeds=(0,), episodes=5)
    rows = 60_000_000 // np.dtype(dtype).itemsize
    with pytest.raises(Damage, match="position_nominal_0 has"):
        drawn(run, position_nominal_0=np.zeros((rows // 3, 3), dtype=dtype))


def test_paths_are_floating_point_numbers(tmp_path: Path) -> None:
    (run,) = write_experiment(tmp_path, algorithms=("pid",), seeds=(0,), episodes=5)
    with pytest.raises(Damage, match="floating-point"):
        drawn(run, position_nominal_0=np.zeros((50, 3), dtype=np.int8))


def test_a_reference_and_the_yaw_of_a_dock_are_read_where_they_are_stored(tmp_path: Path) -> None:
    (run,) = write_experiment(tmp_path, algorithms=("pid",), seeds=(0,), episodes=5)
    with np.load(run / "evaluations" / "test" / NAME) as there:
        reference = there["position_nominal_0"] + np.float32(1.0)
    first, second, *_ = drawn(
        run, reference_nominal_0=reference, dock_yaw_nominal_1=np.array([0.5], dtype=np.float32)
    )
    np.testing.assert_array_equal(first.reference, reference)
    assert (first.dock_yaw, second.reference, second.dock_yaw) == (None, None, 0.5)
    with pytest.raises(Damage, match="reference_nominal_0 must have the shape"):
        drawn(run, reference_nominal_0=reference[1:])
    with pytest.raises(Damage, match="not finite"):
        drawn(run, reference_nominal_0=reference, dock_yaw_nominal_1=np.array([np.nan], dtype=np.float32))


def test_the_other_vehicles_of_a_team_are_read_where_they_are_stored(tmp_path: Path) -> None:
    (run,) = write_experiment(tmp_path, algorithms=("pid",), seeds=(0,), episodes=5)
    with np.load(run / "evaluations" / "test" / NAME) as there:
        others = there["position_nominal_0"][:, None].repeat(7, axis=1) + np.arange(7.0)[:, None]
    first, second, *_ = drawn(run, others_nominal_0=others)
    np.testing.assert_array_equal(first.others, others)
    assert second.others is None
    for wrong in (others[1:], others[:, 0], others[:, :, :2], others[:, [*range(7), 0]]):
        with pytest.raises(Damage, match="others_nominal_0 must have the shape"):
            drawn(run, others_nominal_0=wrong)
