"""Records that the compiled physics reads; `lanes` reads and writes them.

The kernel works on blocks of `LANES` vehicles. Everything that a vehicle needs for a step is in one record, `WORKSPACE`, with
each number stored side by side for 16 vehicles: `ws.y.velocity[axis, lane]`. The innermost loops then run over
vehicles, with constant bounds and constant offsets from one pointer, and LLVM compiles each loop into vector
instructions without checks at run time.

Symbols are Fossen's (2011). All vectors are in body axes from the body origin CO unless a field says otherwise.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

LANES = 16

Record = Any
"""Record of a structured array; the dtypes are below."""
Rows = NDArray[np.float64]
"""Field of a block, (..., LANES)"""
Pair = tuple[float, float]
Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Matrix = tuple[Vector, Vector, Vector]


def record(**fields: Any) -> np.dtype[Any]:
    """Return a record type with `fields`; each value is a shape of floats, a type, or another record type."""
    return np.dtype(
        (np.record, [(n, t) if not isinstance(t, tuple) else (n, np.float64, t) for n, t in fields.items()])
    )


def side_by_side(one: np.dtype[Any]) -> np.dtype[Any]:
    """Return the record type `one` for LANES vehicles: each number becomes a row of LANES numbers."""
    fields: dict[str, Any] = {}
    for name in one.names or ():
        kind = one[name]
        fields[name] = side_by_side(kind) if kind.names else (*kind.shape, LANES)
    return record(**fields)


# --- Rows of the arrays of a batch ------------------------------------------------------------------------------------------------
POSE = record(position=(3,), attitude=(4,))  # world axes; quaternion (w, x, y, z), body to world
VELOCITY = record(linear=(3,), angular=(3,))  # nu = [v; omega], m/s and rad/s
WRENCH = record(force=(3,), torque=(3,))  # N, N m
CURRENT = record(
    velocity=(3,),  # world axes, m/s, at depths above `top`
    change=(3,),  # velocity at the bottom of the profile minus `velocity`, m/s
    top=(),  # z, m
    per_thickness=(),  # 1/m; 0: uniform
)
CURRENT_COLUMNS = CURRENT.itemsize // 8

# --- One vehicle ------------------------------------------------------------------------------------------------------------------
STATE = record(  # eta = [position; attitude], nu = [velocity; rates] = [v; omega]
    position=(3,), attitude=(4,), velocity=(3,), rates=(3,)
)
# A symmetric 3 x 3 matrix: xx yy zz xy xz yz. A symmetric 6 x 6 matrix: blocks M = [M11 M12; M12^T M22] (Fossen 2011, theorem 3.2).
SYMMETRIC = (6,)
SYMMETRIC_6 = record(M11=SYMMETRIC, M12=(3, 3), M22=SYMMETRIC)
VEHICLE = record(
    m=(),  # kg
    m_r_g=(3,),  # m r_g, kg m
    I_b=SYMMETRIC,  # inertia about CO, kg m2
    M_A=SYMMETRIC_6,
    # M_A as C_A(nu_r) nu_r uses it: 0 if the sheet switches this term off, -M_A if the sheet selects a Gazebo release.
    M_A_coriolis=SYMMETRIC_6,
    D=VELOCITY,  # linear damping of v_r (N s/m) and omega (N m s)
    D_n=VELOCITY,  # quadratic damping (N s2/m2, N m s2)
    B_minus_W=(),  # N
    B_r_b_minus_W_r_g=(3,),  # N m
    M_inverse=SYMMETRIC_6,  # (M_RB + M_A)^-1
    thrust_factor=(),  # factor on all thrust
    lag_factor=(),  # factor on the time constant of thrusters with a first-order lag
    displaced=(),  # mass of the displaced water rho V, kg
    displaced_r_b=(3,),  # rho V r_b, kg m
)
PARAMETER_ROWS = VEHICLE.itemsize // 8
# How a vehicle differs from its sheet. The numbers are factors, one for each axis, unless a comment says otherwise.
CHANGE = record(
    mass=(),  # factor on the mass; the net buoyancy stays
    inertia=(3,),  # factors on the inertia about the centre of gravity
    added_mass=(6,),
    linear_damping=(6,),
    quadratic_damping=(6,),
    lag=(),  # factor on the time constant of thrusters with a first-order lag
    net_buoyancy=(),  # N, added
    center_of_buoyancy_z=(),  # m, added
)
ADDED = "net_buoyancy", "center_of_buoyancy_z"
"""Fields of `CHANGE` that are added; all others are factors."""


def unchanged(n: int) -> NDArray[Any]:
    """Return records (n,) of `CHANGE` for vehicles that do not differ from their sheet."""
    changes = np.zeros(n, CHANGE)
    for name in CHANGE.names or ():
        changes[name] = 0.0 if name in ADDED else 1.0
    return changes


# --- A block of vehicles ----------------------------------------------------------------------------------------------------------
WORKSPACE = side_by_side(
    record(
        vehicle=VEHICLE,
        x=STATE,  # at the start of a substep
        y=STATE,  # at the present stage
        s=STATE,  # sum of the stages
        tau=WRENCH,  # sum of the wrenches of thrusters, appendages and `external`
        external=WRENCH,
        current=CURRENT,
        # Terms that a diagonal added mass does not have: momenta of the off-diagonal entries, and a wrench to subtract.
        extra=record(p=(3,), h=(3,), force=(3,), torque=(3,)),
        force=(),  # force of the present thruster, N
        # Waves: the position and time for which they are computed, and the water's acceleration in world axes.
        waves=record(x=(), y=(), depth=(), time=(), acceleration=(3,)),
    )
)
ROWS = WORKSPACE.itemsize // 8 // LANES

# --- Actuators --------------------------------------------------------------------------------------------------------------------
THRUSTER, FIN, MASS_SHIFTER, BUOYANCY_ENGINE, DROP_WEIGHT = range(5)
LINEAR_CURVE, TABLE_CURVE, POLYNOMIAL_CURVE = range(3)
POWER_TABLE = 0
"""Index of the table of electrical power over force"""
POWER_POINTS = 1025
"""Number of points of the table of electrical power over force; odd, so that force 0 is one of the points"""
ACTUATOR = record(
    kind=np.int64,  # THRUSTER, ...
    # Static curve.
    curve=np.int64,  # LINEAR_CURVE, ...
    low=(),
    high=(),
    neutral=(),
    table=np.int64,  # row of the table of curves
    entries=np.int64,  # number of entries of that row
    # Dynamics.
    order=np.int64,
    first_state=np.int64,  # index of this actuator's first state among the states of all actuators
    rate=(),  # largest rate of a rate-limited actuator, per second; 0: no limit
    # Thruster.
    rotor=(),  # force over n |n| with n in rad/s, N s2/rad2; 0 where the curve gives newtons
    per_newton=WRENCH,  # wrench [e; r x e]
    force_scale=(),  # factor on the force before the table of power is read
    power_scale=(),  # factor on the table's power
    points_per_newton=(),  # points of the table of power per newton
    # All actuators except thrusters.
    position=(3,),  # m
    axis=(3,),
    upward=(),  # mass shifter: its weight, N; buoyancy engine: N per m3; drop weight: N when released
    # Fin.
    area=(),  # m2
    lift_slope=(),  # 1/rad
    lift_slope_stall=(),
    drag_slope=(),
    drag_slope_stall=(),
    stall_angle=(),  # rad
    density=(),  # kg/m3
)
# Exact discretisation of an actuator's dynamics for half a substep: x' = A x + B u, y = C x.
DISCRETE = record(A=(3, 3), B=(3,), C=(3,), half_step=())

# --- Waves ------------------------------------------------------------------------------------------------------------------------
COMPONENT = record(
    turns=(), frequency=(), speed=()
)  # 1 / wave length in 1/m, Hz, amplitude of the surface's velocity in m/s
RAY = record(
    cosine=(LANES,), sine=(LANES,), phase=(LANES,)
)  # direction of a component, and its phase in turns, for each vehicle of a block
