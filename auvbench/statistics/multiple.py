"""Tests of many pairs: McNemar's, Holm's correction, and the letters that say which agents are not resolved."""

from __future__ import annotations

import string

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import bdtr, gammaln

from auvbench.statistics.intervals import FloatArray

_SINGLE = string.ascii_lowercase + string.ascii_uppercase


def mcnemar(b: ArrayLike, c: ArrayLike) -> FloatArray:
    """Return McNemar's two-sided mid-p from the discordant counts b (only the first) and c (only the second).

    Twice the lower tail of Binomial(b + c, 1/2) at min(b, c), less the probability of min(b, c) itself; it keeps its level
    better than the exact test, which is too cautious (Fagerland, Lydersen & Laake 2013, BMC Med. Res. Methodol. 13:91).

    >>> f"{float(mcnemar(1, 7)):.4f}"
    '0.0391'
    """
    b, c = np.asarray(b, dtype=np.float64), np.asarray(c, dtype=np.float64)
    n, k = b + c, np.minimum(b, c)
    point = np.exp(gammaln(n + 1) - gammaln(k + 1) - gammaln(n - k + 1) - n * np.log(2.0))
    return np.asarray(np.where(b == c, 1.0, 2 * bdtr(k, n.astype(np.int64), 0.5) - point))


def discordant(success: FloatArray) -> FloatArray:
    """(agents, agents) scenarios in which the row's agent succeeds and the column's does not; (agents, E) of 0, 1."""
    return np.asarray(success @ (1 - success).T, dtype=np.float64)


def holm(p: ArrayLike) -> FloatArray:
    """Holm's (1979, Scand. J. Stat. 6:65) step-down adjusted p-values; NaN is no test and stays NaN.

    >>> holm([0.01, 0.04, 0.03, 0.005]).tolist()
    [0.03, 0.06, 0.06, 0.02]
    """
    p = np.asarray(p, dtype=np.float64)
    adjusted = np.full_like(p, np.nan)
    there = np.flatnonzero(np.isfinite(p))
    order = there[np.argsort(p[there], kind="stable")]
    factors = np.arange(len(order), 0, -1)
    adjusted[order] = np.minimum(np.maximum.accumulate(factors * p[order]), 1.0)
    return adjusted


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
    together = ~resolved & ~np.eye(n, dtype=bool)
    covered = np.zeros((n, n), dtype=bool)
    groups: list[tuple[int, ...]] = []
    for i in range(n):
        # Only an agent without any company needs a group of its own.
        for j in np.flatnonzero(together[i]).tolist() or [i]:
            if covered[i, j]:
                continue
            group, common = {i, j}, together[i] & together[j]
            while common.any():
                # The one closest to i in the ranking, the better one of two.
                agent = int(min(np.flatnonzero(common), key=lambda k: abs(k - i)))
                group.add(agent)
                common &= together[agent]
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
