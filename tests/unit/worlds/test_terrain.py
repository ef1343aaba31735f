"""Height fields, against all their triangles in plain NumPy.

A hit is within 1e-9 m of its triangle along z: with a slope of at most 5, a coordinate of 100 m has an error of 2e-14 m, and the height
over it one of 1e-13 m.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from auvbench.worlds import solids
from auvbench.worlds.kinds import NOTHING
from tests.reference import solids as oracle
from tests.unit.worlds.test_casting import LONGEST, distances, hits, units

Floats = NDArray[np.float64]

CORNER = np.array([-3.0, 2.0, -6.0])


def field(rng: np.random.Generator, size: int = 6) -> Floats:
    return np.asarray(rng.normal(0.0, 1.0, (size, size)))


def check_rays(rounds: int, rays: int, shortest: float) -> None:
    rng = np.random.default_rng(5)
    some = 0
    for _ in range(rounds):
        heights, spacing = field(rng), rng.uniform(0.7, 3.0)
        bottom = solids.terrain(heights, spacing, CORNER)
        origins, directions = rng.uniform(-15.0, 15.0, (rays, 3)), units(rng, rays)
        origins[:, 2] = rng.uniform(-11.0, 5.0, rays)
        ranges, indices = hits(bottom, origins, directions, heights.ravel())
        struck = indices == 0
        some += struck.sum()
        at = origins + ranges[:, None] * directions

        def gap(points: Floats, heights: Floats = heights, spacing: float = spacing) -> Floats:
            return points[:, 2] - oracle.height(heights, spacing, CORNER, points)

        assert np.abs(gap(at[struck])).max() <= 1e-9
        assert (ranges[~struck] == LONGEST).all()
        first = oracle.march(
            gap, origins, directions, ranges, shortest, 1.0 / float(bottom["cosine"][0]) + 1.0
        )
        assert (ranges - first).max() <= 1e-9
    assert 0.3 < some / (rounds * rays) < 0.95


def test_rays_end_on_the_ground_and_cross_it_nowhere_before() -> None:
    check_rays(3, 300, 1e-2)


@pytest.mark.slow
def test_many_rays_end_on_the_ground_and_cross_it_nowhere_before() -> None:
    check_rays(20, 10_000, 1e-3)


def test_distances_are_those_of_the_nearest_triangle() -> None:
    rng = np.random.default_rng(9)
    heights = field(rng)
    bottom = solids.terrain(heights, 1.5, CORNER)
    points = CORNER + rng.uniform(-2.0, 2.0, (200, 3)) * (1.0, 1.0, 2.0)
    every = [oracle.triangle_distance(one, points) for one in oracle.triangles(heights, 1.5, CORNER, 2)]
    above = np.sign(points[:, 2] - oracle.height(heights, 1.5, CORNER, points))
    found, _, gradients = distances(bottom, points, heights.ravel())
    np.testing.assert_allclose(found, above * np.min(every, axis=0), rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(gradients, axis=1), 1.0, rtol=1e-12)
    step = 1e-6
    differences = [
        (distances(bottom, points + step * a, heights.ravel())[0]
         - distances(bottom, points - step * a, heights.ravel())[0]) / (2.0 * step)
        for a in np.eye(3)
    ]  # fmt: skip
    error = np.linalg.norm(np.stack(differences, axis=1) - gradients, axis=1)
    assert (error < 1e-5).mean() > 0.97


def test_a_distance_beyond_the_longest_is_left_out_and_a_shorter_one_exact() -> None:
    rng = np.random.default_rng(9)
    heights = field(rng)
    bottom = solids.terrain(heights, 1.5, CORNER)
    points = CORNER + rng.uniform(0.0, 8.0, (100, 3))
    exact = distances(bottom, points, heights.ravel())[0]
    found, indices, _ = distances(bottom, points, heights.ravel(), longest=1.0)
    near = exact < 1.0
    assert near.any()
    assert (~near).any()
    np.testing.assert_array_equal(found[near], exact[near])
    assert (found[~near] == 1.0).all()
    assert (indices[~near] == NOTHING).all()


def test_rays_straight_down_and_along_grid_lines() -> None:
    heights = np.array(
        [[0.0, 1.0, 0.0, 2.0], [1.0, 0.0, 3.0, 0.0], [0.0, 0.0, 0.0, 0.0], [2.0, 1.0, 0.0, 1.0]]
    )
    bottom = solids.terrain(heights, 2.0, [0.0, 0.0, 0.0])
    down = [0.0, 0.0, -1.0]
    for j in range(-4, 5):
        for i in range(-4, 5):
            for x, y in ((i, j), (i + 0.5, j), (i, j + 0.25), (i + 0.5, j + 0.5)):
                point = np.array([2.0 * x, 2.0 * y, 10.0])
                expected = 10.0 - oracle.height(heights, 2.0, np.zeros(3), point[None])[0]
                assert hits(bottom, point, down, heights.ravel())[0] == pytest.approx([expected], abs=1e-12)
    # Along the line y = 2 over (0, 2), height 1, to (4, 2), height 3; and along a diagonal of cells.
    along, index = hits(bottom, [2.0, 2.0, 1.5], [1.0, 0.0, 0.0], heights.ravel())
    assert along == pytest.approx([1.0], abs=1e-12)
    assert index == [0]
    diagonal = np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0)
    over, index = hits(bottom, [-1.0, -1.0, 0.5], diagonal, heights.ravel())
    assert index == [0]
    assert oracle.height(
        heights, 2.0, np.zeros(3), np.array([-1.0, -1.0, 0.5]) + over[:, None] * diagonal
    ) == (pytest.approx([0.5], abs=1e-9))


def test_a_level_ray_above_all_meets_nothing() -> None:
    heights = field(np.random.default_rng(1))
    bottom = solids.terrain(heights, 1.0, CORNER)
    high = [0.0, 0.0, CORNER[2] + heights.max() + 0.1]
    assert hits(bottom, high, [1.0, 0.0, 0.0], heights.ravel())[1] == [NOTHING]
    assert hits(bottom, high, [0.0, 0.0, 1.0], heights.ravel())[1] == [NOTHING]


def test_a_turned_field_is_the_same_field() -> None:
    rng = np.random.default_rng(2)
    heights = field(rng)
    yaw = 0.7
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
    origins, directions = rng.uniform(-5.0, 5.0, (50, 3)), units(rng, 50)
    straight = hits(solids.terrain(heights, 1.0, [0.0, 0.0, -6.0]), origins, directions, heights.ravel())
    turned = solids.terrain(heights, 1.0, [0.0, 0.0, -6.0], yaw=yaw)
    np.testing.assert_allclose(
        hits(turned, origins @ turn.T, directions @ turn.T, heights.ravel())[0], straight[0], atol=1e-9
    )
