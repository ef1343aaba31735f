"""Read a bottom from a file: heights on a regular grid (docs/worlds.md lists the names and units)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from auvbench.errors import closest
from auvbench.untrusted import archives, reading, tables
from auvbench.untrusted.text import short
from auvbench.worlds.kinds import Floats

if TYPE_CHECKING:
    from numpy.typing import NDArray

ENDINGS = (".npz", ".csv")
COORDINATES, HEIGHTS = ("x_m", "y_m"), {"z_m": 1.0, "depth_m": -1.0}
"""Names of arrays or columns: coordinates, and heights with the factor that converts them to z"""
MOST = 1 << 20
"""Largest number of points of a grid"""
LEAST = 4
"""Smallest number of points along each side of a grid"""
FINEST, COARSEST = 0.1, 100.0
"""Smallest and largest distance between points, m; a finer grid is probably in degrees"""
DEEPEST = 11_000.0
"""Largest depth, m; no sea is deeper"""
UNEVEN = 0.01
"""Largest error of a coordinate, as a fraction of the spacing; more than 0, because files have rounded coordinates"""


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """Heights on a regular grid."""

    x: Floats  # (columns,) m
    y: Floats  # (rows,) m
    z: Floats  # (rows, columns) m, up; the surface of the water is at 0
    spacing: float  # m
    sha256: str  # SHA-256 of the file

    @property
    def middle(self) -> tuple[float, float]:
        """Return x and y of the grid's middle, m."""
        return float(0.5 * (self.x[0] + self.x[-1])), float(0.5 * (self.y[0] + self.y[-1]))


def read(path: Path | str, digest: str = "") -> Grid:
    """Return the grid of an .npz or .csv file.

    Args:
        path: file.
        digest: SHA-256 that the file must have; '' accepts any file.

    Raises:
        ValueError: the file cannot be read, has another digest, or has no regular grid of heights; the message is one line.
    """
    ending = Path(path).suffix.lower()
    if ending not in ENDINGS:
        raise ValueError(f"ends in {ending or 'nothing'}; must be a .npz or .csv file")
    try:
        data = reading.content(path, reading.DATA)
    except OSError as error:
        raise ValueError(f"cannot be read: {error.strerror}") from None
    # Check the digest before parsing, because the parser's errors quote the file. Without this check, a configuration from another
    # person could show the content of a file that this person does not know.
    if digest not in ("", sha256(data).hexdigest()):
        raise ValueError(f"differs from the file with the SHA-256 {short(digest, 12)}; name that file")
    return _parsed(data, ending)


@lru_cache(maxsize=4)
def _parsed(data: bytes, ending: str) -> Grid:
    """Return the grid in a file's bytes; cached, because each batch of environments reads the file."""
    found: Mapping[str, NDArray[Any]]
    if ending == ".npz":
        found = archives.arrays(data)
    else:
        table = tables.csv(data)
        found = {str(name).removeprefix("\ufeff").strip(): np.asarray(table[name]) for name in table.columns}
    return _grid(found, ending == ".csv", sha256(data).hexdigest())


def _grid(found: Mapping[str, NDArray[Any]], is_table: bool, digest: str) -> Grid:
    """Return the grid from a table with one row for each point, or from arrays x (columns,), y (rows,) and z (rows, columns)."""
    what = "column" if is_table else "array"
    for name in found:
        if name not in (*COORDINATES, *HEIGHTS):
            raise ValueError(
                f"has an unknown {what} {short(name, 40)!r}; {closest(name, [*COORDINATES, *HEIGHTS])}"
            )
    heights = [name for name in HEIGHTS if name in found]
    if len(heights) != 1 or not all(name in found for name in COORDINATES):
        raise ValueError(
            f"has the {what}s {', '.join(found) or 'none'}; must have x_m, y_m and either z_m or depth_m"
        )
    x, y, z = (_numbers(found[name], name) for name in (*COORDINATES, heights[0]))
    if z.size > MOST:
        raise ValueError(
            f"has {z.size:,} points; must have at most {MOST:,}: reduce its area or its resolution"
        )
    if is_table:
        x, y, z = _spread(x, y, z)
    if x.ndim != 1 or y.ndim != 1 or z.shape != (len(y), len(x)):
        raise ValueError(
            f"has x_m {x.shape}, y_m {y.shape}, {heights[0]} {z.shape}; must have shapes (columns,), (rows,), (rows, columns)"
        )
    if not np.isfinite(z).all():
        row, column = np.argwhere(~np.isfinite(z))[0]
        holes = int((~np.isfinite(z)).sum())
        raise ValueError(
            f"has points without a height ({holes:,}), the first at x={x[column]:g}, y={y[row]:g} m; fill them or cut them off"
        )
    spacing = _spacing(x, y)
    z = z * HEIGHTS[heights[0]]
    _check_heights(z, heights[0])
    return Grid(x, y, z, spacing, digest)


def _numbers(values: NDArray[Any], name: str) -> Floats:
    if values.dtype.kind not in "iuf":
        raise ValueError(f"has a {name} that is not numeric; must be numbers")
    return np.asarray(values, dtype=np.float64)


def _spread(x: Floats, y: Floats, z: Floats) -> tuple[Floats, Floats, Floats]:
    """Return x (columns,), y (rows,) and z (rows, columns) of a grid whose points come in any order; z of a missing point is NaN."""
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        raise ValueError("has a point without coordinates")
    xs, column = np.unique(x, return_inverse=True)
    ys, row = np.unique(y, return_inverse=True)
    # Scattered points have almost as many different x and y as there are points.
    if len(xs) * len(ys) > 2 * len(z) + 1:
        raise ValueError(
            f"has {len(z):,} points at {len(xs):,} different x and {len(ys):,} different y; must have a regular grid: resample it"
        )
    if len(np.unique(row * len(xs) + column)) < len(z):
        raise ValueError("has two heights at one point")
    heights: Floats = np.full((len(ys), len(xs)), np.nan)
    heights[row, column] = z
    return xs, ys, heights


def _spacing(x: Floats, y: Floats) -> float:
    """Return the spacing in m of a regular grid."""
    spacings = []
    for name, values in zip(COORDINATES, (x, y), strict=True):
        if len(values) < LEAST:
            raise ValueError(f"has {len(values)} different {name}; must have at least {LEAST}")
        spacing = float(values[-1] - values[0]) / (len(values) - 1)
        off = np.abs(values - values[0] - spacing * np.arange(len(values))).max()
        if not (spacing > 0.0 and off <= UNEVEN * spacing):
            raise ValueError(f"has a {name} that does not rise evenly; must have a regular grid: resample it")
        spacings.append(spacing)
    across, up = spacings
    if abs(across - up) > UNEVEN * min(spacings) / max(x.size, y.size):
        raise ValueError(
            f"has {across:g} m between its points along x and {up:g} m along y; must be equal: resample it"
        )
    if not FINEST <= across <= COARSEST:
        raise ValueError(
            f"has {across:g} m between its points; must be {FINEST:g} to {COARSEST:g} m, in m and not degrees"
        )
    return across


def _check_heights(z: Floats, name: str) -> None:
    """Raise ValueError for heights whose sign or unit must be wrong; z (rows, columns) is positive up."""
    if z.max() > 0.0 and z.mean() > 0.0:
        other = "depth_m" if name == "z_m" else "z_m"
        up = "z_m is up from the surface" if name == "z_m" else "depth_m is down from the surface"
        raise ValueError(f"is above the surface on average, since {up}; change the signs, or call it {other}")
    if z.min() < -DEEPEST:
        raise ValueError(
            f"is {-z.min():,.0f} m deep; must be at most {DEEPEST:,.0f} m: {name} is in m, not cm or mm"
        )
