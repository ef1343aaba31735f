"""Mass matrices and Coriolis terms in Fossen's notation.

Fossen, "Handbook of Marine Craft Hydrodynamics and Motion Control", Wiley 2011, chapter 3.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


def skew(a: ArrayLike) -> FloatArray:
    """S(a) with S(a) b = a x b (Fossen 2011, definition 2.2).

    >>> skew([1.0, 2.0, 3.0]) @ np.array([0.0, 0.0, 1.0])
    array([ 2., -1.,  0.])
    """
    x, y, z = np.asarray(a, dtype=np.float64)
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rigid_body_mass(mass: float, center_of_gravity: ArrayLike, inertia: ArrayLike) -> FloatArray:
    """M_RB (6, 6) at the body origin (Fossen 2011, eq. 3.44, with I_b by eq. 3.36).

    Args:
        mass: kg.
        center_of_gravity: r_g (3,), m, in body axes from the body origin.
        inertia: (3, 3), kg m2, about the centre of gravity; the parallel-axis theorem moves it to the origin.
    """
    S = skew(center_of_gravity)
    M = np.zeros((6, 6))
    M[:3, :3] = mass * np.eye(3)
    M[:3, 3:] = -mass * S
    M[3:, :3] = mass * S
    M[3:, 3:] = np.asarray(inertia, dtype=np.float64) - mass * S @ S
    return M


def coriolis(M: ArrayLike, nu: ArrayLike) -> FloatArray:
    """C(nu) (6, 6), skew-symmetric, from a symmetric mass matrix (Fossen 2011, theorem 3.2).

    The same parametrisation serves M_RB and M_A; the kernel uses its product with nu in momentum form.
    """
    M = np.asarray(M, dtype=np.float64)
    nu = np.asarray(nu, dtype=np.float64)
    momentum = M @ nu
    C = np.zeros((6, 6))
    C[:3, 3:] = -skew(momentum[:3])
    C[3:, :3] = -skew(momentum[:3])
    C[3:, 3:] = -skew(momentum[3:])
    return C
