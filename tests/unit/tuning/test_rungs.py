"""Who goes on."""

import random

import pytest

from auvbench.tuning.rungs import FAILED, Ladder, Progress, order


def simulate(ladder, values, seed=0, at_once=1):
    """Runs a study whose trial n shows values[n] at every rung; returns the trials."""
    trials, waiting = [], []
    generator = random.Random(seed)
    while True:
        number = ladder.promotion(trials) if len(waiting) < at_once else None
        if number is not None:
            trials[number].target += 1
            waiting.append(trials[number])
        elif len(trials) < len(values) and len(waiting) < at_once:
            first = ladder.first(len(trials))
            trials.append(Progress(len(trials), first, first))
            waiting.append(trials[-1])
        elif waiting:
            trial = waiting.pop(generator.randrange(len(waiting)))
            trial.scores[trial.target] = values[trial.number]
        elif (last := ladder.last_resort(trials)) is not None:
            trials[last].target += 1
            waiting.append(trials[last])
        else:
            return trials


@pytest.mark.parametrize("at_once", [1, 4])
def test_halving_lets_one_in_three_through_and_the_best_to_the_top(at_once):
    values = random.Random(3).sample(range(1000), 60)
    trials = simulate(Ladder((1, 3, 9), "halving", 3), values, at_once=at_once)
    reached = [sum(rung in t.scores for t in trials) for rung in range(3)]
    assert reached[0] == 60
    assert 20 <= reached[1] <= 30
    assert reached[2] < reached[1]
    assert order(trials)[0] == values.index(max(values))


def test_a_trial_that_waits_goes_on_when_those_after_it_are_worse():
    ladder = Ladder((1, 3), "halving", 2)
    trials = [Progress(0, 0, 0, {0: 0.5}), Progress(1, 0, 0, {0: 0.9}), Progress(2, 0, 0, {0: 0.1})]
    assert ladder.promotion(trials) == 1
    trials[1].target = 1
    assert ladder.promotion(trials) is None
    trials.append(Progress(3, 0, 0, {0: 0.2}))
    assert ladder.promotion(trials) == 0


def test_what_failed_counts_as_the_worst_and_never_goes_on():
    ladder = Ladder((1, 3), "halving", 2)
    trials = [Progress(0, 0, 0, {0: FAILED}, closed=True), Progress(1, 0, 0, {0: 0.1})]
    assert ladder.promotion(trials) == 1
    assert order(trials) == [1]
    assert ladder.promotion([Progress(n, 0, 0, {0: FAILED}, closed=True) for n in range(6)]) is None


def test_median_drops_what_is_worse_than_the_median():
    values = list(range(40))
    trials = simulate(Ladder((1, 3), "median"), values)
    top = {t.number for t in trials if 1 in t.scores}
    assert top >= set(range(20, 40))
    # Rising values are each better than the median so far; falling ones are not.
    fallen = simulate(Ladder((1, 3), "median"), values[::-1])
    assert sum(1 in t.scores for t in fallen) <= 24


def test_none_trains_everything_at_once_for_the_whole_budget():
    trials = simulate(Ladder((1, 3, 9), "none"), [3, 1, 2])
    assert [set(t.scores) for t in trials] == [{2}, {2}, {2}]


def test_hyperband_shares_trials_between_brackets():
    ladder = Ladder((1, 3, 9), "hyperband", 3)
    firsts = [ladder.first(number) for number in range(1800)]
    shares = [firsts.count(rung) / 1800 for rung in range(3)]
    assert shares == pytest.approx([9 / 18, 6 / 18, 3 / 18], abs=0.01)
    trials = simulate(ladder, random.Random(1).sample(range(100), 40))
    assert order(trials)


def test_too_few_trials_for_the_rule_still_bring_one_to_the_end():
    trials = simulate(Ladder((1, 3, 9), "halving", 3), [1, 2])
    assert sum(2 in t.scores for t in trials) == 1
