"""The tests of all pairs: what they compute, and how rarely they err (docs/statistics.md, measured with more)."""

import numpy as np
import pytest
from scipy import stats

from auvbench.statistics import crossed, pairs, pooled, resolution
from auvbench.statistics.resolution import bounded, log_odds
from benchmarks.statistics import letters, reports, tables
from benchmarks.statistics.__main__ import replaced
from benchmarks.statistics.alternatives import ALTERNATIVES, permutation
from benchmarks.statistics.worlds import FAILED, World, drawn, of_rate, shifted, successes


def data(seed=0, S=3, n=4, E=60, sds=(0.2, 0.5, 1.0, 2.0)):
    rng = np.random.default_rng(seed)
    hard = rng.normal(size=E)
    return [World(1.0, sd).draw(S, E, hard, rng)[0] for sd in sds[:n]]


def test_pooled_variances_are_the_average_or_more():
    plain = crossed(data(), rate=True)
    found = pooled(plain)
    average = (plain.between_seeds * plain.seeds).mean() / 3
    assert found.between_seeds == pytest.approx(np.maximum(plain.between_seeds, average))
    raised = plain.between_seeds < average
    assert raised.any()
    assert not raised.all()
    assert found.seeds_df == pytest.approx(np.where(raised, 4 * 2, 2))
    assert (found.mean == plain.mean).all()
    assert (found.between_scenarios == plain.between_scenarios).all()


def test_single_runs_lend_and_borrow_nothing():
    alone = crossed(data()[:2], rate=True)
    mixed = crossed([*data()[:2], data()[2][:1]], rate=True)
    found = pooled(mixed)
    assert found.between_seeds[2] == 0
    assert np.isinf(found.seeds_df[2])
    assert found.between_seeds[:2] == pytest.approx(pooled(alone).between_seeds)


def test_seeds_count_by_their_number():
    rng = np.random.default_rng(3)
    some = [
        rng.normal(size=(S, 40)) + sd * rng.normal(size=(S, 1)) for S, sd in ((2, 0.1), (5, 1.0), (9, 0.5))
    ]
    table = crossed(some)
    squares = np.array([x.mean(axis=1).var(ddof=1) for x in some])
    average = squares @ [1, 4, 8] / 13
    expected = np.maximum(squares, average) / [2, 5, 9]
    assert pooled(table).between_seeds == pytest.approx(expected)


def test_log_odds_are_the_delta_method():
    table = crossed([np.array([[1, 1, 0, 1], [1, 0, 0, 1.0]]), np.ones((2, 4))], rate=True)
    found = log_odds(table)
    p = (np.array([5 / 8, 1]) * 8 + 0.5) / 9
    assert found.mean == pytest.approx(np.log(p / (1 - p)))
    assert found.between_seeds == pytest.approx(table.between_seeds / (p * (1 - p)) ** 2)
    assert np.isfinite(found.between_scenarios).all()
    steps = crossed([np.array([[100.0, 300.0], [200.0, 250.0]])], bounds=(0.0, 1000.0))
    share = (0.2125 * 4 + 0.5) / 5
    assert log_odds(steps).mean[0] == pytest.approx(np.log(share / (1 - share)))
    assert bounded(steps)
    assert not bounded(crossed([np.ones((2, 3))], bounds=(0.0, np.inf)))


def test_the_larger_p_of_two_scales_counts():
    table = crossed(data(), rate=True)
    on_rates, on_odds = pairs(pooled(table)).p_value, pairs(pooled(log_odds(table))).p_value
    assert resolution(table) == pytest.approx(np.maximum(on_rates, on_odds))
    unbounded = crossed([10 * x for x in data()])
    assert resolution(unbounded) == pytest.approx(pairs(pooled(unbounded)).p_value)


def test_two_runs_are_tested_by_the_paired_t_test():
    rng = np.random.default_rng(2)
    x, y = rng.gamma(2, 100, size=(2, 1, 50))
    p = resolution(crossed([x, y], bounds=(0.0, 5000.0)))[0, 1]
    assert p == pytest.approx(stats.ttest_rel(x[0], y[0]).pvalue)


def test_two_agents_of_equal_variance_are_students_t_test():
    """Where scenarios add nothing: the pooled average is the smaller one's, the larger one keeps its own."""
    x = np.array([[1.0], [2.0], [3.0]]) + np.zeros((3, 2))
    y = np.array([[2.5], [3.5], [4.5]]) + np.zeros((3, 2))
    p = resolution(crossed([x, y]))[0, 1]
    assert p == pytest.approx(stats.ttest_ind([1, 2, 3], [2.5, 3.5, 4.5]).pvalue)


def test_many_tables_at_once_are_as_one_by_one():
    rng = np.random.default_rng(5)
    worlds = [of_rate(0.9, 0.5), of_rate(0.98, 2.0), of_rate(0.6, 0.3, 0.3)]
    success, steps = drawn(worlds, 3, rng.normal(size=(7, 40)), rng)
    success[0, 0] = 1.0
    for values, rate, ends in ((success, True, (0, 1)), (steps, False, (1.0, 1000.0))):
        batch = tables.crossed(values, rate=rate, least=ends[0], most=ends[1])
        p = resolution(batch)
        for t in range(7):
            one = crossed(list(values[t]), rate=rate, bounds=ends)
            for name in ("mean", "between_seeds", "residual", "between_scenarios"):
                assert getattr(batch, name)[t] == pytest.approx(getattr(one, name), rel=1e-9, abs=1e-15), name
            assert p[t] == pytest.approx(resolution(one), rel=1e-6, abs=1e-12)


def test_the_permutation_of_seeds_is_scipys():
    rng = np.random.default_rng(6)
    seeds = rng.normal(size=(4, 2, 5))
    found = permutation(None, seeds)
    for t in range(4):
        test = stats.permutation_test(
            seeds[t],
            lambda x, y, axis: abs(x.mean(axis=axis) - y.mean(axis=axis)),
            alternative="greater",
            n_resamples=np.inf,
        )
        assert found[t, 0] == pytest.approx(test.pvalue)


def test_worlds_have_the_rate_that_is_asked_for():
    world = of_rate(0.9, 2.0)
    assert world.truth()[0] == pytest.approx(0.9)
    assert shifted(world, 0.05).truth()[0] == pytest.approx(0.85)
    rng = np.random.default_rng(7)
    data = successes([world, World(3.25, 0.5, failing=0.3)], 2, rng.normal(size=(1500, 50)), rng)
    rates = data.mean(axis=(2, 3))
    error = 4 * rates.std(axis=0) / np.sqrt(1500)
    assert (np.abs(rates.mean(axis=0) - [0.9, World(3.25, 0.5, failing=0.3).truth()[0]]) < error).all()
    assert FAILED == 5.0


TABLES = 150
ALLOWED = 0.06 + 3 * np.sqrt(0.06 * 0.94 / TABLES)
"""6 % and three standard errors of 150 tables"""


@pytest.mark.parametrize("rate", letters.RATES)
@pytest.mark.parametrize("place", range(5))
def test_false_letters_are_rare(rate, place):
    """Eight or twelve agents of equal rate and three seeds, in the designs that misled the tests before."""
    found = letters.false_letters(letters.equal(rate)[place], TABLES, ("used",), seed=1)
    assert found["used"] <= ALLOWED


def test_what_was_used_before_erred_more_often():
    wild, failing = letters.equal(0.9)[2], letters.equal(0.9)[4]
    for design in (wild, failing):
        found = letters.false_letters(design, TABLES, ("own variances", "moderated (before)", "used"), seed=2)
        assert min(found["own variances"], found["moderated (before)"]) > found["used"] + 0.05


def test_differences_are_still_found():
    """Twelve agents of five seeds, rates 40 to 97 %: more than half of the differences over 20 points."""
    design = next(d for d in letters.spread() if d.name == "12 agents, sd 0.6" and d.seeds == 5)
    found = letters.power(design, 40, ("own variances", "used"))
    assert found["used"] > 0.45
    assert found["used"] > found["own variances"]


def test_penalised_steps_keep_their_level_too():
    design = letters.equal(0.9)[4]
    assert letters.false_letters_of_steps(design, 100)["used"] < 0.06 + 3 * 0.024


def test_one_seed_is_never_told_apart():
    found = reports.one_seed(40)
    for before, used in found.values():
        assert before > 0.4
        assert used <= 0.1
    assert found["8 of one seed"][1] == 0


def test_every_alternative_gives_p_values():
    design = letters.equal(0.9)[0]
    batch = next(letters.resolved(design, 5, ALTERNATIVES))
    assert {x.shape for x in batch.values()} == {(5, 28)}


def test_the_page_keeps_everything_but_the_measured_tables():
    page = "a\n<!-- measured: x -->\nold\n<!-- end -->\nb\n<!-- measured: y -->\n<!-- end -->\n"
    assert replaced(page, "x", "new") == page.replace("old", "new")
    with pytest.raises(ValueError, match="no <!-- measured: z -->"):
        replaced(page, "z", "new")


def test_a_mean_beyond_the_limit_that_its_record_names_is_tested_without_a_warning(recwarn):
    rng = np.random.default_rng(0)
    data = [200 + rng.normal(size=(3, 20)), 320 + rng.normal(size=(3, 20))]
    p = resolution(crossed(data, bounds=(1.0, 300.0)))
    assert p[0, 1] < 0.05
    assert not recwarn.list


def test_trainings_that_never_fail_differ_from_a_policy_that_nearly_always_does():
    perfect, random = np.ones((5, 500)), np.zeros((1, 500))
    random[0, :6] = 1.0
    worlds = [World(5.0, 1.0), World(4.0, 1.0), World(2.5, 2.0)]
    rng = np.random.default_rng(7)
    hard = rng.normal(size=500)
    others = [world.draw(5, 500, hard, rng)[0] for world in worlds]
    table = crossed([perfect, random, *others], rate=True)
    p = resolution(table)
    assert p[0, 1] < 1e-5
    # What was not seen is not certain either: it takes more than the others' failures to tell it from them.
    assert p[0, 2] > 0.05
