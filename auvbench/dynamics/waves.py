# ruff: noqa: E741  (l is the lane, as in the layout)
"""Linear (Airy) waves on deep water: their spectrum as components, and what they do to a block of vehicles, compiled.

At depth d, a component of amplitude a, wave number k, frequency w (w^2 = g k) and direction (c, s) moves the water with

    v = a w exp(-k d) (c cos theta, s cos theta, sin theta),     theta = k (c x + s y) - w t + phi
    v' = a w^2 exp(-k d) (c sin theta, s sin theta, -cos theta)

(Faltinsen 1990, chapter 2; z is up here). The components add up. A vehicle feels v as part of the water's velocity and
v' as the inertia force (M_A + rho V) v' of the accelerated water: added mass and Froude-Krylov force, the latter at the
centre of buoyancy. v' is the local derivative, as linear theory has it: what is of second order in the wave's steepness
is left out.

Both are taken once per substep, in its middle, at the place that the vehicle reaches there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from auvbench.dynamics.layout import (
    ADDED,
    ADDED_OFF,
    CURRENT,
    DISPLACED,
    EXTRA,
    LANES,
    PLACE,
    WATER,
    X,
    Y,
)

FloatArray = NDArray[np.float64]
L = LANES

COMPONENTS = 32
GAMMA = {"jonswap": 3.3, "pierson_moskowitz": 1.0}
"""peak enhancement of the spectra"""
LOWEST, HIGHEST = 0.4, 6.0
"""band of the components, in peak frequencies: 99.9 % of the energy"""
DEEPEST = 32.0
"""k d below which exp(-k d), 1e-14, no longer falls"""

# Taylor coefficients of sine, cosine and, about -1/2, the exponential function.
S3, S5, S7, S9, S11, S13 = ((-1.0) ** (n // 2) / math.factorial(n) for n in range(3, 14, 2))
C2, C4, C6, C8, C10, C12, C14 = ((-1.0) ** (n // 2) / math.factorial(n) for n in range(2, 15, 2))
E0, E1, E2, E3, E4, E5, E6, E7, E8, E9, E10 = (math.exp(-0.5) / math.factorial(n) for n in range(11))

# Columns of the components, and rows of the rays.
TURNS, FREQUENCY, SPEED = range(3)
COSINE, SINE, PHASE = range(3)


@dataclass(slots=True)
class Waves:
    """Waves on n vehicles."""

    components: FloatArray  # (m, 3) 1 / wave length in 1/m, frequency in Hz, amplitude of the surface's velocity in m/s
    rays: FloatArray  # (blocks, m, 3, LANES) cosine and sine of the direction, phase at time 0 in turns
    time: FloatArray  # (n,) s, at the start of the next step


def still(n: int) -> Waves:
    """Return no waves on n vehicles."""
    return on(np.zeros((0, 3)), n)


def on(components: FloatArray, n: int) -> Waves:
    """Return waves of `components` (m, 3) on n vehicles, their rays still to be written."""
    return Waves(components, np.zeros((-(-n // L), len(components), 3, L)), np.zeros(n))


def density(frequency: FloatArray, height: float, period: float, spectrum: str) -> FloatArray:
    """Return the spectral density S(w) in m2 s at angular frequencies > 0 in rad/s, up to a factor for JONSWAP.

    JONSWAP (Hasselmann et al. 1973) and, with a peak enhancement of 1, Pierson-Moskowitz (1964), in the form of
    DNV-RP-C205, section 3.5; Fossen 2021, section 10.2. The factor makes the integral (height / 4)^2.

    Args:
        frequency: rad/s.
        height: significant height Hs in m.
        period: peak period Tp in s.
        spectrum: a key of `GAMMA`.
    """
    peak = 2.0 * math.pi / period
    ratio = frequency / peak
    width = np.where(ratio <= 1.0, 0.07, 0.09)
    enhanced = GAMMA[spectrum] ** np.exp(-0.5 * ((ratio - 1.0) / width) ** 2)
    return np.asarray(0.3125 * height**2 / peak * ratio**-5.0 * np.exp(-1.25 * ratio**-4.0) * enhanced)


def components(height: float, period: float, spectrum: str, gravity: float) -> FloatArray:
    """Return the components (COMPONENTS, 3) of a sea, as `Waves` has them.

    Each stands for a bin of the spectrum and keeps its energy and the variance of the surface's velocity. The bins are
    narrow where one of both is large: each has the same share of their mean.
    """
    peak = 2.0 * math.pi / period
    w = np.linspace(LOWEST * peak, HIGHEST * peak, 20_001)
    S = density(w, height, period, spectrum)
    energy = np.concatenate(([0.0], np.cumsum(0.5 * (S[1:] + S[:-1])) * (w[1] - w[0])))
    moved = S * w**2
    motion = np.concatenate(([0.0], np.cumsum(0.5 * (moved[1:] + moved[:-1])) * (w[1] - w[0])))
    scale = (height / 4.0) ** 2 / energy[-1]
    share = 0.5 * (energy / energy[-1] + motion / motion[-1])
    edges = np.interp(np.linspace(0.0, 1.0, COMPONENTS + 1), share, w)
    energies, motions = (np.diff(np.interp(edges, w, sums)) * scale for sums in (energy, motion))
    frequency = np.sqrt(motions / energies)
    wave_number = frequency**2 / gravity
    speed = np.sqrt(2.0 * motions)
    return np.column_stack([wave_number / (2.0 * math.pi), frequency / (2.0 * math.pi), speed])


@njit(nogil=True)
def sine_cosine(turns: float) -> tuple[float, float]:
    """Sine and cosine of an angle in turns, within 3e-9: in vector instructions, and the same bits on any machine."""
    half = math.pi * (turns - np.floor(turns + 0.5))
    q = half * half
    s = half * (1.0 + q * (S3 + q * (S5 + q * (S7 + q * (S9 + q * (S11 + q * S13))))))
    c = 1.0 + q * (C2 + q * (C4 + q * (C6 + q * (C8 + q * (C10 + q * (C12 + q * C14))))))
    return 2.0 * s * c, 1.0 - 2.0 * s * s


@njit(nogil=True)
def decay(depth: float) -> float:
    """exp(-depth) for a depth of at least 0 in units of 1/k, within 1e-9 of its value; the same advantages."""
    x = 0.5 - min(depth, DEEPEST) * (1.0 / DEEPEST)
    e = E0 + x * (
        E1 + x * (E2 + x * (E3 + x * (E4 + x * (E5 + x * (E6 + x * (E7 + x * (E8 + x * (E9 + x * E10))))))))
    )
    e *= e
    e *= e
    e *= e
    e *= e
    return e * e


@njit(nogil=True)
def move_water(
    ws: FloatArray,
    block: int,
    current: FloatArray,
    components: FloatArray,
    rays: FloatArray,
    time: FloatArray,
    begin: float,
    half: float,
) -> None:
    """Set the water's velocity and acceleration for the substep that begins `begin` s into the step and lasts 2 `half` s."""
    last = time.shape[0] - 1
    for l in range(L):
        i = min(block * L + l, last)
        qw = ws[(X + 3) * L + l]
        qx = ws[(X + 4) * L + l]
        qy = ws[(X + 5) * L + l]
        qz = ws[(X + 6) * L + l]
        u = ws[(X + 7) * L + l]
        v = ws[(X + 8) * L + l]
        w = ws[(X + 9) * L + l]
        ws[PLACE * L + l] = ws[X * L + l] + half * (
            (1.0 - 2.0 * (qy * qy + qz * qz)) * u + 2.0 * (qx * qy - qw * qz) * v + 2.0 * (qx * qz + qw * qy) * w
        )  # fmt: skip
        ws[(PLACE + 1) * L + l] = ws[(X + 1) * L + l] + half * (
            2.0 * (qx * qy + qw * qz) * u + (1.0 - 2.0 * (qx * qx + qz * qz)) * v + 2.0 * (qy * qz - qw * qx) * w
        )  # fmt: skip
        z = ws[(X + 2) * L + l] + half * (
            2.0 * (qx * qz - qw * qy) * u + 2.0 * (qy * qz + qw * qx) * v + (1.0 - 2.0 * (qx * qx + qy * qy)) * w
        )  # fmt: skip
        ws[(PLACE + 2) * L + l] = max(-z, 0.0)  # above the mean surface the water moves as at it
        ws[(PLACE + 3) * L + l] = time[i] + begin + half
        for j in range(3):
            ws[(CURRENT + j) * L + l] = current[i, j]
            ws[(WATER + j) * L + l] = 0.0
    for m in range(components.shape[0]):
        turns = components[m, TURNS]
        frequency = components[m, FREQUENCY]
        speed = components[m, SPEED]
        k = 2.0 * math.pi * turns
        rate = 2.0 * math.pi * frequency
        for l in range(L):
            c = rays[block, m, COSINE, l]
            s = rays[block, m, SINE, l]
            along = c * ws[PLACE * L + l] + s * ws[(PLACE + 1) * L + l]
            sine, cosine = sine_cosine(
                turns * along - frequency * ws[(PLACE + 3) * L + l] + rays[block, m, PHASE, l]
            )
            size = speed * decay(k * ws[(PLACE + 2) * L + l])
            sine *= size
            cosine *= size
            ws[CURRENT * L + l] += c * cosine
            ws[(CURRENT + 1) * L + l] += s * cosine
            ws[(CURRENT + 2) * L + l] += sine
            sine *= rate
            ws[WATER * L + l] += c * sine
            ws[(WATER + 1) * L + l] += s * sine
            ws[(WATER + 2) * L + l] -= rate * cosine


@njit(nogil=True)
def clear_extra(ws: FloatArray) -> None:
    """Zero the terms that `add_inertia` adds to, for vehicles without off-diagonal added mass."""
    for l in range(6 * L):
        ws[(EXTRA + 6) * L + l] = 0.0


@njit(nogil=True)
def add_inertia(ws: FloatArray) -> None:
    """Add the inertia force of the accelerated water at the present stage; what is taken from `EXTRA` is subtracted."""
    for l in range(L):
        qw = ws[(Y + 3) * L + l]
        qx = ws[(Y + 4) * L + l]
        qy = ws[(Y + 5) * L + l]
        qz = ws[(Y + 6) * L + l]
        wx = ws[WATER * L + l]
        wy = ws[(WATER + 1) * L + l]
        wz = ws[(WATER + 2) * L + l]
        ax = (
            (1.0 - 2.0 * (qy * qy + qz * qz)) * wx
            + 2.0 * (qx * qy + qw * qz) * wy
            + 2.0 * (qx * qz - qw * qy) * wz
        )
        ay = (
            2.0 * (qx * qy - qw * qz) * wx
            + (1.0 - 2.0 * (qx * qx + qz * qz)) * wy
            + 2.0 * (qy * qz + qw * qx) * wz
        )
        az = (
            2.0 * (qx * qz + qw * qy) * wx
            + 2.0 * (qy * qz - qw * qx) * wy
            + (1.0 - 2.0 * (qx * qx + qy * qy)) * wz
        )
        mass = ws[DISPLACED * L + l]
        bx = ws[(DISPLACED + 1) * L + l]
        by = ws[(DISPLACED + 2) * L + l]
        bz = ws[(DISPLACED + 3) * L + l]
        A = ADDED_OFF
        ws[(EXTRA + 6) * L + l] -= (
            (ws[ADDED * L + l] + mass) * ax + ws[A * L + l] * ay + ws[(A + 1) * L + l] * az
        )
        ws[(EXTRA + 7) * L + l] -= (
            ws[A * L + l] * ax + (ws[(ADDED + 1) * L + l] + mass) * ay + ws[(A + 5) * L + l] * az
        )
        ws[(EXTRA + 8) * L + l] -= (
            ws[(A + 1) * L + l] * ax + ws[(A + 5) * L + l] * ay + (ws[(ADDED + 2) * L + l] + mass) * az
        )
        ws[(EXTRA + 9) * L + l] -= (
            ws[(A + 2) * L + l] * ax + ws[(A + 6) * L + l] * ay + ws[(A + 9) * L + l] * az + by * az - bz * ay
        )
        ws[(EXTRA + 10) * L + l] -= (
            ws[(A + 3) * L + l] * ax
            + ws[(A + 7) * L + l] * ay
            + ws[(A + 10) * L + l] * az
            + bz * ax
            - bx * az
        )
        ws[(EXTRA + 11) * L + l] -= (
            ws[(A + 4) * L + l] * ax
            + ws[(A + 8) * L + l] * ay
            + ws[(A + 11) * L + l] * az
            + bx * ay
            - by * ax
        )
