"""Proposals are a function of the seed, the number and the history."""

import pytest

from auvbench.errors import ConfigError, MissingExtraError
from auvbench.tuning import samplers
from auvbench.tuning.rungs import FAILED, Progress
from auvbench.tuning.samplers import Sampler
from auvbench.tuning.space import Dimension

DIMENSIONS = (
    Dimension("algo.a", "", "float", 0.0, 1.0),
    Dimension("algo.b", "", "float", 1e-4, 1e-1, log=True),
    Dimension("algo.c", "", "int", 1, 20),
    Dimension("algo.d", "", "choice", choices=("x", "y", "z"), values=("x", "y", "z")),
)


def value(params):
    return -abs(params["algo.a"] - 0.7) - abs(params["algo.c"] - 12) / 20 - (params["algo.d"] != "y") * 0.3


def study(name, trials, seed=1):
    sampler = Sampler(name, seed, 5, DIMENSIONS, (10, 30))
    params, progress = [], []
    for number in range(trials):
        params.append(sampler.propose(params, progress))
        worth = value(params[-1])
        scores = {0: FAILED} if number == 3 else {0: worth, 1: worth} if number % 3 == 0 else {0: worth}
        progress.append(Progress(number, 0, max(scores), scores, closed=number == 3))
    return sampler, params, progress


@pytest.mark.parametrize("name", ["tpe", "random", "cmaes", "gp"])
def test_a_proposal_does_not_depend_on_what_the_process_did_before(name):
    sampler, params, progress = study(name, 10)
    again = Sampler(name, 1, 5, DIMENSIONS, (10, 30))
    assert again.propose(params, progress) == sampler.propose(params, progress)
    assert again.propose(params[:9], progress[:9]) == params[9]
    assert Sampler(name, 2, 5, DIMENSIONS, (10, 30)).propose(params, progress) != again.propose(
        params, progress
    )


@pytest.mark.parametrize("name", ["tpe", "random", "cmaes", "gp"])
def test_proposals_lie_in_the_space(name):
    _, params, _ = study(name, 8)
    for values in params:
        assert list(values) == [d.key for d in DIMENSIONS]
        assert 0 <= values["algo.a"] <= 1
        assert 1e-4 <= values["algo.b"] <= 1e-1
        assert values["algo.c"] in range(1, 21)
        assert type(values["algo.c"]) is int
        assert values["algo.d"] in ("x", "y", "z")


@pytest.mark.parametrize("name", ["tpe", "cmaes"])
def test_a_sampler_that_learns_beats_chance(name):
    def mean_of_the_last(name):
        sampler = Sampler(name, 1, 5, DIMENSIONS, (10,))
        params, progress = [], []
        for number in range(60):
            params.append(sampler.propose(params, progress))
            progress.append(Progress(number, 0, 0, {0: value(params[-1])}, closed=True))
        return sum(value(values) for values in params[30:]) / 30

    assert mean_of_the_last(name) > mean_of_the_last("random") + 0.1


def test_a_grid_meets_every_point_once():
    dimensions = (
        Dimension("algo.a", "", "float", 0.0, 1.0, step=0.5),
        Dimension("algo.d", "", "choice", choices=("x", "y"), values=("x", "y")),
    )
    assert samplers.check("grid", dimensions) == 6
    sampler = Sampler("grid", 0, 5, dimensions, (10,))
    found = [tuple(sampler.propose([], [Progress(i, 0, 0) for i in range(n)]).values()) for n in range(6)]
    assert sorted(found) == [(a, d) for a in (0.0, 0.5, 1.0) for d in ("x", "y")]


def test_cmaes_needs_two_numbers_and_its_package(monkeypatch):
    with pytest.raises(ConfigError, match="two ranges"):
        samplers.check("cmaes", DIMENSIONS[3:])
    monkeypatch.setitem(__import__("sys").modules, "cmaes", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'auvbench\[cmaes\]'"):
        samplers.check("cmaes", DIMENSIONS)
