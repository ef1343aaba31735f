"""Where the search begins: the straight way to a waypoint, as the vehicle lies."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from auvbench.evaluation.bounds.transcription import INTERVALS, Plan, Programs

Floats = NDArray[np.float64]

SPEED = 1.0
"""m/s along it; only the order of magnitude matters"""


def straight(programs: Programs, waypoint: Floats) -> Plan:
    """The straight way to the edge of the goal around a waypoint (3,) at a constant speed, without a turn and without thrust."""
    n_x = programs.model.n_x
    start = programs.start[:3]
    line = waypoint - start
    distance = float(np.linalg.norm(line))
    way = line * (max(distance - programs.radius, 0.1) / max(distance, 1e-9))
    T = 1.0 + float(np.linalg.norm(way)) / SPEED
    t = np.linspace(0.0, 1.0, INTERVALS + 1)
    X = np.zeros((n_x, INTERVALS + 1))
    X[:3] = start[:, None] + way[:, None] * t
    X[3] = 1.0
    X[7:10] = (way / T)[:, None]
    X[13:] = programs.model.rest[:, None]
    X[:, 0] = programs.start
    return Plan(X, np.repeat(programs.coasting[:, None], INTERVALS, axis=1), T)
