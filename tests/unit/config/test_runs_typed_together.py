"""Runs that differ in seed, name and folder alone are typed once, and each as by itself."""

from __future__ import annotations

from typing import Any

import pytest
from omegaconf import OmegaConf

from auvbench.config.compose import compose, once_for_all_seeds, typed, with_own
from auvbench.config.schema import TrainConfig
from auvbench.config.validate import resolved
from auvbench.errors import ConfigError

WORDS = (
    [],
    ["seed=7"],
    ["seed=7", "name=other", "output=elsewhere"],
    ["reward.k=40"],
    ["seed=7", "reward.k=40"],
)


def values(*words: str) -> dict[str, Any]:
    return resolved(compose("train", ["algo=pid", *words]))


def test_each_is_what_it_is_by_itself() -> None:
    made: list[str] = []

    def read(plain: dict[str, Any]) -> TrainConfig:
        def make() -> TrainConfig:
            made.append(f"{plain['reward']['k']}")
            return typed(OmegaConf.create(plain))

        return with_own(once_for_all_seeds("here", plain, make), plain)

    for words in WORDS:
        plain = values(*words)
        assert read(plain) == typed(OmegaConf.create(plain)), words
    assert made == ["1.0", "40.0"]


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("seed", -1, "seed=-1: must be at least 0"),
        ("seed", "7", "seed=7: must be a whole number"),
        ("seed", True, "seed=True: must be a whole number"),
        ("seed", None, "seed=None: must be a whole number"),
        ("name", "../there", "name='../there': must be a plain name"),
        ("output", 3, "output=3: must be text"),
    ],
)
def test_a_wrong_one_is_refused(key: str, value: object, said: str) -> None:
    config = typed(OmegaConf.create(values()))
    with pytest.raises(ConfigError) as error:
        with_own(config, values() | {key: value})
    assert str(error.value).startswith(said)
