"""Read the observation block `solids` for controllers that plan, and add a cost to plans that come near to solids."""

from __future__ import annotations

from typing import Any

import numpy as np

from auvbench.agents.classical.observer import turned
from auvbench.config import schema
from auvbench.config.worlds import Solid
from auvbench.dynamics import frames
from auvbench.dynamics.compiled import compiled
from auvbench.dynamics.lanes import quaternion, vector
from auvbench.dynamics.layout import POSE, record
from auvbench.dynamics.vectors import add, product, rotation_matrix
from auvbench.tasks.ranges.specs import NUMBERS
from auvbench.tasks.worlds.contact import HULL
from auvbench.tasks.worlds.surroundings import SIDE, hull_of
from auvbench.vehicles.vehicle_model import VehicleModel
from auvbench.worlds.casting import clearance, nearest_surface
from auvbench.worlds.kinds import Floats
from auvbench.worlds.routes import CORNERS, route
from auvbench.worlds.solids import NO_HEIGHTS, SOLID, reach_of

NEARNESS = record(
    clearance=(),  # m, clearance below which a plan has a price
    weight=(),  # 1/m, price per metre of missing clearance
    contact=(),  # price of a contact
)
"""Prices of small clearances at a node"""


class Avoidance:
    """Solids round a vehicle, as its controller observes them.

    Args:
        config: configuration with a world that has solids.
        vehicle: vehicle of the controller.
        columns: columns of the block `solids` in an observation.
    """

    def __init__(self, config: schema.TrainConfig, vehicle: VehicleModel, columns: slice) -> None:
        assert isinstance(config.world, Solid)
        self.columns = columns
        self.hull: Floats = hull_of(config.world, vehicle).view(np.ndarray).view(np.float64)
        """hull of the vehicle: record of type HULL, viewed as floats"""

    def solids(self, reading: Floats, position: Floats, yaw: float) -> Floats:
        """Return the solids of an observation: (k, size), records of type SOLID viewed as floats.

        Args:
            reading: (n_obs,) observation.
            position: (3,) m, position of the vehicle in the axes of the result.
            yaw: rad, yaw of the vehicle in these axes.
        """
        rows = reading[self.columns].reshape(-1, NUMBERS)
        rows = rows[rows[:, 0] > 0.0]
        solids = np.zeros(len(rows), SOLID)
        for solid, row in zip(solids, rows, strict=True):
            kind = round(row[0]) - 1
            axis, side = turned(row[4:7], yaw), turned(row[7:10], yaw)
            solid["kind"], solid["position"] = kind, position + turned(row[1:4], yaw)
            solid["along_z"], solid["along_x"], solid["along_y"] = axis, side, np.cross(axis, side)
            solid["radius"], solid["half"] = row[10], row[11:]
            solid["reach"] = reach_of(kind, float(solid["radius"]), solid["half"])
        return solids.view(np.float64).reshape(len(rows), SOLID.itemsize // 8)

    def way(self, solids: Floats, position: Floats, goal: Floats, lengths: Floats) -> Floats:
        """Return the points (n, 3) in m at `lengths` (n,) along the shortest way past solids. If no way leads to the goal, return points
        of the straight line to the goal.

        Args:
            solids: (k, size), see `solids`.
            position: (3,) m, start of the way.
            goal: (3,) m.
            lengths: (n,) distances from the start along the way, m, rising.
        """
        hull, corners = self.hull.view(HULL)[0], np.empty((CORNERS, 3))
        start, end = ((float(x), float(y), float(z)) for x, y, z in (position, goal))
        radius = float(hull["radius"] - hull["first"])
        count = route(solids.view(SOLID)[:, 0], NO_HEIGHTS, start, end, radius, SIDE, corners)
        line = corners[:count] if count else np.array([position, goal])
        at = np.concatenate([[0.0], np.linalg.norm(np.diff(line, axis=0), axis=1).cumsum()])
        return np.stack([np.interp(lengths, at, axis) for axis in line.T], axis=1)

    def clearances(self, solids: Floats, poses: Floats, longest: float) -> tuple[Floats, Floats]:
        """Return the clearances (count, n) in m of the hull's spheres, and the gradients (count, n, 3) of the clearances.

        Args:
            solids: (k, size), see `solids`.
            poses: (n, 7).
            longest: m, distance from the hull up to which the search finds solids; returned clearances are at most about this distance.
        """
        hull = self.hull.view(HULL)[0]
        ahead = frames.rotation(poses[:, 3:])[:, :, 0]
        arms = hull["first"] + hull["spacing"] * np.arange(hull["count"])
        points = (poses[:, :3] + arms[:, None, None] * ahead).reshape(-1, 3)
        distances, nearest = np.empty(len(points)), np.empty(len(points), np.int64)
        gradients = np.empty((len(points), 3))
        scene = solids.view(SOLID)[:, 0]
        clearance(
            scene, NO_HEIGHTS, 0.0, points, longest + float(hull["radius"]), distances, nearest, gradients
        )
        shape = len(arms), len(poses)
        return (distances - hull["radius"]).reshape(shape), gradients.reshape(*shape, 3)


@compiled("dynamics", "worlds", "tasks/worlds")
def price(
    pose: Floats,  # (n, 7)
    # Records are passed as floats, because numba compares the types of records again in each call.
    solids: Any,  # (k, size) records of type SOLID
    hull: Floats,  # record of type HULL
    prices: Floats,  # record of type NEARNESS
    cost: Floats,  # (n,) costs, increased in place
) -> None:
    """Add the price of a small clearance at a node: `weight` per metre below `clearance`, and `contact` in a contact."""
    poses, scene = pose.view(POSE)[:, 0], solids.view(SOLID)[:, 0]
    h, p = hull.view(HULL)[0], prices.view(NEARNESS)[0]
    for i in range(cost.shape[0]):
        position, R = vector(poses[i].position), rotation_matrix(quaternion(poses[i].attitude))
        least = p.clearance
        for k in range(h.count):
            centre = add(position, product(R, (h.first + k * h.spacing, 0.0, 0.0)))
            distance, _, _ = nearest_surface(scene, NO_HEIGHTS, 0.0, centre, least + h.radius)
            least = min(least, distance - h.radius)
        if least < p.clearance:
            cost[i] += p.weight * (p.clearance - least)
        if least < 0.0:
            cost[i] += p.contact
