"""The nearest of many solids, against the same geometry in plain NumPy (`tests.reference.solids`)."""

from __future__ import annotations

import hashlib
import math
import os
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from auvbench.worlds import solids
from auvbench.worlds.casting import cast, clearance
from auvbench.worlds.kinds import NOTHING
from tests.reference import solids as oracle

Floats = NDArray[np.float64]

LONGEST = 60.0
SHORTEST = 1e-4
"""m, smallest step of the brute force: a ray that is inside for less may be missed"""
CONVEX = ("sphere", "capsule", "cylinder", "box", "plane")


def units(rng: np.random.Generator, n: int) -> Floats:
    vectors = rng.normal(size=(n, 3))
    return vectors / np.linalg.norm(vectors, axis=1)[:, None]


def random_solid(kind: str, rng: np.random.Generator) -> Any:
    centre, (axis, other) = rng.uniform(-10.0, 10.0, 3), units(rng, 2)
    length, radius = rng.uniform(0.5, 8.0), rng.uniform(0.2, 3.0)
    if kind == "sphere":
        return solids.sphere(centre, radius)
    if kind == "capsule":
        return solids.capsule(centre, axis, length, radius)
    if kind == "cylinder":
        return solids.cylinder(centre, axis, length, radius)
    if kind == "plane":
        return solids.plane(centre, axis)
    third = np.cross(axis, other) / np.linalg.norm(np.cross(axis, other))
    return solids.box(centre, rng.uniform(0.5, 8.0, 3), [axis, np.cross(third, axis), third])


def random_rays(solid: Any, rng: np.random.Generator, n: int) -> tuple[Floats, Floats]:
    """Return origins and directions, a third each: aimed at the solid or just past it, anywhere, and from near or inside it."""
    reach = min(float(solid["reach"][0]), 5.0)
    origins = rng.uniform(-20.0, 20.0, (n, 3))
    directions = units(rng, n)
    third = n // 3
    aimed = (
        solid["position"] + reach * rng.uniform(0.0, 1.0, (third, 1)) * units(rng, third) - origins[:third]
    )
    directions[:third] = aimed / np.linalg.norm(aimed, axis=1)[:, None]
    origins[-third:] = solid["position"] + 1.2 * reach * rng.uniform(-1.0, 1.0, (third, 3))
    return origins, directions


def hits(
    scene: Any,
    origins: Floats,
    directions: Floats,
    heights: Floats = solids.NO_HEIGHTS,
    longest: float = LONGEST,
    time: float = 0.0,
) -> tuple[Floats, NDArray[np.int64]]:
    origins, directions = (
        np.atleast_2d(np.asarray(origins, float)),
        np.atleast_2d(np.asarray(directions, float)),
    )
    ranges, indices = np.empty(len(origins)), np.empty(len(origins), np.int64)
    cast(scene, heights, time, origins, directions, longest, ranges, indices)
    return ranges, indices


def distances(
    scene: Any,
    points: Any,
    heights: Floats = solids.NO_HEIGHTS,
    longest: float = LONGEST,
    time: float = 0.0,
) -> tuple[Floats, NDArray[np.int64], Floats]:
    points = np.atleast_2d(np.asarray(points, float))
    found, indices = np.empty(len(points)), np.empty(len(points), np.int64)
    gradients = np.empty((len(points), 3))
    clearance(scene, heights, time, points, longest, found, indices, gradients)
    return found, indices, gradients


def check_rays(kind: str, rounds: int, rays: int) -> None:
    rng = np.random.default_rng(CONVEX.index(kind))
    some = 0
    for _ in range(rounds):
        solid = random_solid(kind, rng)
        origins, directions = random_rays(solid, rng, rays)
        ranges, indices = hits(solid, origins, directions)
        struck = indices == 0
        some += struck.sum()
        assert (ranges[~struck] == LONGEST).all()
        at = origins + ranges[:, None] * directions
        assert np.abs(oracle.signed_distance(solid[0], at[struck])).max() <= 1e-9

        def signed(points: Floats, solid: Any = solid[0]) -> Floats:
            return oracle.signed_distance(solid, points)

        first = oracle.march(signed, origins, directions, ranges, SHORTEST)
        assert (ranges - first).max() <= 1e-9
    assert 0.2 < some / (rounds * rays) < 0.95


@pytest.mark.parametrize("kind", CONVEX)
def test_rays_end_at_the_surface_and_cross_none_before(kind: str) -> None:
    check_rays(kind, 4, 600)


@pytest.mark.slow
@pytest.mark.parametrize("kind", CONVEX)
def test_many_rays_end_at_the_surface_and_cross_none_before(kind: str) -> None:
    check_rays(kind, 40, 5_000)


@pytest.mark.parametrize("kind", CONVEX)
def test_signed_distances_and_their_gradients(kind: str) -> None:
    rng = np.random.default_rng(7)
    for _ in range(20):
        solid = random_solid(kind, rng)
        points = rng.uniform(-15.0, 15.0, (500, 3))
        points[::2] = solid["position"] + rng.uniform(-2.0, 2.0, (250, 3))
        found, _, gradients = distances(solid, points)
        np.testing.assert_allclose(found, oracle.signed_distance(solid[0], points), rtol=1e-13, atol=1e-12)
        np.testing.assert_allclose(np.linalg.norm(gradients, axis=1), 1.0, rtol=1e-12)
        step = 1e-6
        differences = [
            (distances(solid, points + step * axis)[0] - distances(solid, points - step * axis)[0])
            / (2.0 * step)
            for axis in np.eye(3)
        ]
        error = np.linalg.norm(np.stack(differences, axis=1) - gradients, axis=1)
        assert (error < 1e-6).mean() > 0.99  # not where two surfaces are equally near


def test_known_hits() -> None:
    ball = solids.sphere([10.0, 0.0, 0.0], 2.0)
    rod = solids.capsule([10.0, 0.0, 0.0], [0.0, 0.0, 1.0], 4.0, 1.0)
    drum = solids.cylinder([10.0, 0.0, 0.0], [0.0, 0.0, 1.0], 4.0, 1.0)
    block = solids.box([10.0, 0.0, 0.0], [2.0, 4.0, 6.0])
    floor = solids.plane([0.0, 0.0, -5.0], [0.0, 0.0, 1.0])
    east, down, up = [1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 0.0, 1.0]
    inf = math.inf
    for solid, origin, direction, expected in (
        (ball, [0.0, 0.0, 0.0], east, 8.0),
        (ball, [0.0, 2.0, 0.0], east, 10.0),  # touches it
        (ball, [0.0, 2.0000001, 0.0], east, inf),
        (ball, [10.0, 0.0, 0.0], east, 2.0),  # from inside
        (ball, [12.0, 0.0, 0.0], east, 0.0),  # from the surface
        (ball, [13.0, 0.0, 0.0], east, inf),  # behind
        (rod, [0.0, 0.0, 0.0], east, 9.0),
        (rod, [0.0, 0.0, 2.6], east, 10.0 - 0.8),  # 0.6 above the end of its axis
        (rod, [10.0, 0.0, 10.0], down, 7.0),  # along its axis, on its end
        (rod, [10.0, 0.0, 0.0], up, 3.0),
        (rod, [0.0, 0.0, 3.0], east, 10.0),  # touches its top
        (rod, [11.0, 0.0, 10.0], down, 8.0),  # touches its side from its end on
        (drum, [0.0, 0.0, 2.0], east, 9.0),  # in the plane of its end
        (drum, [10.5, 0.0, 10.0], down, 8.0),
        (drum, [10.0, 1.0, 10.0], down, 8.0),  # along its side
        (drum, [10.0, 1.0000001, 10.0], down, inf),
        (block, [0.0, 0.0, 0.0], east, 9.0),
        (block, [0.0, 2.0, 3.0], east, 9.0),  # along an edge
        (block, [0.0, 2.0000001, 0.0], east, inf),  # parallel to a slab, outside
        (block, [10.0, 1.0, 0.0], up, 3.0),
        (floor, [0.0, 0.0, 1.0], down, 6.0),
        (floor, [0.0, 0.0, 1.0], east, inf),  # parallel
        (floor, [0.0, 0.0, 1.0], up, inf),
        (floor, [0.0, 0.0, -7.0], up, 2.0),  # from below
    ):
        (found,), (index,) = hits(solid, origin, direction)
        assert found == pytest.approx(min(expected, LONGEST), abs=1e-12), (origin, direction)
        assert index == (NOTHING if expected == inf else 0)


def test_a_ray_that_nearly_touches_stays_within_a_rounding_of_the_surface() -> None:
    ball = solids.sphere([1000.0, 0.0, 0.0], 1.0)
    for offset in (0.0, 1e-16, 1e-15, 1e-14, 1e-12, 1e-9, 1e-6):
        (found,), (index,) = hits(ball, [0.0, 1.0 - offset, 0.0], [1.0, 0.0, 0.0], longest=2000.0)
        assert index == 0
        assert abs(oracle.signed_distance(ball[0], np.array([[found, 1.0 - offset, 0.0]]))[0]) <= 1e-9


def test_the_nearest_of_many() -> None:
    rng = np.random.default_rng(3)
    scene = np.concatenate([random_solid(kind, rng) for kind in CONVEX[:4] for _ in range(5)])
    origins, directions = rng.uniform(-15.0, 15.0, (500, 3)), units(rng, 500)
    ranges, indices = hits(scene, origins, directions)
    alone = np.array([hits(scene[k : k + 1], origins, directions)[0] for k in range(len(scene))])
    np.testing.assert_array_equal(ranges, alone.min(0))
    assert (indices == np.where(alone.min(0) < LONGEST, alone.argmin(0), NOTHING)).all()
    near, nearest, _ = distances(scene, origins)
    every = np.array([oracle.signed_distance(solid, origins) for solid in scene])
    np.testing.assert_allclose(near, every.min(0), rtol=1e-12, atol=1e-12)
    assert (nearest == every.argmin(0)).all()
    assert distances(scene, origins, longest=0.5)[0] == pytest.approx(np.minimum(every.min(0), 0.5))


def test_solids_move() -> None:
    ball = solids.sphere([10.0, 0.0, 0.0], 1.0, velocity=[-1.0, 2.0, 0.0])
    assert hits(ball, [0.0, 6.0, 0.0], [1.0, 0.0, 0.0], time=3.0)[0] == pytest.approx([6.0])
    assert hits(ball, [0.0, 6.0, 0.0], [1.0, 0.0, 0.0])[1] == [NOTHING]
    assert distances(ball, [7.0, 0.0, 0.0], time=3.0)[0] == pytest.approx([5.0])


def test_nothing_in_empty_water() -> None:
    assert hits(solids.none(), [0.0, 0.0, 0.0], [1.0, 0.0, 0.0])[1] == [NOTHING]
    found, index, gradient = distances(solids.none(), [0.0, 0.0, 0.0])
    assert (found, index, *gradient[0]) == (LONGEST, NOTHING, 0.0, 0.0, 0.0)


def scene_bits() -> str:
    """Return a digest of ranges and distances among solids of every kind."""
    rng = np.random.default_rng(11)
    heights = rng.normal(0.0, 1.0, (8, 8))
    bottom = solids.terrain(heights, 2.0, [0.0, 0.0, -12.0], yaw=0.4)
    scene = np.concatenate([bottom, *(random_solid(kind, rng) for kind in CONVEX[:4] for _ in range(3))])
    origins, directions = rng.uniform(-10.0, 10.0, (60, 3)), units(rng, 60)
    digest = hashlib.sha256()
    for array in (
        *hits(scene, origins, directions, heights.ravel(), time=1.5),
        *distances(scene, origins, heights.ravel(), time=1.5),
    ):
        digest.update(array.tobytes())
    return digest.hexdigest()


@pytest.mark.slow
def test_interpreted_functions_give_the_same_bits() -> None:
    code = "from tests.unit.worlds.test_casting import scene_bits; print(scene_bits())"
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    printed = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    assert printed.stdout.split()[-1] == scene_bits()
