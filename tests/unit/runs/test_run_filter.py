"""`--where`: which runs."""

from __future__ import annotations

import doctest
from typing import Any

import pytest

from auvbench.errors import UserError
from auvbench.runs import run_filter

RUNS: list[dict[str, Any]] = [
    {"vehicle.name": "rexrov", "reward.k": 1.0, "algo.name": "ppo", "seed": 0, "algo.net_arch": [64, 64]},
    {"vehicle.name": "bluerov2", "reward.k": 40, "algo.name": "sac", "seed": 1, "algo.tau": 0.005},
    {"vehicle.name": "bluerov2", "reward.k": 100.0, "algo.name": "pid", "seed": 0, "train.progress": True},
]


def select(*terms: str) -> list[int]:
    return [RUNS.index(run) for run in run_filter.select(RUNS, run_filter.parse(terms), lambda run: run)]


def test_the_examples_in_the_documentation() -> None:
    assert doctest.testmod(run_filter).failed == 0


@pytest.mark.parametrize(
    ("terms", "kept"),
    [
        ((), [0, 1, 2]),
        (("vehicle=rexrov",), [0]),
        (("reward.k=1,40",), [0, 1]),
        (("reward.k=1.0",), [0]),
        (("vehicle=bluerov2", "reward.k=40"), [1]),
        (("algo!=pid",), [0, 1]),
        (("algo=p*",), [0, 2]),
        (("algo.tau=5e-3",), [1]),
        (("train.progress=true",), [2]),
        (("algo.net_arch=[64, 64]",), [0]),
    ],
)
def test_terms(terms: tuple[str, ...], kept: list[int]) -> None:
    assert select(*terms) == kept


@pytest.mark.parametrize(
    ("terms", "message"),
    [
        (("vehicl=rexrov",), "no run has the key 'vehicl'; did you mean vehicle.name"),
        (("k=40",), "no run has the key 'k'; did you mean reward.k"),
        (("zzz=1",), "no run has the key 'zzz'; auvbench runs --json"),
        (("vehicle=rexrv",), "no run has vehicle.name=rexrv; did you mean 'rexrov'"),
        (("reward.k=1,7",), "no run has reward.k=7; .*valid: 1, 100, 40"),
        (("vehicle=rexrov", "seed=1"), "matches none of the 3 runs"),
        (("reward.k",), "must be KEY=VALUE"),
        (("reward.k=",), "must be KEY=VALUE"),
        (("=3",), "must be KEY=VALUE"),
    ],
)
def test_mistakes_name_what_there_is(terms: tuple[str, ...], message: str) -> None:
    with pytest.raises(UserError, match=message) as caught:
        select(*terms)
    assert "\n" not in str(caught.value)
