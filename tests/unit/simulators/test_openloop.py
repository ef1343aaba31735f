"""Open-loop runs: sample times, frames, the text that is written."""

from __future__ import annotations

import numpy as np
import pytest

from auvbench.simulators import openloop
from auvbench.vehicles import sheet


@pytest.mark.parametrize(
    ("duration", "sample", "count", "last"),
    [
        (20.0, 0.1, 201, 20.0),
        (60.0, 0.2, 301, 60.0),
        (1.0, 0.3, 5, 1.0),
        (0.05, 0.1, 2, 0.05),
        (55.0, 1 / 55, 3026, 55.0),
    ],
)
def test_sample_times(duration: float, sample: float, count: int, last: float) -> None:
    times = openloop.sample_times(duration, sample)
    assert len(times) == count
    assert times[0] == 0.0
    assert times[-1] == last
    assert np.all(np.diff(times) > 0)


def test_default_step_is_good_for_a_millionth() -> None:
    for name in ("bluerov2", "bluerov2_realistic_inertia", "bluerov2_wu2018", "lrauv"):
        of = openloop.without_actuators(sheet.load(name))
        wrench = np.array([0.3, 0.1, 0.1, 0, 0, 0.01]) * of.mass
        ends = [
            openloop.integrate(of, duration=10, sample=10, wrench=wrench, velocity=[0.2, 0, 0, 0, 0, 0.1], max_step=h).rows()[-1]
            for h in (0.001, 0.00025)
        ]  # fmt: skip
        np.testing.assert_allclose(ends[0], ends[1], atol=1e-6)


def test_psi_is_unwrapped() -> None:
    of = openloop.without_actuators(sheet.load("bluerov2_heavy"))
    rows = openloop.integrate(of, duration=20, sample=0.1, wrench=[0, 0, 0, 0, 0, 2], frame="ned").rows()
    assert rows[-1, 6] == pytest.approx(22.82044868, rel=1e-7)
    assert np.abs(np.diff(rows[:, 6])).max() < 0.5


def test_body_without_actuators_feels_only_the_wrench() -> None:
    """The fins of the LRAUV are actuators, too."""
    full, of = sheet.load("lrauv"), openloop.without_actuators(sheet.load("lrauv"))
    with_fins = openloop.integrate(full, duration=5, sample=5, velocity=[1, 0.3, 0, 0, 0, 0]).rows()[-1]
    without = openloop.integrate(of, duration=5, sample=5, velocity=[1, 0.3, 0, 0, 0, 0]).rows()[-1]
    assert with_fins[12] != without[12]


def test_a_motion_without_bounds_is_an_error_not_a_file() -> None:
    of = openloop.without_actuators(sheet.load("bluerov2_realistic_inertia"))
    with pytest.raises(openloop.IntegrationError, match="max_step below 1 s"):
        openloop.integrate(of, duration=60, sample=1, wrench=[0, 0, 0, 500, 500, 500], max_step=1.0)


def test_csv_has_the_reference_header_and_twelve_digits() -> None:
    of = openloop.without_actuators(sheet.load("bluerov2"))
    text = openloop.integrate(of, duration=0.2, sample=0.1, frame="ned").csv().splitlines()
    assert text[0] == "t_s,x_m,y_m,z_m,phi_rad,theta_rad,psi_rad,u_mps,v_mps,w_mps,p_radps,q_radps,r_radps"
    assert text[1] == "0" + ",0" * 12
    assert len(text[2].split(",")) == 13
    assert "-0," not in text[2]
