"""Bounds of group-sequential tests, against published tables and a simulation."""

from __future__ import annotations

import doctest

import numpy as np
import pytest
from scipy.special import ndtri

from auvbench.statistics import sequential
from auvbench.statistics.sequential import crossing, levels

# Jennison & Turnbull (2000), Group Sequential Methods, tables 2.1 and 2.3, alpha 0.05: constants for K looks.
POCOCK = {2: 2.178, 3: 2.289, 4: 2.361, 5: 2.413, 10: 2.555}
OBRIEN_FLEMING = {2: 1.977, 3: 2.004, 4: 2.024, 5: 2.040, 10: 2.087}


def test_examples() -> None:
    assert doctest.testmod(sequential).failed == 0


@pytest.mark.parametrize(("shape", "table"), [("pocock", POCOCK), ("obrien-fleming", OBRIEN_FLEMING)])
def test_the_published_constants(shape: str, table: dict[int, float]) -> None:
    for looks, constant in table.items():
        p = levels([(k + 1) / looks for k in range(looks)], 0.05, shape)
        assert -ndtri(p[-1] / 2) == pytest.approx(constant, abs=6e-4)


def test_one_look_is_an_ordinary_test() -> None:
    assert levels([1.0], 0.05) == pytest.approx([0.05], abs=1e-12)
    assert crossing([1.0], np.array([1.959964])) == pytest.approx(0.05, abs=1e-6)


@pytest.mark.parametrize("shape", sequential.SHAPES)
def test_unequal_looks_err_as_often_as_promised(shape: str) -> None:
    fractions = np.array([0.2, 0.7, 1.0])
    bounds = -ndtri(levels(fractions, 0.1, shape) / 2)
    rng = np.random.default_rng(5)
    steps = rng.normal(size=(400_000, 3)) * np.sqrt(np.diff(fractions, prepend=0.0))
    z = np.abs(steps.cumsum(axis=1)) / np.sqrt(fractions)
    assert (z > bounds).any(axis=1).mean() == pytest.approx(0.1, abs=0.002)


@pytest.mark.parametrize("fractions", [[], [0.5], [0.5, 0.5, 1.0], [0.0, 1.0]])
def test_fractions_that_are_none(fractions: list[float]) -> None:
    with pytest.raises(ValueError, match="rising fractions"):
        levels(fractions)
