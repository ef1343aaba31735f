"""Rows of the kernel's workspace and columns of its tables.

The kernel works on blocks of `LANES` vehicles. Everything a vehicle needs for a step lies in one workspace of
rows of `LANES` numbers, so that the innermost loops run over vehicles with constant trip count and constant
offsets from one base pointer; LLVM then turns each loop into vector instructions without run-time checks.
"""

from __future__ import annotations

LANES = 16

# State, stage state and Runge-Kutta sum: x y z qw qx qy qz u v w p q r.
STATE_ROWS = 13
X = 0
Y = X + STATE_ROWS
S = Y + STATE_ROWS
# Wrench of everything but water and weight, body axes at the body origin.
TAU = S + STATE_ROWS

# Parameters of each vehicle (a block of these rows is stored per block of vehicles).
PARAMETERS = TAU + 6
MASS = PARAMETERS  # m
MOMENT = MASS + 1  # m r_g (3)
INERTIA = MOMENT + 3  # I_o: xx yy zz xy xz yz
ADDED = INERTIA + 6  # diagonal of M_A
CORIOLIS = ADDED + 6  # diagonal of M_A as C_A uses it: zero where C_A is switched off
LINEAR = CORIOLIS + 6
QUADRATIC = LINEAR + 6
NET = QUADRATIC + 6  # B - W
LEVER = NET + 1  # B r_b - W r_g (3)
INVERSE = LEVER + 3  # upper triangle of (M_RB + M_A)^-1, row by row (21)
ADDED_OFF = INVERSE + 21  # strict upper triangle of M_A, row by row (15)
CORIOLIS_OFF = ADDED_OFF + 15  # the same as C_A uses it (15)
THRUST = CORIOLIS_OFF + 15  # scale of all thrust
DISPLACED = THRUST + 1  # mass of the displaced water rho V, and rho V r_b (3)
PARAMETERS_END = DISPLACED + 4

# Current of each vehicle: velocity at the top depth (3), difference to the bottom (3), z of the top, 1/thickness.
CURRENT = PARAMETERS_END
CURRENT_COLUMNS = 8

# Scratch of the full added-mass path: momentum (6) and current terms (6) from off-diagonal entries.
EXTRA = CURRENT + CURRENT_COLUMNS
# External wrench (6), and the force of the actuator at hand.
EXTERNAL = EXTRA + 12
FORCE = EXTERNAL + 6
# Waves: where and when they act (x, y, depth, time), and the acceleration of the water in world axes (3).
PLACE = FORCE + 1
WATER = PLACE + 4
ROWS = WATER + 3

# Columns of the table of actuators (n_u, ACTUATOR_COLUMNS).
KIND = 0
CURVE = 1
LOW = 2
HIGH = 3
NEUTRAL = 4
TABLE = 5  # row of the table of curves
ORDER = 6
FIRST_STATE = 7  # first column of this actuator in the actuator states
ROTOR = 8
FORCE_SCALE = 9
POWER_SCALE = 10
RATE = 11  # largest rate of a rate-limited actuator, per second; 0 = none
ACTUATOR_COLUMNS = 12

# Points of the table of electrical power over force; odd, so that force 0 is one of them.
POWER_POINTS = 1025

THRUSTER, FIN, MASS_SHIFTER, BUOYANCY_ENGINE, DROP_WEIGHT = range(5)
LINEAR_CURVE, TABLE_CURVE, POLYNOMIAL_CURVE = range(3)

# Columns of the table of geometry (n_u, GEOMETRY_COLUMNS): wrench per newton (6) of a thruster; position (3) and
# axis (3) of everything else, then what its kind needs.
POSITION = 0
AXIS = 3
AREA = 6  # fin: m2
LIFT_SLOPE = 7  # 1/rad
LIFT_SLOPE_STALL = 8
DRAG_SLOPE = 9
DRAG_SLOPE_STALL = 10
STALL_ANGLE = 11  # rad
DENSITY = 12
UPWARD = 6  # mass shifter: N m per m; buoyancy engine: N per m3; drop weight: N when released
GEOMETRY_COLUMNS = 13

# Columns of the table of exact discretisations (n_u, DISCRETE_COLUMNS) for half a substep: Ad (9), Bd (3), C (3),
# and the half substep itself.
DISCRETE_B = 9
DISCRETE_C = 12
HALF_STEP = 15
DISCRETE_COLUMNS = 16
