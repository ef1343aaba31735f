"""Runs that differ in seed, name and folder alone are typed once, and each as by itself."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from omegaconf import OmegaConf

from auvbench.config.compose import compose, once_for_all_seeds, typed
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


def read(plain: dict[str, Any], what: str, made: list[str]) -> TrainConfig:
    def make() -> TrainConfig:
        made.append(str(plain["reward"]["k"]))
        return typed(OmegaConf.create(plain))

    return once_for_all_seeds(what, plain, make, lambda config, own: replace(config, **own))


def test_each_is_what_it_is_by_itself() -> None:
    made: list[str] = []
    for words in WORDS:
        plain = values(*words)
        assert read(plain, "each", made) == typed(OmegaConf.create(plain)), words
    assert made == ["1.0", "40.0"]


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("seed", -1),
        ("seed", "7"),
        ("seed", 1.5),
        ("seed", True),
        ("seed", None),
        ("seed", [1]),
        ("name", 2024),
        ("name", "../there"),
        ("name", None),
        ("output", 3),
        ("output", "???"),
    ],
)
def test_what_is_edited_by_hand_is_read_as_by_itself(key: str, value: object) -> None:
    def outcome(make: Callable[[], TrainConfig]) -> object:
        try:
            return make()
        except ConfigError as error:
            return str(error)

    plain = values()
    read(plain, "edited", [])
    edited = plain | {key: value}
    alone = outcome(lambda: typed(OmegaConf.create(edited)))
    assert outcome(lambda: read(edited, "edited", [])) == alone
    lacking = {name: entry for name, entry in plain.items() if name != key}
    alone = outcome(lambda: typed(OmegaConf.create(lacking)))
    assert outcome(lambda: read(lacking, "edited", [])) == alone
