"""The Coriolis term of added mass as the Hydrodynamics plugin of Gazebo has it, which is not Fossen's.

Fossen's force is -C_A(nu_r) nu_r (2011, eq. 6.43). The plugin applies +C nu_r, by its source and as measured (docs/gazebo.md), with

* `gz-sim-8.12` (and later, measured in 8.14.0): C = C_A, so that the term has the opposite sign;
* `gz-sim-8.11` (and earlier, from its first version on; measured with the plugin of 8.11.0): a C that differs from C_A in two entries besides,
  C(0,5) = +A_22 v where C_A has -A_22 v, so that this force is Fossen's again, and C(5,0) = -A_33 w where C_A has A_22 v.

A_22 and A_33 are the added masses in sway and heave, kg; v and w the velocities through the water. With the two entries the
term is no longer skew-symmetric, so it does work: a vehicle that moves ahead and rises or sinks is turned in yaw.

Sources: gazebosim/gz-sim, src/systems/hydrodynamics/Hydrodynamics.cc, gz-sim8_8.6.0 and 57e28a0 (#3456, released in 8.12.0).
What else the plugin does is not copied here: its added mass is the force of the step before, and up to 8.11 its first step kicks a
vehicle that is set into a current.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
GZ_SIM_8_11 = "gz-sim-8.11"
GZ_SIM_8_12 = "gz-sim-8.12"
RELEASES = (GZ_SIM_8_11, GZ_SIM_8_12)


def early(M_A: FloatArray, nu: FloatArray) -> FloatArray:
    """What `gz-sim-8.11` adds to `gz-sim-8.12`: wrench (6,) in N and N m.

    Args:
        M_A: (6, 6) added mass, kg, kg m, kg m2.
        nu: (6,) velocity through the water, m/s and rad/s, in body axes.
    """
    surge, yaw = surge_and_yaw(M_A, nu)
    return np.array([surge, 0.0, 0.0, 0.0, 0.0, yaw])


def surge_and_yaw(M_A: FloatArray, nu: Any) -> tuple[Any, Any]:
    """The two components of `early` that are not zero, of numbers or symbols `nu`."""
    u, v, w, r = nu[0], nu[1], nu[2], nu[5]
    return 2.0 * M_A[1, 1] * v * r, -(M_A[1, 1] * v + M_A[2, 2] * w) * u
