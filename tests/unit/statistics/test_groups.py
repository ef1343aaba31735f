"""The compact letter display: right for every pattern of resolved pairs, short for the usual ones."""

import re

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from auvbench.statistics import letter, letters


def symmetric(n, pairs):
    resolved = np.zeros((n, n), dtype=bool)
    for i, j in pairs:
        resolved[i, j] = resolved[j, i] = True
    return resolved


def assert_right(resolved):
    names = [set(re.findall(r"[a-zA-Z]\d*", group)) for group in letters(resolved)]
    for i in range(len(names)):
        assert names[i]
        for j in range(i):
            assert names[i].isdisjoint(names[j]) == resolved[i, j], (i, j, names)


def test_all_the_same_and_all_different():
    assert letters(symmetric(3, [])) == ["a", "a", "a"]
    assert letters(symmetric(3, [(0, 1), (0, 2), (1, 2)])) == ["a", "b", "c"]
    assert letters(symmetric(1, [])) == ["a"]
    assert letters(symmetric(0, [])) == []


def test_overlapping_groups():
    assert letters(symmetric(3, [(0, 2)])) == ["a", "ab", "b"]
    assert letters(symmetric(4, [(0, 2), (0, 3), (1, 3)])) == ["a", "ab", "bc", "c"]


def test_a_pattern_that_no_row_of_underlines_can_show():
    # Best and worst are not resolved (the worst has a wide interval) while both are from the middle.
    assert letters(symmetric(3, [(0, 1), (1, 2)])) == ["a", "b", "a"]


def test_one_precise_agent_among_vague_ones():
    assert_right(symmetric(8, [(0, 6), (0, 7), (1, 3), (1, 4), (1, 5), (1, 6), (1, 7)]))


@given(
    st.integers(1, 9).flatmap(
        lambda n: st.tuples(st.just(n), st.sets(st.tuples(st.integers(0, n - 1), st.integers(0, n - 1))))
    )
)
def test_two_share_a_letter_if_and_only_if_not_resolved(drawn):
    n, pairs = drawn
    assert_right(symmetric(n, {(i, j) for i, j in pairs if i != j}))


def test_many_agents_get_distinct_letters():
    n = 120
    assert len({letter(i) for i in range(3 * 52 + 5)}) == 3 * 52 + 5
    rng = np.random.default_rng(0)
    resolved = rng.random((n, n)) < 0.5
    assert_right(resolved | resolved.T)


def test_groups_of_neighbours_are_as_few_as_can_be():
    n, reach = 60, 4
    resolved = np.abs(np.subtract.outer(np.arange(n), np.arange(n))) > reach
    names = letters(resolved)
    assert len({x for name in names for x in re.findall(r"[a-zA-Z]\d*", name)}) == n - reach
