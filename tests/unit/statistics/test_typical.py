"""The typical training: values of an independent implementation, and what holds for every sample."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some
from scipy import stats

from auvbench.statistics import typical
from auvbench.statistics.reliability import reliability
from auvbench.statistics.typical import Contrast, Sample, difference, median_interval, sample


def rates(rng, hard, n, level, sd):
    """Successes (n, E) of trainings whose logits spread by `sd` round a level."""
    logit = level + sd * rng.normal(size=(n, 1)) - hard + rng.logistic(size=(n, len(hard)))
    return (logit > 0).astype(np.float64)


def drawn():
    rng = np.random.default_rng(2)
    hard = rng.normal(size=200)
    learners = {n: rates(rng, hard, n, 2.0, 0.5) for n in (5, 8, 20)}
    other = rates(rng, hard, 10, 1.0, 1.0)
    return learners, other, rates(rng, hard, 1, 1.5, 0.0)


AGAINST_A_CONTROLLER = {
    (5, 1): (0.115, -0.01399978, 0.189677918),
    (5, 5): (0.115, -0.08802557, 0.25302557),
    (5, 12): (0.115, -0.140436326, 0.305436326),
    (8, 1): (0.025, -0.07443257, 0.15418257),
    (8, 5): (0.025, -0.090299936, 0.188131484),
    (8, 12): (0.025, -0.113219222, 0.213219222),
    (20, 1): (0.095, 0.017588255, 0.165033333),
    (20, 5): (0.095, -0.011634079, 0.184837781),
    (20, 12): (0.095, -0.018748462, 0.193176946),
}
AGAINST_A_LEARNER = {
    (5, 1): (0.26, 0.073448275, 0.350845274),
    (5, 12): (0.26, -0.064024318, 0.483277536),
    (8, 5): (0.17, -0.052312728, 0.361130947),
    (20, 1): (0.24, 0.082367813, 0.326691638),
    (20, 5): (0.24, 0.024132378, 0.376218898),
    (20, 12): (0.24, 0.000882765, 0.395370728),
}
"""by trainings and rows of the table: difference, low and high end"""


@pytest.mark.parametrize(("n", "family"), AGAINST_A_CONTROLLER)
def test_a_learner_against_a_controller(n, family):
    learners, _, controller = drawn()
    found = difference(sample(learners[n]), sample(controller), rate=True)
    expected = AGAINST_A_CONTROLLER[n, family]
    assert (float(found.value), *map(float, found.ends(0.05 / family))) == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize(("n", "family"), AGAINST_A_LEARNER)
def test_a_learner_against_a_learner(n, family):
    learners, other, _ = drawn()
    found = difference(sample(learners[n]), sample(other), rate=True)
    expected = AGAINST_A_LEARNER[n, family]
    assert (float(found.value), *map(float, found.ends(0.05 / family))) == pytest.approx(expected, abs=1e-8)


def test_times():
    rng = np.random.default_rng(1)
    y = rng.uniform(20, 30, 500)
    x = y * rng.normal(0.9, 0.02, (10, 1)) + rng.normal(0, 1, (10, 500))
    found = difference(sample(x), sample(y[None]))
    assert float(found.value) == pytest.approx(-2.5848636080824328)
    assert [float(end) for end in found.ends(0.01)] == pytest.approx(
        [-3.4701802454119566, -1.6768819160862842]
    )
    assert float(found.error) == pytest.approx(0.02233033974322191)
    gains = -(x.mean(axis=1) - y.mean())
    held = reliability(gains, 0.05 * y.mean(), edge=0.0, failure=-(60.0 - y.mean()))
    assert (held.count, held.trainings) == (10, 10)
    assert (held.low, held.high) == pytest.approx((0.6915028921812392, 1.0))
    assert held.excluded == pytest.approx(0.2588655508930522)
    assert held.mean_turns == pytest.approx(0.07052810555091232)


def test_reliability_counts_trainings_within_the_margin():
    learners, _, controller = drawn()
    gains = learners[20].mean(axis=1) - controller.mean()
    held = reliability(gains, 0.02, edge=0.0, failure=-controller.mean())
    assert (held.count, held.trainings) == (19, 20)
    assert (held.low, held.high) == pytest.approx((0.7512672372279722, 0.9987349105020502))
    assert held.excluded == pytest.approx(0.2161061642068473)
    assert held.mean_turns == pytest.approx(0.09305064782096585)
    assert reliability(gains, 0.02).mean_turns is None
    none = reliability(np.full(8, -1.0), 0.02)
    assert (none.count, none.low, none.excluded) == (0, 0.0, 1.0)
    assert reliability(np.ones(8), 0.0).excluded == pytest.approx(1 - 0.05 ** (1 / 8))


@pytest.mark.parametrize(
    ("values", "level", "expected"),
    [
        ([3, 1, 4, 1, 5, 9, 2, 6], 0.05, (1.0, 3.5, 6.975)),
        ([3, 1, 4, 1, 5], 0.01, (-1.324555320336759, 3.0, 7.324555320336759)),
        (range(1, 21), 0.01, (4.803277605779154, 10.5, 16.196722394220846)),
        (range(1, 11), 0.01, (1.412, 5.5, 9.588)),
        ([7.0], 0.01, (7.0, 7.0, 7.0)),
        ([1, 2, 3, 4], 0.05, (-math.inf, 2.5, math.inf)),
    ],
)
def test_the_interval_of_a_median(values, level, expected):
    assert [float(x) for x in median_interval(list(values), level)] == pytest.approx(expected)


@pytest.mark.parametrize("n", [5, 6, 9, 14, 25])
def test_the_interval_of_a_median_holds_as_often_as_it_says(n):
    """Any shape of the tails: exponential, and a mixture in which a tenth fails; fewer than needed: of one hump."""
    rng, m = np.random.default_rng(n), 20_000
    for level in (0.05, 0.01):
        skewed = rng.exponential(size=(m, n)) - math.log(2)
        failing = skewed - 50 * (rng.random((m, n)) < 0.1)
        # A tenth fails below, so the median is that of the others at (0.5 - 0.1) / 0.9.
        centre = -math.log(1 - 0.4 / 0.9) - math.log(2)
        for values, truth in ((skewed, 0.0), (failing, centre)):
            low, _, high = median_interval(values, level)
            held = float(((low <= truth) & (truth <= high)).mean())
            assert held >= 1 - level - 4 * math.sqrt(level / m), (n, level, held)


def test_the_trainings_needed_are_those_whose_range_is_an_interval():
    for family in (1, 2, 5, 12, 25, 51):
        n = typical.trainings_needed(family)
        assert stats.binom.pmf(0, n, 0.5) * 2 <= 0.05 / family < stats.binom.pmf(0, n - 1, 0.5) * 2


def test_the_rule_is_continuous_where_trainings_begin_to_suffice():
    v = np.array([1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0])
    level = 2.0**-7
    ends = [median_interval(v, level * factor) for factor in (1 - 1e-9, 1.0, 1 + 1e-9)]
    for low, _, high in ends:
        assert (float(low), float(high)) == pytest.approx((1.0, 128.0), rel=1e-6)


def test_few_trainings_reach_beyond_their_range():
    v = np.arange(5.0)
    low, _, high = median_interval(v, 0.01)
    assert float(-low / 4) == pytest.approx(0.01 ** (-1 / 4) / 2 - 1)
    assert float(high - 4) == pytest.approx(float(-low))


@given(some.floats(0, 100), some.floats(0, 100))
def test_a_long_arm_does_not_hide_the_scenarios(a, s):
    found = float(typical.join(a, s))
    assert found >= math.hypot(a, s) - 1e-9
    assert found >= a + 0.41 * s
    assert found <= a + s + 1e-9


def test_all_trainings_on_one_side_by_more_than_the_scenarios_error_decide():
    """If the interval's worst training is better by more than the error of the scenarios, the interval excludes 0."""
    rng = np.random.default_rng(0)
    decided = 0
    for _ in range(300):
        x = rng.gamma(2, 1, size=(10, 1)) * rng.uniform(0, 0.4) + rng.normal(0.1, 1, size=(10, 60))
        found = difference(sample(x), Sample(np.zeros(1), np.zeros(60)))
        worst = float(median_interval(x.mean(axis=1), 0.01)[0])
        s = float(stats.t.isf(0.005, 59) * found.error)
        if worst > s:
            decided += 1
            assert float(found.ends(0.01)[0]) > 0
    assert decided > 20


def test_the_error_of_rates_knows_that_no_failure_is_not_none():
    ones = Sample(np.ones(10), np.ones(500))
    low, high = difference(ones, Sample(np.ones(1), np.ones(500)), rate=True).ends(0.01)
    assert float(high) == pytest.approx(-float(low))
    assert 0.006 < float(high) < 0.009


def test_the_middle_half_leaves_failing_trainings_out():
    x = np.ones((8, 30))
    x[[2, 5]] = 0.0
    x[7] = 0.9
    assert typical.middle_half(x) == pytest.approx(np.full(30, (4 * 1.0 - 0.1) / 4), abs=0.03)
    assert (typical.middle_half(x[:3]) == x[:3].mean(axis=0)).all()


def test_many_tables_at_once_are_as_one_by_one():
    rng = np.random.default_rng(3)
    x, y = rng.normal(size=(7, 9, 40)), rng.normal(size=(7, 1, 40))
    low, high = difference(sample(x), sample(y)).ends(0.01)
    for t in range(7):
        ends = difference(sample(x[t]), sample(y[t])).ends(0.01)
        assert (low[t], high[t]) == pytest.approx([float(end) for end in ends])
    levels = np.array([0.3, 0.05, 0.001])
    one = difference(sample(x[0]), sample(y[0]))
    assert one.ends(levels)[0] == pytest.approx([float(one.ends(level)[0]) for level in levels])


@given(some.integers(0, 10_000), some.sampled_from([5, 8, 20]), some.booleans())
def test_intervals_of_smaller_levels_are_wider(seed, n, rate):
    rng = np.random.default_rng(seed)
    x, y = rng.normal(size=(n, 30)) + rng.normal(size=(n, 1)), rng.normal(size=(1, 30))
    if rate:
        x, y = (x > 0).astype(float), (y > 0).astype(float)
    low, high = difference(sample(x), sample(y), rate).ends(np.geomspace(1e-6, 1.0, 200))
    assert (np.diff(low) >= -1e-12).all()
    assert (np.diff(high) <= 1e-12).all()


def test_a_p_value_is_the_level_whose_interval_reaches_zero():
    learners, other, controller = drawn()
    for x in learners.values():
        for y in (controller, other):
            found = difference(sample(x), sample(y), rate=True)
            p = found.p_value()
            assert 0 < p <= 1
            if p < 1:
                assert float(found.ends(p * (1 + 1e-6))[0]) > 0
                assert float(found.ends(p * (1 - 1e-6))[0]) <= 0
    alike = difference(sample(learners[8]), sample(learners[8]), rate=True)
    assert alike.p_value() == 1.0
    few = difference(sample(learners[5][:4]), sample(controller), rate=True)
    assert few.p_value() == 1.0


def test_a_sum_over_several_agents_adds_the_squares_of_their_arms():
    rng = np.random.default_rng(4)
    samples = [sample(rng.normal(size=(9, 50)) + i) for i in range(4)]
    weights = (0.5, -0.5, 0.5, -0.5)
    found = Contrast(samples, weights)
    ends = [median_interval(one.means, 0.05) for one in samples]
    arms = [
        (m - low, high - m) if w > 0 else (high - m, m - low)
        for (low, m, high), w in zip(ends, weights, strict=True)
    ]
    total = sum(w * one.middle for w, one in zip(weights, samples, strict=True))
    s = stats.t.isf(0.025, 49) * total.std(ddof=1) / math.sqrt(50)
    low, high = found.ends(0.05)
    assert float(found.value - low) == pytest.approx(
        float(typical.join(0.5 * math.hypot(*(a for a, _ in arms)), s))
    )
    assert float(high - found.value) == pytest.approx(
        float(typical.join(0.5 * math.hypot(*(b for _, b in arms)), s))
    )
