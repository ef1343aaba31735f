"""The tests of all pairs: what they compute, and how rarely they err (docs/statistics-appendix.md, measured with more)."""

import numpy as np
import pytest
from scipy import stats

from auvbench.statistics import crossed, resolution
from auvbench.statistics.differences import bounded, log_odds, pair_spread, t_test
from benchmarks.statistics import letters, reports, tables
from benchmarks.statistics.__main__ import replaced
from benchmarks.statistics.alternatives import ALTERNATIVES, USED
from benchmarks.statistics.worlds import FAILED, World, drawn, of_rate, shifted, successes


def data(seed=0, S=3, n=4, E=60, sds=(0.2, 0.5, 1.0, 2.0)):
    rng = np.random.default_rng(seed)
    hard = rng.normal(size=E)
    return [World(1.0, sd).draw(S, E, hard, rng)[0] for sd in sds[:n]]


def test_log_odds_are_the_delta_method():
    table = crossed([np.array([[1, 1, 0, 1], [1, 0, 0, 1.0]]), np.ones((2, 4))], rate=True)
    found = log_odds(table)
    p = (np.array([5 / 8, 1]) * 8 + 0.5) / 9
    assert found.mean == pytest.approx(np.log(p / (1 - p)))
    assert found.between_seeds == pytest.approx(
        np.maximum(table.between_seeds / (p * (1 - p)) ** 2, table.between_odds)
    )
    assert np.isfinite(found.between_scenarios).all()
    steps = crossed([np.array([[100.0, 300.0], [200.0, 250.0]])], bounds=(0.0, 1000.0))
    share = (0.2125 * 4 + 0.5) / 5
    assert log_odds(steps).mean[0] == pytest.approx(np.log(share / (1 - share)))
    assert bounded(steps).all()
    assert not bounded(crossed([np.ones((2, 3))], bounds=(0.0, np.inf))).any()


def test_the_larger_p_of_two_scales_counts():
    table = crossed(data(), rate=True)
    on_rates = t_test(table, pair_spread(table))
    p = resolution(table)
    assert (p >= on_rates - 1e-15).all()
    assert (p > on_rates + 1e-6).any()
    unbounded = crossed([10 * x for x in data()])
    assert resolution(unbounded) == pytest.approx(t_test(unbounded, pair_spread(unbounded)))


def test_an_agent_without_limits_leaves_the_scale_of_others_alone():
    x = [100.0 + 30 * d for d in data()]
    limited = crossed(x, bounds=(0.0, 1000.0))
    some = crossed(x, bounds=(0.0, np.array([1000.0, 1000.0, 1000.0, np.inf])))
    whole, p = resolution(limited), resolution(some)
    assert p[:3, :3] == pytest.approx(whole[:3, :3])
    assert p[:3, 3] == pytest.approx(t_test(limited, pair_spread(limited))[:3, 3])


def test_seeds_near_an_end_count_with_their_own_log_odds():
    """Four seeds of 100 % and one of 80 % hide in the mean how far they are apart."""
    x = np.ones((5, 100))
    x[0, :20] = 0.0
    table = crossed([x, np.ones((1, 100))], rate=True)
    share = (np.array([80, 100, 100, 100, 100]) + 0.5) / 101
    own = np.log(share / (1 - share)).var(ddof=1) / 5
    assert table.between_odds == pytest.approx([own, 0.0])
    f = (480 + 0.5) / 501
    delta = table.between_seeds[0] / (f * (1 - f)) ** 2
    assert log_odds(table).between_seeds[0] == pytest.approx(max(own, delta))


def test_two_runs_are_tested_by_the_paired_t_test():
    rng = np.random.default_rng(2)
    x, y = rng.gamma(2, 100, size=(2, 1, 50))
    p = resolution(crossed([x, y], bounds=(0.0, 5000.0)))[0, 1]
    assert p == pytest.approx(stats.ttest_rel(x[0], y[0]).pvalue)


def test_many_tables_at_once_are_as_one_by_one():
    rng = np.random.default_rng(5)
    worlds = [of_rate(0.9, 0.5), of_rate(0.98, 2.0), of_rate(0.6, 0.3, 0.3)]
    success, steps = drawn(worlds, [3, 1, 5], rng.normal(size=(7, 40)), rng)
    success[0][0] = 1.0
    success[1][1] = 1.0
    for values, rate, ends in ((success, True, (0, 1)), (steps, False, (1.0, 1000.0))):
        batch = tables.crossed(values, rate=rate, least=ends[0], most=ends[1])
        p = resolution(batch)
        for t in range(7):
            one = crossed([x[t] for x in values], rate=rate, bounds=ends)
            for name in ("mean", "between_seeds", "residual", "between_scenarios", "between_odds"):
                assert getattr(batch, name)[t] == pytest.approx(getattr(one, name), rel=1e-9, abs=1e-15), name
            assert p[t] == pytest.approx(resolution(one), rel=1e-6, abs=1e-12)


def test_worlds_have_the_rate_that_is_asked_for():
    world, tails = of_rate(0.9, 2.0), of_rate(0.9, 1.0, tails=3)
    assert world.rate() == pytest.approx(0.9)
    assert shifted(world, 0.05).rate() == pytest.approx(0.85)
    rng = np.random.default_rng(7)
    worlds = [world, tails, World(3.25, 0.5, failing=0.3)]
    data = successes(worlds, [2, 2, 2], rng.normal(size=(1500, 50)), rng)
    for x, world in zip(data, worlds, strict=True):
        rates = x.mean(axis=(1, 2))
        assert abs(rates.mean() - world.rate()) < 4 * rates.std() / np.sqrt(1500)
    assert FAILED == 5.0


TABLES = 150


def allowed(share):
    """The share and three standard errors of so many tables."""
    return share + 3 * np.sqrt(share * (1 - share) / TABLES)


@pytest.mark.parametrize(("S", "most"), [(3, 0.08), (5, 0.05)])
@pytest.mark.parametrize(("rate", "place"), [(0.6, 1), (0.9, 3), (0.98, 4), (0.9, 6), (0.6, 8), (0.9, 9)])
def test_false_letters_are_rare(rate, place, S, most):
    """Agents of equal rate, in the designs that misled other tests."""
    found = letters.false_letters(letters.equal(rate, S)[place], TABLES, seed=1)
    assert found[USED] <= allowed(most)


@pytest.mark.slow
def test_other_rules_err_more_often():
    design = letters.equal(0.98, 10)[3]
    names = ("own variances", "table's median", "table's robust prior")
    found = letters.false_letters(design, TABLES, (*names, USED), seed=2)
    assert found[USED] <= allowed(0.05)
    assert min(found[name] for name in names) > found[USED] + 0.03


def test_a_wild_row_hides_no_difference_of_others():
    """90 against 95 % in a table of six, of which one has trainings 2.5 logits apart."""
    found = letters.power(letters.close(), 100, ("table's mean (before)", USED))
    assert found[USED] > 0.6
    assert found["table's mean (before)"] < 0.2


def test_differences_are_still_found():
    """Twelve agents of five seeds, rates 40 to 97 %: close to half of the differences over 20 points."""
    found = letters.power(letters.spread(12, 5)[0], 40, ("own variances", USED))
    assert found[USED] > 0.4
    assert found[USED] > found["own variances"]


def test_penalised_steps_keep_their_level_too():
    found = letters.false_letters(letters.equal(0.6, 3)[1], TABLES, steps=True)
    assert found[USED] <= allowed(0.08)


def test_trainings_that_fail_now_and_then_make_learners_look_better():
    """Why a verdict against a controller speaks of trainings like these."""
    learners, both, _ = letters.failing(0.98, 0.1, 10)
    assert letters.false_letters(learners, 50)[USED] <= 0.05
    assert letters.false_letters(both, 50)[USED] > 0.1


def test_one_seed_is_never_told_apart():
    found = reports.one_seed(40)
    for before, used in found.values():
        assert before > 0.4
        assert used <= 0.1
    assert found["8 of one seed"][1] == 0


def test_verdicts_against_a_baseline_are_rarely_false():
    same, fixed = of_rate(0.95, 0.3), of_rate(0.95, 0.0)
    alike = reports.against_baseline([fixed, same, same], 5, 60)
    apart = reports.against_baseline([fixed, shifted(same, 0.05), shifted(same, 0.05)], 5, 60)
    assert alike["ahead"] + alike["behind"] <= 0.05 + 3 * 0.028
    assert apart["equivalent"] <= 0.05 + 3 * 0.028
    assert alike["equivalent"] > 0.3


def test_every_alternative_gives_p_values():
    design = letters.equal(0.9, 3)[0]
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
