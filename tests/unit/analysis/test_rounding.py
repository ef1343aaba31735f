import doctest
import math

import pytest

from auvbench.analysis import formatting as rounding
from auvbench.analysis import labels
from auvbench.analysis.formatting import rounded
from auvbench.statistics.intervals import Estimate


@pytest.mark.parametrize(
    "module",
    ["analysis.formatting", "analysis.labels", "reporting.tables.text_formats"],
)
def test_examples_of_the_docstrings(module: str) -> None:
    import importlib

    result = doctest.testmod(importlib.import_module(f"auvbench.{module}"))
    assert result.attempted > 0
    assert result.failed == 0


@pytest.mark.parametrize(
    ("value", "low", "high", "scale", "expected"),
    [
        (0.9781, 0.964, 0.9889, 100.0, ("97.8", "96.4", "98.9")),
        (282.19, 275.2, 290.4, 1.0, ("282.2", "275.2", "290.4")),
        (10320.23, 9971.0, 10688.0, 1.0, ("10320", "9970", "10690")),
        (2.618003, 2.61, 2.62, 1.0, ("2.6180", "2.6100", "2.6200")),
        (1.0, 0.9924, 1.0, 100.0, ("100.00", "99.24", "100.00")),
        (0.0, 0.0, 0.0076, 100.0, ("0.00", "0.00", "0.76")),
        (-0.0004, -0.03, 0.03, 1.0, ("0.000", "-0.030", "0.030")),
        (41.98765, 41.98765, 41.98765, 1.0, ("41.99", "", "")),
        (3.0, math.nan, math.nan, 1.0, ("3.000", "", "")),
        (310.4, 1.0, 723.0, 1.0, ("310", "0", "720")),  # cut below at 1: as if it were [-102, 723]
        (2.91, 0.0, 7.84, 1.0, ("2.9", "0.0", "7.8")),
        (604.0, 1.0, 1000.0, 1.0, ("600", "0", "1000")),
        (math.nan, math.nan, math.nan, 1.0, ("–", "", "")),
    ],
)
def test_the_interval_decides_the_decimals(
    value: float, low: float, high: float, scale: float, expected: tuple[str, str, str]
) -> None:
    assert rounded(Estimate(value, low, high), scale) == expected


@pytest.mark.parametrize("half", [9.99, 0.0996, 99.6, 1.0, 0.995, 1e-9, 5e7])
def test_an_uncertainty_keeps_two_significant_digits(half: float) -> None:
    text = rounding.fixed(half, rounding.decimals(half))
    digits = text.replace(".", "").strip("0") or "0"
    assert len(digits) <= 2
    assert float(text) == pytest.approx(half, rel=0.05)


def test_labels_stay_unique() -> None:
    keys = [{"algo": "ppo", "seed": seed, "reward.k": 1.0} for seed in (0, 1)]
    assert labels.labels(keys, [True, True]) == ["PPO seed 0", "PPO seed 1"]
    keys = [{"reward.k": None}, {"reward.k": 1.0}]
    assert len(set(labels.labels(keys, [True, True]))) == 2
