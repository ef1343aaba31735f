"""An error-state Kalman filter with 22 states in plain NumPy: dense matrices, one step per IMU sample, vector updates."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import expm

Floats = NDArray[np.float64]
P_, V_, A_, F_, W_ = (slice(3 * k, 3 * k + 3) for k in range(5))
C_, K_, B_, Q_ = slice(15, 17), 17, 18, slice(19, 22)


def skew(a: ArrayLike) -> Floats:
    x, y, z = np.asarray(a)
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


class Filter:
    """Position, velocity (world axes), rotation body to world, biases of accelerometers and gyros, a horizontal current, scale of the DVL,
    constant error of the compass, position at the last ping.

    Args:
        state: position, velocity, rotation matrix.
        P: (22, 22) covariance of the errors; that of the attitude in world axes.
        densities: of accelerometers, gyros, and of the random walks of their biases and of the current.
    """

    def __init__(self, state: tuple[Floats, Floats, Floats], P: Floats, densities: tuple[float, ...]) -> None:
        self.p, self.v, self.R = (np.array(part) for part in state)
        self.P, self.densities = np.array(P), densities
        self.b_f, self.b_w, self.c, self.q = np.zeros(3), np.zeros(3), np.zeros(2), np.zeros(3)
        self.k = self.b = 0.0
        self.n = len(P)

    def move(self, force: Floats, rates: Floats, dt: float, gravity: float) -> None:
        f, w = force - self.b_f, rates - self.b_w
        middle = self.R @ expm(skew(0.5 * dt * w))
        a = middle @ f - [0.0, 0.0, gravity]
        self.p, self.v = self.p + dt * self.v + 0.5 * dt**2 * a, self.v + dt * a
        self.R = self.R @ expm(skew(dt * w))
        A = np.zeros((self.n, self.n))
        A[P_, V_] = np.eye(3)
        A[V_, A_], A[V_, F_] = -skew(middle @ f), -middle
        A[A_, W_] = -middle
        transition, noise = expm(dt * A), np.zeros((self.n, self.n))
        for part, density in zip((V_, A_, F_, W_, C_), self.densities, strict=True):
            rows = np.arange(self.n)[part]
            noise[rows, rows] = density**2 * dt
        self.P = transition @ self.P @ transition.T + noise

    def correct(self, innovation: ArrayLike, H: Floats, R: Floats) -> None:
        K = self.P @ H.T @ np.linalg.inv(H @ self.P @ H.T + R)
        x = K @ np.atleast_1d(innovation)
        left = np.eye(self.n) - K @ H
        self.P = left @ self.P @ left.T + K @ R @ K.T
        self.p, self.v = self.p + x[P_], self.v + x[V_]
        self.R = expm(skew(x[A_])) @ self.R
        self.b_f, self.b_w = self.b_f + x[F_], self.b_w + x[W_]
        self.c, self.q = self.c + x[C_], self.q + x[Q_]
        self.k, self.b = self.k + x[K_], self.b + x[B_]
        G = np.eye(self.n)
        G[A_, A_] += 0.5 * skew(x[A_])
        self.P = G @ self.P @ G.T

    def height(self, z: float, sd: float) -> None:
        H = np.zeros((1, self.n))
        H[0, 2] = 1.0
        self.correct(z - self.p[2], H, np.array([[sd**2]]))

    def heading(self, yaw: float, sd: float) -> None:
        def of(R: Floats) -> float:
            return float(np.arctan2(R[1, 0], R[0, 0]))

        H, small = np.zeros((1, self.n)), 1e-6
        for k in range(3):
            turn = expm(skew(small * np.eye(3)[k]))
            H[0, 6 + k] = np.angle(np.exp(1j * (of(turn @ self.R) - of(turn.T @ self.R)))) / (2.0 * small)
        H[0, B_] = 1.0
        self.correct(np.angle(np.exp(1j * (yaw - of(self.R) - self.b))), H, np.array([[sd**2]]))

    def velocity(
        self, seen: Floats, rates: Floats, lever: Floats, covariance: Floats, on_water: bool = False
    ) -> None:
        H = np.zeros((3, self.n))
        relative = self.v - [*self.c, 0.0] if on_water else self.v
        H[:, V_], H[:, A_] = self.R.T, self.R.T @ skew(relative)
        H[:, W_] = skew(lever)
        if on_water:
            H[:, C_] = -self.R.T[:, :2]
        own = self.R.T @ relative + np.cross(rates - self.b_w, lever)
        H *= 1.0 + self.k
        H[:, K_] = own
        self.correct(seen - (1.0 + self.k) * own, H, covariance)

    def ping(self) -> None:
        F = np.eye(self.n)
        F[Q_] = 0.0
        F[Q_, P_] = np.eye(3)
        self.P, self.q = F @ self.P @ F.T, self.p.copy()

    def fix(self, seen: Floats, boat: Floats, range_sd: float, angle_sd: float) -> None:
        way, there = self.q - boat, seen - boat
        r = float(np.linalg.norm(way))
        n = way / r
        across = np.eye(3) - np.outer(n, n)
        innovation = n * (np.linalg.norm(there) - r) + across @ there
        H = np.zeros((3, self.n))
        H[:, Q_] = np.eye(3)
        self.correct(innovation, H, range_sd**2 * np.outer(n, n) + (angle_sd * r) ** 2 * across)

    def through_water(self, seen: Floats, sd: float) -> None:
        H = np.zeros((3, self.n))
        through = self.v - [*self.c, 0.0]
        H[:, V_], H[:, A_], H[:, C_] = self.R.T, self.R.T @ skew(through), -self.R.T[:, :2]
        self.correct(seen - self.R.T @ through, H, sd**2 * np.eye(3))
