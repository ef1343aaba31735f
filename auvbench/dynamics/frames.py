"""Convert attitudes, and axes between the conventions ENU/FLU and NED/FRD.

Marine papers use body axes forward, starboard, down (FRD); auvbench uses forward, port, up (FLU). They differ by half
a turn about x, which changes the sign of the second and third component of every vector. The same half turn converts
the world axes north, east, down to north, west, up. Water has no preferred direction, so a motion in north-west-up is
a motion in east-north-up with another direction of zero yaw. Since only signs change, nothing is rounded. Where north matters,
as for ArduPilot, use `ned` and `ned_attitude`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]

_SIGNS = np.array([1.0, -1.0, -1.0])


def flip(vectors: ArrayLike) -> FloatArray:
    """Convert vectors (..., 3), or wrenches and velocities (..., 6), from FLU to FRD or from FRD to FLU.

    >>> flip([1.0, 2.0, 3.0])
    array([ 1., -2., -3.])
    """
    array = np.asarray(vectors, dtype=np.float64)
    # Adding zero turns -0 into 0, because readers of a file expect 0.
    return np.asarray(array * np.tile(_SIGNS, array.shape[-1] // 3) + 0.0)


def flip_pose(pose: ArrayLike) -> FloatArray:
    """Convert poses (..., 7) = x y z qw qx qy qz from FLU to FRD or from FRD to FLU."""
    signs = np.concatenate([_SIGNS, [1.0], _SIGNS])
    return np.asarray(np.asarray(pose, dtype=np.float64) * signs + 0.0)


def rotation(quaternion: ArrayLike) -> FloatArray:
    """Return R (..., 3, 3), body to world, of unit quaternions (..., 4) = (w, x, y, z) (Fossen 2021, eq. 2.68)."""
    w, x, y, z = np.moveaxis(np.asarray(quaternion, dtype=np.float64), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def euler(quaternion: ArrayLike) -> FloatArray:
    """Return roll, pitch, yaw (..., 3) in rad of unit quaternions (..., 4), z-y-x convention (Fossen 2021, eq. 2.74).

    Pitch is in [-pi/2, pi/2], roll and yaw in [-pi, pi]. At a pitch of a quarter turn, only the sum or the difference
    of roll and yaw is defined.
    """
    R = rotation(quaternion)
    phi = np.arctan2(R[..., 2, 1], R[..., 2, 2])
    # More accurate than arcsin near a quarter turn, where the slope of arcsin is infinite.
    theta = np.arctan2(-R[..., 2, 0], np.hypot(R[..., 2, 1], R[..., 2, 2]))
    return np.stack([phi, theta, np.arctan2(R[..., 1, 0], R[..., 0, 0])], axis=-1)


def yaw(quaternion: ArrayLike) -> FloatArray:
    """Return the yaw (...) in rad of unit quaternions (..., 4)."""
    w, x, y, z = np.moveaxis(np.asarray(quaternion, dtype=np.float64), -1, 0)
    return np.asarray(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))


def quaternion(angles: ArrayLike) -> FloatArray:
    """Return unit quaternions (..., 4) = (w, x, y, z) for roll, pitch, yaw (..., 3) in rad (Fossen 2021, section 2.2).

    >>> quaternion([0.0, 0.0, 0.0])
    array([1., 0., 0., 0.])
    """
    half = np.asarray(angles, dtype=np.float64) / 2.0
    cx, cy, cz = np.moveaxis(np.cos(half), -1, 0)
    sx, sy, sz = np.moveaxis(np.sin(half), -1, 0)
    return np.stack(
        [
            cx * cy * cz + sx * sy * sz,
            sx * cy * cz - cx * sy * sz,
            cx * sy * cz + sx * cy * sz,
            cx * cy * sz - sx * sy * cz,
        ],
        axis=-1,
    )


_HALF = 0.5**0.5


def ned(vector: Sequence[float]) -> tuple[float, float, float]:
    """Convert a vector (3,) from world axes east, north, up to north, east, down, or back.

    >>> ned((1.0, 2.0, 3.0))
    (2.0, 1.0, -3.0)
    """
    east, north, up = vector
    return north, east, -up


def ned_attitude(quaternion: Sequence[float]) -> tuple[float, float, float, float]:
    """Convert the attitude (w, x, y, z) of an FLU body in an ENU world to the attitude of the FRD body in an NED world.

    The result is (0, a, a, 0) q (0, 1, 0, 0) up to a sign, with a^2 = 1/2. A body with its bow to the east has a yaw
    of 90 degrees in NED:

    >>> ned_attitude((1.0, 0.0, 0.0, 0.0))
    (0.7071067811865476, 0.0, 0.0, 0.7071067811865476)
    """
    w, x, y, z = quaternion
    return _HALF * (w + z), _HALF * (x + y), _HALF * (x - y), _HALF * (w - z)
