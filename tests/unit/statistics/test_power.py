"""Planning: what is drawn has the truth it claims, spreads are found again, and the seeds named are enough."""

from __future__ import annotations

import math

import numpy as np
import pytest

from auvbench.analysis.planning import needs
from auvbench.statistics import power as pw

RNG = np.random.default_rng


@pytest.mark.slow
def test_the_typical_training_has_the_rate_that_was_asked_for() -> None:
    found = pw.Rates(0.8, 1.3).draw([0.6, 0.95], 2000, 2000, RNG(0))
    assert [np.median(x.mean(axis=1)) for x in found] == pytest.approx([0.6, 0.95], abs=0.02)
    controller, _ = pw.Rates(0.8, 1.3).draw([0.6, 0.95], 5, 100_000, RNG(0), (True, False))
    assert controller.shape == (1, 100_000)
    assert controller.mean() == pytest.approx(0.6, abs=0.01)
    # A seed's rate over all scenarios is logit-normal with the sd that was asked for.
    x = pw.Rates(0.8, 1.3).draw([0.7], 2000, 4000, RNG(1))[0]
    rates = x.mean(axis=1)
    assert np.log(rates / (1 - rates)).std() == pytest.approx(0.8, rel=0.08)
    assert len(found) == 2
    assert set(np.unique(found[0])) == {0.0, 1.0}


def test_the_spread_of_trainings_is_found_again() -> None:
    model = pw.Rates(0.6, 1.0)
    data = [x for i in range(150) for x in model.draw([0.9, 0.7], 3, 500, RNG(i))]
    seeds, scenarios = pw.spread_of_rates(data)
    assert seeds.sd == pytest.approx(0.6, abs=0.06)
    assert seeds.df == 600
    assert scenarios == pytest.approx(1.0, abs=0.1)
    equal, _ = pw.spread_of_rates(
        [x for i in range(100) for x in pw.Rates(0.0, 0.5).draw([0.8], 5, 500, RNG(i))]
    )
    assert equal.sd < 0.1


def test_an_agent_that_never_fails_does_not_hide_how_much_another_s_trainings_differ() -> None:
    alike = np.ones((5, 500))
    spread = np.zeros((5, 500))
    for row, successes in zip(spread, (491, 487, 452, 491, 497), strict=True):
        row[:successes] = 1.0
    alone, _ = pw.spread_of_rates([spread])
    both, _ = pw.spread_of_rates([spread, alike])
    assert alone.sd > 0.6
    assert both.sd > 0.4
    assert both.upper() > both.sd
    # No spread to be seen is not known to be none.
    none, _ = pw.spread_of_rates([np.tile(np.arange(500) < 450, (5, 1)).astype(float) for _ in range(2)])
    assert none.sd == 0.0
    drawn, _ = pw.spread_of_rates(pw.Rates(0.0, 0.5).draw([0.8, 0.9], 5, 500, RNG(3)))
    assert drawn.upper() > 0.0


def test_the_limit_of_the_spread_holds_where_episodes_are_drawn() -> None:
    found = [pw.spread_of_rates(pw.Rates(0.6).draw([0.7, 0.9], 5, 500, RNG(i)))[0] for i in range(200)]
    assert 0.85 <= np.mean([one.upper(0.9) > 0.6 for one in found]) <= 0.96


def test_the_spread_of_means_is_found_again() -> None:
    model = pw.Means(20.0, 50.0, 80.0)
    data = [x for i in range(150) for x in model.draw([300.0], 4, 200, RNG(i))]
    seeds, scenarios, rest = pw.spread_of_means(data)
    assert (seeds.sd, scenarios, rest) == (
        pytest.approx(20, rel=0.1),
        pytest.approx(50, rel=0.05),
        pytest.approx(80, rel=0.02),
    )


def test_the_limit_of_a_spread_holds_as_often_as_it_says() -> None:
    rng = RNG(3)
    df = 8
    drawn = np.sqrt(rng.chisquare(df, 4000) / df)
    held = np.mean([pw.SeedSpread(float(sd), df).upper(0.9) > 1.0 for sd in drawn])
    assert held == pytest.approx(0.9, abs=0.015)


def test_one_seed_says_nothing_of_the_spread() -> None:
    with pytest.raises(ValueError, match="several seeds"):
        pw.spread_of_rates([np.ones((1, 10))])
    with pytest.raises(ValueError, match="several seeds"):
        pw.spread_of_means([np.ones((1, 10))])


@pytest.mark.slow
@pytest.mark.parametrize("controller", [True, False])
def test_the_seeds_named_have_the_power_asked_for_on_other_draws(controller: bool) -> None:
    model, values = pw.Rates(0.5), (0.9, 0.95)

    def at(S: int, seed: int = 0, replications: int = 200) -> float:
        found = pw.simulated_power(
            model,
            values,
            S,
            300,
            [0.05],
            against_controller=controller,
            replications=replications,
            seed=seed,
        )
        return float(found[0])

    S = pw.seeds_needed(at, 0.8)
    assert S is not None
    assert 7 <= S <= 30
    assert at(S, seed=99, replications=600) == pytest.approx(0.8, abs=0.08)
    assert pw.seeds_needed(lambda S: 0.1, 0.8, most=20) is None


def test_no_difference_is_found_as_rarely_as_alpha_says() -> None:
    found = pw.simulated_power(pw.Rates(0.5), (0.9, 0.9 + 1e-9), 8, 300, [0.05, 0.01], replications=200)
    assert found[1] <= found[0] < 0.07
    assert pw.simulated_power(pw.Rates(0.5), (0.5, 0.95), 4, 100, [0.05], replications=5)[0] == 0.0


def test_more_trainings_decide_an_open_row() -> None:
    rng = RNG(0)
    gains, baseline = 0.5 + rng.normal(size=12), np.zeros(1)

    def needed(error: float, margin: float = math.nan) -> int | None:
        return pw.trainings_that_decide(gains, baseline, error, 2.6, 0.01, margin, power=0.8, above=12)

    few = needed(0.01)
    assert few is not None
    assert few > 12
    assert (needed(0.1) or 1000) >= few
    assert needed(5.0) is None, "more trainings do not remove the error of the scenarios"
    assert (needed(0.01, margin=50.0) or 0) == 13, "all within the margin"


@pytest.mark.slow
def test_a_table_of_several_needs_more() -> None:
    need = needs(pw.Rates(0.5), (0.8, 0.95), 200, agents=12, targets=(0.8,), replications=100)
    assert need.among[0.8] > need.alone[0.8]
