"""Fossen's equations of motion for one vehicle, matrix by matrix, and two ways to integrate them.

T. I. Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control, Wiley 2011 (2nd edition 2021). The names
are the book's: eta the pose, nu the body velocity, nu_r the velocity through the water, tau the wrench.

The matrices look the same in NED/FRD and in ENU/FLU, because one frame is the other turned by pi about the x
axis; only the direction of gravity along the world's z axis differs, and that is `Body.down`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Array = NDArray[np.float64]
Wrench = Callable[[float, Array], Array]
"""(time, state (13,)) -> wrench (6,) on the body at its origin CO, in the body frame."""

NED, ENU = 1.0, -1.0
HALF_TURN = np.diag([1.0, -1.0, -1.0])
"""From FRD to FLU and back; also from one world frame to the other, up to a yaw angle (see `flipped`)."""


def skew(a: Array) -> Array:
    """S(a), with S(a) b = a x b (Fossen 2011, definition 2.2)."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def rotation(q: Array) -> Array:
    """R(q), body to world, of a unit quaternion (w, x, y, z) (Fossen 2011, eq. 2.65)."""
    return np.eye(3) + 2.0 * q[0] * skew(q[1:]) + 2.0 * skew(q[1:]) @ skew(q[1:])


def quaternion(phi: float, theta: float, psi: float) -> Array:
    """The unit quaternion (w, x, y, z) of roll, pitch and yaw, in the z-y-x convention."""
    c, s = np.cos(np.array([phi, theta, psi]) / 2), np.sin(np.array([phi, theta, psi]) / 2)
    return np.array(
        [
            c[0] * c[1] * c[2] + s[0] * s[1] * s[2],
            s[0] * c[1] * c[2] - c[0] * s[1] * s[2],
            c[0] * s[1] * c[2] + s[0] * c[1] * s[2],
            c[0] * c[1] * s[2] - s[0] * s[1] * c[2],
        ]
    )


def euler(R: Array) -> tuple[float, float, float]:
    """Roll, pitch and yaw of a rotation matrix, in the z-y-x convention."""
    theta = -np.arcsin(np.clip(R[2, 0], -1.0, 1.0))
    return float(np.arctan2(R[2, 1], R[2, 2])), float(theta), float(np.arctan2(R[1, 0], R[0, 0]))


def coriolis_of(M: Array, nu: Array) -> Array:
    """C(nu) of any symmetric mass matrix (Kirchhoff; Fossen 2011, theorem 3.2), skew-symmetric."""
    momentum = -skew(M[:3, :3] @ nu[:3] + M[:3, 3:] @ nu[3:])
    angular_momentum = -skew(M[3:, :3] @ nu[:3] + M[3:, 3:] @ nu[3:])
    return np.block([[np.zeros((3, 3)), momentum], [momentum, angular_momentum]])


def plugins_matrix(Ma: Array, state: Array, release: str) -> Array:
    """`Cmat` of Gazebo's Hydrodynamics plugin, entry by entry as its source has it.

    `Ma` has Fossen's signs (its diagonal is negative). gz-sim-8.11: Hydrodynamics.cc of gz-sim8_8.6.0. gz-sim-8.12:
    the same with the two entries that #3456 mended.
    """
    u, v, w, p, q, r = state
    X, Y, Z, K, M, N = np.diag(Ma)
    C = np.zeros((6, 6))
    C[0, 4] = -Z * w
    C[0, 5] = -Y * v
    C[1, 3] = Z * w
    C[1, 5] = -X * u
    C[2, 3] = -Y * v
    C[2, 4] = X * u
    C[3, 1] = -Z * w
    C[3, 2] = Y * v
    C[3, 4] = -N * r
    C[3, 5] = M * q
    C[4, 0] = Z * w
    C[4, 2] = -X * u
    C[4, 3] = N * r
    C[4, 5] = -K * p
    C[5, 0] = Z * w
    C[5, 1] = X * u
    C[5, 3] = -M * q
    C[5, 4] = K * p
    if release == "gz-sim-8.12":
        C[0, 5] = Y * v
        C[5, 0] = -Y * v
    return C


@dataclass(frozen=True)
class Body:
    """A rigid body in water: the numbers of a data sheet, about the body's origin CO unless it says otherwise."""

    name: str
    m: float
    """kg"""
    r_g: Array
    """(3,) m, centre of gravity"""
    I_g: Array
    """(3, 3) kg m2, inertia about the centre of gravity"""
    M_A: Array
    """(6, 6) added mass, positive"""
    D_l: Array
    """(6,) linear damping, positive"""
    D_q: Array
    """(6,) quadratic damping, positive"""
    W: float
    """N"""
    B: float
    """N"""
    r_b: Array
    """(3,) m, centre of buoyancy"""
    down: float
    """direction of gravity along the world's z axis: `NED` or `ENU`"""
    added_coriolis: bool = True
    """False drops C_A(nu_r) nu_r, as the LRAUV's own simulation does"""
    plugin: str = ""
    """release of gz-sim whose Hydrodynamics plugin applies +`plugins_matrix` nu_r instead of -C_A(nu_r) nu_r"""

    def M_RB(self) -> Array:
        """Rigid-body mass matrix about CO (Fossen 2011, eq. 3.44, with I_b = I_g - m S(r_g)^2, eq. 3.36)."""
        S = skew(self.r_g)
        return np.block([[self.m * np.eye(3), -self.m * S], [self.m * S, self.I_g - self.m * S @ S]])

    def M(self) -> Array:
        return self.M_RB() + self.M_A

    def C_RB(self, nu: Array) -> Array:
        """Rigid-body Coriolis, the form without linear velocity (Fossen 2011, eq. 3.57)."""
        S, W = skew(self.r_g), skew(nu[3:])
        I_b = self.I_g - self.m * S @ S
        return np.block([[self.m * W, -self.m * W @ S], [self.m * S @ W, -skew(I_b @ nu[3:])]])

    def C_A(self, nu_r: Array) -> Array:
        if self.plugin:
            return -plugins_matrix(-self.M_A, nu_r, self.plugin)
        return coriolis_of(self.M_A, nu_r) if self.added_coriolis else np.zeros((6, 6))

    def D(self, nu_r: Array) -> Array:
        """Linear and quadratic damping, diagonal (Fossen 2011, eq. 6.54 without coupling)."""
        return np.diag(self.D_l + self.D_q * np.abs(nu_r))

    def g(self, R: Array) -> Array:
        """Restoring wrench on the left-hand side (Fossen 2011, eq. 4.5), from the two forces it stands for."""
        weight = R.T @ np.array([0.0, 0.0, self.down * self.W])
        buoyancy = R.T @ np.array([0.0, 0.0, -self.down * self.B])
        return -np.concatenate([weight + buoyancy, np.cross(self.r_g, weight) + np.cross(self.r_b, buoyancy)])

    def energy(self, state: Array, current: Array | None = None) -> float:
        """J: kinetic energy of the body and of the water that it drives (at rest), and the potential energy."""
        R, nu = rotation(state[3:7]), state[7:]
        height = -self.down
        potential = self.W * height * (state[:3] + R @ self.r_g)[2]
        potential -= self.B * height * (state[:3] + R @ self.r_b)[2]
        return float(0.5 * nu @ self.M() @ nu + potential)

    def derivative(self, state: Array, tau: Array, current: Array) -> Array:
        """d/dt of the state (13,) = position, quaternion (w, x, y, z), nu, in a constant current (3,) in the world.

        M_RB nu_dot + C_RB(nu) nu + M_A nu_r_dot + C_A(nu_r) nu_r + D(nu_r) nu_r + g = tau (Fossen 2011,
        eq. 8.21), with nu_c = (R^T v_c, 0), whose derivative in the turning body frame is (-omega x v_c, 0).
        """
        q, nu = state[3:7], state[7:]
        R, omega = rotation(q), nu[3:]
        nu_c = np.concatenate([R.T @ current, np.zeros(3)])
        nu_c_dot = np.concatenate([-np.cross(omega, nu_c[:3]), np.zeros(3)])
        nu_r = nu - nu_c
        forces = (
            tau
            - self.C_RB(nu) @ nu
            - self.C_A(nu_r) @ nu_r
            - self.D(nu_r) @ nu_r
            - self.g(R)
            + self.M_A @ nu_c_dot
        )
        nu_dot = np.linalg.solve(self.M(), forces)
        q_dot = 0.5 * np.concatenate([[-q[1:] @ omega], q[0] * omega + np.cross(q[1:], omega)])
        return np.concatenate([R @ nu[:3], q_dot, nu_dot])

    def flipped(self) -> Body:
        """The same vehicle described in the other frame (NED/FRD for ENU/FLU and back)."""
        T6 = np.kron(np.eye(2), HALF_TURN)
        return replace(
            self,
            r_g=HALF_TURN @ self.r_g,
            I_g=HALF_TURN @ self.I_g @ HALF_TURN,
            M_A=T6 @ self.M_A @ T6,
            r_b=HALF_TURN @ self.r_b,
            down=-self.down,
        )


def rk4(f: Callable[[float, Array], Array], t: float, state: Array, h: float) -> Array:
    """One classical Runge-Kutta step of length h, with the quaternion brought back to length 1."""
    k1 = f(t, state)
    k2 = f(t + h / 2, state + h / 2 * k1)
    k3 = f(t + h / 2, state + h / 2 * k2)
    k4 = f(t + h, state + h * k3)
    after = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    after[3:7] /= np.linalg.norm(after[3:7])
    return after


def state_at(position: object = (0, 0, 0), angles: object = (0, 0, 0), nu: object = (0,) * 6) -> Array:
    """The state (13,) at a position, roll, pitch and yaw, and a body velocity."""
    return np.concatenate([np.asarray(position, float), quaternion(*angles), np.asarray(nu, float)])  # type: ignore[misc]


def constant(wrench: object) -> Wrench:
    tau = np.asarray(wrench, float)
    return lambda t, state: tau


def simulate(
    body: Body,
    state: Array,
    times: Array,
    wrench: Wrench,
    current: object = (0, 0, 0),
    step: float | None = None,
) -> Array:
    """States (T, 13) at `times`, in a current (3,) or one that is a function of z: RK4 with equal steps no longer than `step`, or DOP853 at rtol 1e-12 without."""

    def f(t: float, y: Array) -> Array:
        v_c = np.asarray(current(y[2]) if callable(current) else current, float)
        return body.derivative(y, wrench(t, y), v_c)

    if step is None:
        solution = solve_ivp(f, (times[0], times[-1]), state, "DOP853", times, rtol=1e-12, atol=1e-13)
        assert solution.success, solution.message
        return np.ascontiguousarray(solution.y.T)
    states = [state]
    for before, after in pairwise(times):
        substeps = int(np.ceil((after - before) / step - 1e-9))
        h = (after - before) / substeps
        for k in range(substeps):
            state = rk4(f, before + k * h, state, h)
        states.append(state)
    return np.array(states)


def as_csv(states: Array) -> Array:
    """Rows (T, 12) in the order of the reference files: x y z phi theta psi u v w p q r, psi unwrapped."""
    angles = np.array([euler(rotation(s[3:7] / np.linalg.norm(s[3:7]))) for s in states])
    angles[:, 2] = np.unwrap(angles[:, 2])
    return np.column_stack([states[:, :3], angles, states[:, 7:]])
