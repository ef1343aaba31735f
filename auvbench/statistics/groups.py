"""Compact letter display: which agents are not resolved from which."""

from __future__ import annotations

import string

import numpy as np
from numpy.typing import NDArray

_SINGLE = string.ascii_lowercase + string.ascii_uppercase


def letter(index: int) -> str:
    """Name of the group number `index`: a to z, A to Z, then a1, b1, ...

    >>> letter(0), letter(26), letter(52)
    ('a', 'A', 'a1')
    """
    turn, place = divmod(index, len(_SINGLE))
    return _SINGLE[place] + (str(turn) if turn else "")


def letters(resolved: NDArray[np.bool_]) -> list[str]:
    """Letters of n agents, best first, from the symmetric matrix (n, n) of which pairs are resolved.

    Two agents share a letter if and only if they are not resolved, overlapping groups included (which
    underlines below a ranking cannot express). A display is a cover of the graph of unresolved pairs by cliques:
    Piepho (2004, J. Comput. Graph. Stat. 13:456), Gramm et al. (2007, Comput. Stat. Data Anal. 52:725). Here
    each pair that no group holds yet, in ranking order, is grown to a maximal clique; groups that the others make
    needless are dropped. Few letters, though not always the fewest: that problem is NP-hard.
    """
    n = len(resolved)
    # Sets of agents are bits of an integer: growing a group is a few machine words per step.
    together = ~resolved & ~np.eye(n, dtype=bool)
    near = [int.from_bytes(np.packbits(row, bitorder="little").tobytes(), "little") for row in together]
    covered = np.zeros((n, n), dtype=bool)
    groups: list[tuple[int, ...]] = []
    for i in range(n):
        for j in (*_members(near[i]), i):
            # The pair (i, i) comes last: only an agent without any company needs a group of its own.
            if covered[i, j] or (i == j and near[i]):
                continue
            group = {i, j}
            common = near[i] & near[j] if i != j else 0
            while common:
                agent = _nearest(common, i)
                group.add(agent)
                common &= near[agent]
            members = tuple(sorted(group))
            covered[np.ix_(members, members)] = True
            groups.append(members)
    groups = sorted(_without_needless(groups, n))
    names = [""] * n
    for index, members in enumerate(groups):
        name = letter(index)
        for agent in members:
            names[agent] += name
    return names


def _members(bits: int) -> list[int]:
    return [i for i in range(bits.bit_length()) if bits >> i & 1]


def _nearest(bits: int, i: int) -> int:
    """The member closest to i in the ranking, the better one of two; `bits` is not empty and lacks i."""
    above, below = bits >> i, (bits & ((1 << i) - 1)).bit_length() - 1
    next_above = i + (above & -above).bit_length() - 1 if above else None
    if next_above is None or (below >= 0 and i - below <= next_above - i):
        return below
    return next_above


def _without_needless(groups: list[tuple[int, ...]], n: int) -> list[tuple[int, ...]]:
    """The groups without those all of whose pairs lie in others."""
    times = np.zeros((n, n), dtype=np.int64)
    for members in groups:
        times[np.ix_(members, members)] += 1
    kept = []
    for members in groups:
        block = np.ix_(members, members)
        if (times[block] > 1).all():
            times[block] -= 1
        else:
            kept.append(members)
    return kept
