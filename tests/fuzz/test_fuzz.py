"""A few examples of each target, the same ones each time; `make fuzz` runs them for long."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings

from tests.fuzz import targets
from tests.fuzz.harness import nothing_long

EXAMPLES = settings(
    max_examples=6,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=list(HealthCheck),
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fuzz")


@pytest.mark.slow
def test_command_lines(folder: Path) -> None:
    targets.keys()

    @EXAMPLES
    @given(targets.overrides(), targets.wholes())
    def one(words: list[str], choice: int) -> None:
        targets.command_line(folder, words, choice)

    with nothing_long(folder):
        one()


@pytest.mark.slow
@pytest.mark.parametrize("name", targets.FILES)
def test_files(name: str, folder: Path) -> None:
    targets.fresh(folder)

    @EXAMPLES
    @given(targets.wholes(), targets.values(), targets.wholes(), targets.wholes())
    def one(where: int, value: Any, how: int, seed: int) -> None:
        targets.FILES[name](folder, where, value, how, seed)

    with nothing_long(folder):
        one()
