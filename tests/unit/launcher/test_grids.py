"""Which jobs a grid has: products, unions, and what a command line makes of them."""

from __future__ import annotations

from typing import Any

import pytest
from hydra.core.override_parser.overrides_parser import OverridesParser

from auvbench.config import grids
from auvbench.errors import ConfigError

STUDY = [{"algo": "sac,ppo", "reward.k": "1,40,100", "seed": "range(0,2)"}, {"algo": "pid", "seed": [0]}]


@pytest.fixture
def parser() -> OverridesParser:
    return OverridesParser.create()


def jobs(parser: OverridesParser, union: Any, *typed: str) -> list[str]:
    narrowed = grids.narrow(grids.from_config(parser, union), grids.axes(parser, typed))
    return [" ".join(job) for job in grids.jobs(narrowed)]


def test_a_product_varies_its_last_axis_fastest(parser: OverridesParser) -> None:
    assert jobs(parser, [], "algo=sac,ppo", "seed=0,1") == [
        "algo=sac seed=0",
        "algo=sac seed=1",
        "algo=ppo seed=0",
        "algo=ppo seed=1",
    ]


def test_without_axes_there_is_one_job(parser: OverridesParser) -> None:
    assert jobs(parser, [], "algo=sac") == ["algo=sac"]
    assert jobs(parser, []) == [""]


def test_an_experiment_is_the_union_of_its_grids(parser: OverridesParser) -> None:
    found = jobs(parser, STUDY)
    assert len(found) == 2 * 3 * 2 + 1
    assert found[0] == "algo=sac reward.k=1 seed=0"
    assert found[-1] == "algo=pid seed=0"


def test_a_known_value_restricts_and_drops(parser: OverridesParser) -> None:
    assert jobs(parser, STUDY, "algo=pid") == ["algo=pid seed=0"]
    assert jobs(parser, STUDY, "algo=ppo", "seed=0") == [
        f"algo=ppo reward.k={k} seed=0" for k in (1, 40, 100)
    ]
    assert jobs(parser, STUDY, "seed=1", "reward.k=40") == [
        "algo=sac reward.k=40 seed=1",
        "algo=ppo reward.k=40 seed=1",
    ]


def test_a_grid_that_does_not_vary_the_key_stays_as_it_is(parser: OverridesParser) -> None:
    found = jobs(parser, STUDY, "reward.k=40", "seed=0")
    assert found == ["algo=sac reward.k=40 seed=0", "algo=ppo reward.k=40 seed=0", "algo=pid seed=0"]


def test_an_unknown_value_replaces_the_axis(parser: OverridesParser) -> None:
    found = jobs(parser, STUDY, "seed=7", "reward.k=2")
    assert found == ["algo=sac reward.k=2 seed=7", "algo=ppo reward.k=2 seed=7", "algo=pid seed=7"]


def test_known_and_unknown_values_together(parser: OverridesParser) -> None:
    found = jobs(parser, STUDY, "algo=ppo", "reward.k=100,7", "seed=0")
    assert found == ["algo=ppo reward.k=100 seed=0", "algo=ppo reward.k=7 seed=0"]


def test_a_key_that_no_grid_varies_applies_to_all(parser: OverridesParser) -> None:
    found = jobs(parser, STUDY, "seed=0", "reward.k=1", "step.frequency=10,25")
    assert found == [
        f"algo={algo}{k} seed=0 step.frequency={frequency}"
        for algo, k in (("sac", " reward.k=1"), ("ppo", " reward.k=1"), ("pid", ""))
        for frequency in (10, 25)
    ]


def test_values_are_compared_as_values(parser: OverridesParser) -> None:
    assert jobs(parser, STUDY, "algo='ppo'", "reward.k=1.0", "seed=0") == ["algo=ppo reward.k=1 seed=0"]


def test_the_last_of_a_repeated_key_counts(parser: OverridesParser) -> None:
    assert jobs(parser, [], "seed=1,2", "algo=sac", "seed=3") == ["algo=sac seed=3"]


def test_equal_jobs_of_two_grids_are_one(parser: OverridesParser) -> None:
    assert jobs(parser, [{"algo": "sac,ppo"}, {"algo": "ppo"}]) == ["algo=sac", "algo=ppo"]


def test_yaml_values_of_every_kind(parser: OverridesParser) -> None:
    union = [{"a": [1, 2.5], "b": True, "c": None, "d": "choice(x,y)", "e": "[1,2],[3]"}]
    found = jobs(parser, union)
    assert found[0] == "a=1 b=True c=null d=x e=[1,2]"
    assert found[-1] == "a=2.5 b=True c=null d=y e=[3]"


def test_additions_and_deletions_keep_their_signs(parser: OverridesParser) -> None:
    assert jobs(parser, [], "+extra=1,2", "~noise") == ["+extra=1 ~noise", "+extra=2 ~noise"]


def test_nothing_may_remain(parser: OverridesParser) -> None:
    assert jobs(parser, STUDY, "algo=pid", "seed=1") == []


@pytest.mark.parametrize("wrong", ["algo", {"algo": "sac"}, ["algo=sac"], [3]])
def test_grids_of_another_shape_are_refused(parser: OverridesParser, wrong: Any) -> None:
    with pytest.raises(ConfigError, match=r"hydra\.sweeper\.grids"):
        grids.from_config(parser, wrong)


def test_only_lists_of_values_make_an_axis(parser: OverridesParser) -> None:
    with pytest.raises(ConfigError, match="interval"):
        grids.axes(parser, ["reward.k=interval(0,1)"])


def test_a_grid_without_an_end_is_refused(parser: OverridesParser) -> None:
    with pytest.raises(
        ConfigError, match=r"launcher\.name=range\(0,1e9\): has more values than the 10,000 runs"
    ):
        grids.axes(parser, ["launcher.name=range(0,1e9)"])
    with pytest.raises(ConfigError, match="the grid has 1,000,000 runs, must be at most 10,000"):
        jobs(parser, [], "seed=range(0,1000)", "reward.k=range(0,1000)")
