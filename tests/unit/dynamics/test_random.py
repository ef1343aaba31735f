"""Philox4x32-10 against the known-answer vectors of Random123, and what the draws look like."""

import numpy as np
import pytest
from numba import njit
from scipy import stats

from auvbench.dynamics import random

ONES = 0xFFFFFFFF
KNOWN_ANSWERS = [
    ((0, 0), (0, 0, 0, 0), "6627e8d5 e169c58d bc57ac4c 9b00dbd8"),
    ((ONES, ONES), (ONES, ONES, ONES, ONES), "408f276d 41c83b0e a20bc7c6 6d5451fd"),
    (
        (0xA4093822, 0x299F31D0),
        (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
        "d16cfe09 94fdcceb 5001e420 24126ea1",
    ),
]


@pytest.mark.parametrize(("key", "counter", "expected"), KNOWN_ANSWERS)
def test_known_answers(key, counter, expected):
    assert " ".join(f"{int(word):08x}" for word in random.words(*key, *counter)) == expected


@njit
def _draw(seed, stream, count, normal):
    out = np.empty(count)
    for i in range(count):
        if normal:
            out[i] = random.normal4(seed, stream, i % 7, i // 7, 3, 5)[i % 4]
        else:
            out[i] = random.uniform(seed, stream, i % 7, i // 7, 3, 5)
    return out


@pytest.mark.slow
def test_distributions():
    assert stats.kstest(_draw(1, random.SENSOR, 20_000, False), "uniform").pvalue > 1e-3
    assert stats.kstest(_draw(1, random.SENSOR, 20_000, True), "norm").pvalue > 1e-3


def test_streams_and_seeds_differ():
    a = _draw(1, random.SENSOR, 2000, False)
    for other in (_draw(2, random.SENSOR, 2000, False), _draw(1, random.SENSOR | random.TEST, 2000, False)):
        assert abs(np.corrcoef(a, other)[0, 1]) < 0.1
        assert not np.any(a == other)


def test_a_channel_is_an_entry_of_its_block():
    block = random.uniform4(7, random.FAULT, 2, 11, 12, 13)
    for entry in range(4):
        assert random.uniform(7, random.FAULT, 8 + entry, 11, 12, 13) == block[entry]


def test_largest_seed_is_accepted_from_python_and_from_arrays():
    from_python = random.uniform4(ONES, random.SCENARIO, 0, 0, 0, 0)
    from_array = random.uniform4(np.array([ONES], dtype=np.uint32)[0], random.SCENARIO, 0, 0, 0, 0)
    assert from_python == from_array
    assert min(from_python) > 0.0
    assert max(from_python) < 1.0
