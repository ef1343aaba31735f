"""As many colours as there are agents, each as far from the others as can be."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000", "#882255")
"""Okabe and Ito (2008) without yellow, which does not show on white; the last from Tol's muted scheme"""

DARKEST, LIGHTEST = 0.38, 0.78
"""OKLab lightness between which a thin line shows its colour: darker looks black, lighter fades on white"""


@cache
def palette(n: int) -> tuple[str, ...]:
    """N colours, no two the same: the first eight for colour-blind readers, then each the farthest from all before it.

    Distances are those of OKLab (Ottosson 2020), in which equal steps look equally large.
    """
    if n <= len(COLOURS):
        return COLOURS[:n]
    steps = np.arange(0, 256, 15)
    candidates = np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(-1, 3)
    lab = oklab(candidates)
    fit = (lab[:, 0] >= DARKEST) & (lab[:, 0] <= LIGHTEST)
    candidates, lab = candidates[fit], lab[fit]
    chosen = list(COLOURS)
    taken = oklab(np.array([_rgb(colour) for colour in (*COLOURS, "#FFFFFF")]))
    nearest = np.linalg.norm(lab[:, None] - taken[None], axis=2).min(axis=1)
    for _ in range(n - len(chosen)):
        best = int(nearest.argmax())
        chosen.append("#{:02X}{:02X}{:02X}".format(*candidates[best]))
        nearest = np.minimum(nearest, np.linalg.norm(lab - lab[best], axis=1))
    return tuple(chosen)


def oklab(rgb: NDArray[np.int_]) -> NDArray[np.float64]:
    """OKLab coordinates (n, 3) of sRGB colours (n, 3) from 0 to 255: https://bottosson.github.io/posts/oklab/."""
    s = rgb / 255.0
    linear = np.where(s <= 0.04045, s / 12.92, ((s + 0.055) / 1.055) ** 2.4)
    cones = linear @ np.array(
        [
            [0.4122214708, 0.2119034982, 0.0883024619],
            [0.5363325363, 0.6806995451, 0.2817188376],
            [0.0514459929, 0.1073969566, 0.6299787005],
        ]
    )
    return np.asarray(
        np.cbrt(cones)
        @ np.array(
            [
                [0.2104542553, 1.9779984951, 0.0259040371],
                [0.7936177850, -2.4285922050, 0.7827717662],
                [-0.0040720468, 0.4505937099, -0.8086757660],
            ]
        )
    )


def _rgb(colour: str) -> tuple[int, int, int]:
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)
