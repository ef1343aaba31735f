"""Delays split an agent step exactly."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from auvbench.tasks.disturbances.delay import Segment, schedule, split


def test_no_delay_is_one_whole_step():
    plan = schedule(55.0, 0.0, 0.0)
    assert plan.segments == (Segment(1.0 / 55.0, 0, measure=False),)
    assert (plan.commands, plan.measurements) == (1, 0)


def test_a_quarter_second_at_10_hz_acts_halfway_through_the_third_step():
    plan = schedule(10.0, 0.25, 0.0)
    assert [(s.duration, s.age) for s in plan.segments] == [(0.05, 3), (0.05, 2)]
    assert plan.commands == 4


def test_whole_steps_need_no_cut():
    plan = schedule(10.0, 0.3, 0.2)
    assert plan.segments == (Segment(0.1, 3, measure=True),)
    assert (plan.commands, plan.measurements) == (4, 3)


def test_one_cut_serves_both_delays_where_they_meet():
    plan = schedule(10.0, 0.05, 0.05)
    assert [(s.duration, s.age, s.measure) for s in plan.segments] == [(0.05, 1, True), (0.05, 0, False)]


@pytest.mark.parametrize(("delay", "expected"), [(0.1, (1, 0.0)), (0.3, (3, 0.0)), (0.7, (7, 0.0))])
def test_rounding_of_the_product_is_no_rest(delay, expected):
    assert split(delay, 10.0) == expected


delays = st.floats(0.0, 3.0)


@given(st.floats(0.5, 200.0), delays, delays, st.floats(0.0, 1.0, exclude_max=True))
def test_the_acting_command_is_the_one_issued_a_delay_ago(frequency, action, observation, fraction):
    plan = schedule(frequency, action, observation)
    period = 1.0 / frequency
    assert math.fsum(s.duration for s in plan.segments) == pytest.approx(period, rel=1e-12)
    assert all(s.duration > 0.0 for s in plan.segments)
    assert max(s.age for s in plan.segments) == plan.commands - 1
    # At time t within step k, what acts was issued in step floor((t - delay) f).
    k = plan.commands + plan.measurements
    t, elapsed = fraction * period, 0.0
    for segment in plan.segments:
        if elapsed + 1e-6 * period < t < elapsed + (1.0 - 1e-6) * segment.duration:
            assert k - segment.age == math.floor((k * period + t - action) * frequency + 1e-7)
        elapsed += segment.duration
    measured = [i for i, s in enumerate(plan.segments) if s.measure]
    assert len(measured) == (plan.measurements > 0)
    if measured:
        taken = math.fsum(s.duration for s in plan.segments[: measured[0] + 1])
        # Taken in step k - measurements, it arrives at the beginning of step k.
        assert (k - plan.measurements) * period + taken + observation == pytest.approx(
            k * period, abs=1e-6 * period
        )
