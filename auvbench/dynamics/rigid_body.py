"""Mass matrices and Coriolis terms in Fossen's notation, and Gazebo's versions of the added-mass Coriolis term.

Fossen, "Handbook of Marine Craft Hydrodynamics and Motion Control", Wiley 2011, chapter 3.

Fossen's force is -C_A(nu_r) nu_r (2011, eq. 6.43). Gazebo's Hydrodynamics plugin applies +C nu_r, according to its source and to
measurements (docs/gazebo.md). C depends on the release:

* `gz-sim-8.12` and later (measured in 8.14.0): C = C_A. The sign is opposite to Fossen's, so the Munk moment turns a hull into the flow;
* `gz-sim-8.11` and all earlier releases (measured with the plugin of 8.11.0): C differs from C_A in two entries,
  C(0,5) = +A_22 v where C_A has -A_22 v, so that this force equals Fossen's, and C(5,0) = -A_33 w where C_A has A_22 v.

A_22 and A_33 are the added masses in sway and heave, kg; v and w are the velocities through the water. These two
entries make C not skew-symmetric: the term does work, and motion in surge and heave turns a vehicle in yaw.

Sources: gazebosim/gz-sim, src/systems/hydrodynamics/Hydrodynamics.cc, gz-sim8_8.6.0 and 57e28a0 (#3456, released in 8.12.0).
Other properties of the plugin are not copied: its added mass is a force from the previous step, and up to 8.11 its
first step kicks a vehicle that starts in a current.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
GZ_SIM_8_11 = "gz-sim-8.11"
GZ_SIM_8_12 = "gz-sim-8.12"
RELEASES = (GZ_SIM_8_11, GZ_SIM_8_12)


def skew(a: ArrayLike) -> FloatArray:
    """Return S(a) with S(a) b = a x b (Fossen 2011, definition 2.2).

    >>> skew([1.0, 2.0, 3.0]) @ np.array([0.0, 0.0, 1.0])
    array([ 2., -1.,  0.])
    """
    x, y, z = np.asarray(a, dtype=np.float64)
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rigid_body_mass(mass: float, center_of_gravity: ArrayLike, inertia: ArrayLike) -> FloatArray:
    """Return M_RB (6, 6) at the body origin (Fossen 2011, eq. 3.44, with I_b by eq. 3.36).

    Args:
        mass: mass, kg.
        center_of_gravity: r_g (3,), m, in body axes from the body origin.
        inertia: inertia (3, 3) about the centre of gravity, kg m2; the parallel-axis theorem moves it to the origin.
    """
    S = skew(center_of_gravity)
    M = np.zeros((6, 6))
    M[:3, :3] = mass * np.eye(3)
    M[:3, 3:] = -mass * S
    M[3:, :3] = mass * S
    M[3:, 3:] = np.asarray(inertia, dtype=np.float64) - mass * S @ S
    return M


def coriolis(M: ArrayLike, nu: ArrayLike) -> FloatArray:
    """Return the skew-symmetric C(nu) (6, 6) for a symmetric mass matrix, M_RB or M_A (Fossen 2011, theorem 3.2).

    The kernel does not use this function: it computes the product C(nu) nu from momenta.
    """
    M = np.asarray(M, dtype=np.float64)
    nu = np.asarray(nu, dtype=np.float64)
    momentum = M @ nu
    C = np.zeros((6, 6))
    C[:3, 3:] = -skew(momentum[:3])
    C[3:, :3] = -skew(momentum[:3])
    C[3:, 3:] = -skew(momentum[3:])
    return C


def early(M_A: FloatArray, nu: FloatArray) -> FloatArray:
    """Return the wrench of the `gz-sim-8.11` plugin minus the wrench of the `gz-sim-8.12` plugin: (6,), N and N m.

    Args:
        M_A: (6, 6) added mass, kg, kg m, kg m2.
        nu: (6,) velocity through the water, m/s and rad/s, in body axes.
    """
    surge, yaw = surge_and_yaw(M_A, nu)
    return np.array([surge, 0.0, 0.0, 0.0, 0.0, yaw])


def surge_and_yaw(M_A: FloatArray, nu: Any) -> tuple[Any, Any]:
    """Return the two nonzero components of `early`, for numbers or symbols `nu`."""
    u, v, w, r = nu[0], nu[1], nu[2], nu[5]
    return 2.0 * M_A[1, 1] * v * r, -(M_A[1, 1] * v + M_A[2, 2] * w) * u
