"""Solids as segments in pictures."""

from __future__ import annotations

import numpy as np
import pytest

from auvbench.worlds import solids
from auvbench.worlds.casting import clearance
from auvbench.worlds.outlines import clipped, outlines

LOW, HIGH = np.full(3, -50.0), np.full(3, 50.0)
RNG = np.random.default_rng(1)
HEIGHTS = RNG.normal(0.0, 1.0, (6, 8))
SOLIDS = {
    "sphere": solids.sphere([1.0, 2.0, -3.0], 0.7),
    "capsule": solids.capsule([1.0, 2.0, -3.0], [1.0, 2.0, 3.0], 4.0, 0.5),
    "cylinder": solids.cylinder([-1.0, 2.0, -3.0], [0.0, 1.0, 3.0], 4.0, 0.5),
    "box": solids.box([1.0, 0.0, -3.0], [1.0, 2.0, 3.0]),
    "plane": solids.plane([1.0, 0.0, -3.0], [0.2, -0.4, 1.0]),
    "wall": solids.plane([1.0, 0.0, -3.0], [1.0, 0.3, 0.1]),
    "terrain": solids.terrain(HEIGHTS, 1.5, [2.0, -1.0, -20.0], 0.4),
}


@pytest.mark.parametrize("name", SOLIDS)
def test_ends_of_segments_are_on_the_surface(name: str) -> None:
    solid = SOLIDS[name]
    heights = HEIGHTS.ravel() if name == "terrain" else solids.NO_HEIGHTS
    room = np.array([20.0, 20.0, 50.0])
    drawn = outlines(solid, heights, -room, room)
    points = drawn.reshape(-1, 3)
    if name == "terrain":  # where the box cuts it, ends lie between vertices
        points = points[(np.abs(points) < room - 1e-9).all(1)]
    assert len(points) >= 12
    distances, nearest = np.empty(len(points)), np.empty(len(points), np.int64)
    clearance(solid, heights, 0.0, points, 100.0, distances, nearest, np.empty((len(points), 3)))
    # The ring of a capsule or a cylinder, at the middle of the box, is on it too.
    assert np.abs(distances).max() < 1e-9


def test_a_solid_outside_the_box_is_not_drawn() -> None:
    assert len(outlines(SOLIDS["sphere"], solids.NO_HEIGHTS, np.zeros(3), np.ones(3))) == 0


def test_clipping_keeps_what_is_inside_and_nothing_else() -> None:
    low, high = np.array([-1.0, -2.0, -0.5]), np.array([1.5, 1.0, 2.0])
    segments = RNG.uniform(-4.0, 4.0, (500, 2, 3))
    segments[::7, 1, 0] = segments[::7, 0, 0]  # some are parallel to a side
    shares = np.linspace(0.0, 1.0, 2001)[:, None, None]
    points = segments[:, 0] + shares * (segments[:, 1] - segments[:, 0])
    inside = ((points >= low) & (points <= high)).all(2)
    kept = clipped(segments, low, high)
    assert ((kept >= low - 1e-12) & (kept <= high + 1e-12)).all()
    lengths = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1)
    total = (inside.mean(0) * lengths).sum()
    assert np.linalg.norm(kept[:, 1] - kept[:, 0], axis=1).sum() == pytest.approx(total, rel=2e-3)


def test_a_solid_that_moves_is_drawn_where_it_is_with_a_line_from_where_it_was() -> None:
    ball = solids.sphere([0.0, 0.0, 0.0], 0.5, velocity=[0.5, 0.0, 0.0])
    drawn = outlines(ball, solids.NO_HEIGHTS, np.full(3, -9.0), np.full(3, 9.0), 4.0)
    line, circles = drawn[0], drawn[1:]
    assert line == pytest.approx(np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]]))
    assert np.linalg.norm(circles - [2.0, 0.0, 0.0], axis=2) == pytest.approx(0.5)
    assert ball["position"].tolist() == [[0.0, 0.0, 0.0]]


def test_no_solids_make_no_segments() -> None:
    assert outlines(solids.none(), solids.NO_HEIGHTS, LOW, HIGH).shape == (0, 2, 3)
