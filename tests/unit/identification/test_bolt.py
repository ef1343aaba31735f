"""The sheet of Bolt, and the pool tests from which it comes (a folder next to the repository, or AUVBENCH_POOL)."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from auvbench.identification import csv_log, parameters, validation
from auvbench.identification.fit import fit
from auvbench.identification.log import CHANNELS, Log
from auvbench.vehicles import identified, reader, sheet

POOL = Path(os.environ.get("AUVBENCH_POOL", Path(__file__).parents[4] / "shared" / "reference" / "pool"))
RUNS = POOL / "bolt_pool_tests"
TRAINING = ("depth_test", "depth_test_4", "yaw_test", "yaw_test_2", "yaw_test_5")
HELD_OUT = ("depth_test_3", "yaw_test_3", "yaw_test_6", "dtest_closed_loop_depth")
NAMES = ("voltage", "added_mass.heave", "quadratic_damping.heave", "net_buoyancy", "inertia.yaw", "quadratic_damping.yaw")  # fmt: skip

needs_pool = pytest.mark.skipif(not RUNS.is_dir(), reason="needs the pool tests of Bolt")


def logs(names: tuple[str, ...]) -> list[Log]:
    return [csv_log.read(RUNS / f"{name}.csv", "ned") for name in names]


def test_a_positive_pulse_of_a_vertical_thruster_moves_down_and_the_yaw_arm_is_that_of_the_source() -> None:
    vehicle = sheet.load("bolt")
    allocation = vehicle.allocation
    np.testing.assert_allclose(allocation[2, 4:], -1.0)  # z up
    # 0.375 m (-T1 + T2 + T3 - T4) about an axis that points down.
    np.testing.assert_allclose(allocation[5, :4], [0.375, -0.375, -0.375, 0.375], atol=1e-5)


@needs_pool
def test_pool_tests_that_were_not_fitted_are_predicted_better_than_by_the_authors_model_in_heave() -> None:
    entries = [
        (name, sheet.load(name), identified.of(reader.read(name))) for name in ("bolt", "bolt_mansour2025")
    ]
    done = validation.validate(logs(HELD_OUT), entries)
    hold, constant, bolt, authors = (prediction.rms() for prediction in done.predictions)
    z, yaw, five = CHANNELS.index("z"), CHANNELS.index("yaw"), validation.HORIZONS.index(5.0)
    assert bolt[five, z] < 0.09
    assert bolt[five, z] < 0.5 * authors[five, z]
    assert bolt[five, z] < 0.6 * constant[five, z] < hold[five, z]
    assert bolt[five, yaw] < 0.47
    assert bolt[five, yaw] < constant[five, yaw] < hold[five, yaw]
    assert authors[five, yaw] < bolt[five, yaw]  # docs/identification.md says so
    covered = done.predictions[2].coverage()
    assert covered is not None
    assert 0.75 < covered < 0.95


@needs_pool
@pytest.mark.slow
def test_the_sheet_is_what_its_command_writes() -> None:
    vehicle = sheet.load("bolt_mansour2025")
    result = fit(logs(TRAINING), vehicle, parameters.choose(vehicle, NAMES, False))
    section = identified.of(reader.read("bolt"))
    assert section is not None
    np.testing.assert_allclose(result.x, section.fitted, atol=1e-3)
    np.testing.assert_allclose(result.covariance, section.covariance, atol=2e-2)
    assert [e.parameter.name for e in result.estimates if e.kept] == ["voltage"]
