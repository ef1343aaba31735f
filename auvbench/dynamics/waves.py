"""Linear (Airy) waves on deep water: the components of a spectrum, and their effect on a block of vehicles, compiled.

At depth d, a component of amplitude a, wave number k, frequency w (w^2 = g k) and direction (c, s) moves the water with

    v = a w exp(-k d) (c cos theta, s cos theta, sin theta),     theta = k (c x + s y) - w t + phi
    v' = a w^2 exp(-k d) (c sin theta, s sin theta, -cos theta)

(Faltinsen 1990, chapter 2; z is up here). The components add up. A vehicle feels v as part of the water's velocity and
v' as the inertia force (M_A + rho V) v' of the accelerated water: added mass and Froude-Krylov force, the latter at the
centre of buoyancy. v' is the local derivative, as in linear theory: terms of second order in the wave's steepness are
left out. v and v' are computed once per substep, for the middle of the substep and the vehicle's position at that time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from auvbench.dynamics.compiled import inline
from auvbench.dynamics.lanes import (
    add3,
    diagonal,
    four,
    matrix,
    off_diagonal,
    put3,
    subtract3,
    symmetric_of,
    three,
    vector,
)
from auvbench.dynamics.layout import (
    COMPONENT,
    LANES,
    RAY,
    Record,
)
from auvbench.dynamics.vectors import (
    ZERO,
    add,
    plus_cross,
    product,
    rotation_matrix,
    scale,
    transposed_product,
)

FloatArray = NDArray[np.float64]

COMPONENTS = 32
GAMMA = {"jonswap": 3.3, "pierson_moskowitz": 1.0}
"""Peak enhancement of each spectrum"""
LOWEST, HIGHEST = 0.4, 6.0
"""Band of the components' frequencies, as multiples of the peak frequency; it contains 99.9 % of the energy"""
DEEPEST = 32.0
"""Value of k d above which exp(-k d) no longer decreases but stays at 1e-14"""

# Taylor coefficients of sine and cosine about 0, and of the exponential function about -1/2.
S3, S5, S7, S9, S11, S13 = ((-1.0) ** (n // 2) / math.factorial(n) for n in range(3, 14, 2))
C2, C4, C6, C8, C10, C12, C14 = ((-1.0) ** (n // 2) / math.factorial(n) for n in range(2, 15, 2))
E0, E1, E2, E3, E4, E5, E6, E7, E8, E9, E10 = (math.exp(-0.5) / math.factorial(n) for n in range(11))

# Indices of the rows of `Waves.rays`.
COSINE, SINE, PHASE = (RAY.names.index(name) for name in ("cosine", "sine", "phase"))  # type: ignore[union-attr]


@dataclass(slots=True)
class Waves:
    """Waves that act on n vehicles."""

    components: FloatArray  # (m, 3) `layout.COMPONENT`: 1 / wave length in 1/m, frequency in Hz, amplitude of the surface's velocity in m/s
    rays: FloatArray  # (blocks, m, 3, LANES) `layout.RAY`: cosine and sine of the direction, phase at time 0 in turns
    time: FloatArray  # (n,) time at the start of the next step, s


def still(n: int) -> Waves:
    """Return waves without components for n vehicles."""
    return on(np.zeros((0, 3)), n)


def on(components: FloatArray, n: int) -> Waves:
    """Return waves with `components` (m, 3) for n vehicles; all rays are zero until the caller writes them."""
    return Waves(components, np.zeros((-(-n // LANES), len(components), 3, LANES)), np.zeros(n))


def density(frequency: FloatArray, height: float, period: float, spectrum: str) -> FloatArray:
    """Return the spectral density S(w) in m2 s at angular frequencies > 0; for JONSWAP, without a constant factor.

    The spectra are JONSWAP (Hasselmann et al. 1973) and, with a peak enhancement of 1, Pierson-Moskowitz (1964), in the
    form of DNV-RP-C205, section 3.5; Fossen 2021, section 10.2. JONSWAP's constant factor, which this function leaves
    out, would make the integral (height / 4)^2.

    Args:
        frequency: angular frequencies, rad/s.
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
    """Return the components (COMPONENTS, 3) of a sea, in the form of `Waves.components`.

    Each component represents a bin of the spectrum and has the bin's energy and the bin's variance of the surface's
    velocity. A bin has a fraction of the total energy and a fraction of the total variance; the mean of these two
    fractions is the same for all bins.
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


@inline
def sine_cosine(turns: float) -> tuple[float, float]:
    """Return sine and cosine of an angle in turns, with an error of at most 3e-9.

    This function compiles to vector instructions and returns the same bits on every machine.
    """
    half = math.pi * (turns - np.floor(turns + 0.5))
    q = half * half
    s = half * (1.0 + q * (S3 + q * (S5 + q * (S7 + q * (S9 + q * (S11 + q * S13))))))
    c = 1.0 + q * (C2 + q * (C4 + q * (C6 + q * (C8 + q * (C10 + q * (C12 + q * C14))))))
    return 2.0 * s * c, 1.0 - 2.0 * s * s


@inline
def decay(depth: float) -> float:
    """Return exp(-depth) for a depth >= 0 in units of 1/k, with a relative error of at most 1e-9.

    This function compiles to vector instructions and returns the same bits on every machine.
    """
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
    ws: Record,
    block: int,
    currents: Record,
    components: FloatArray,
    rays: FloatArray,
    time: FloatArray,
    begin: float,
    half: float,
) -> None:
    """Set the water's velocity and acceleration for a substep of 2 `half` s that starts `begin` s after the step's start."""
    last = time.shape[0] - 1
    x, current, waves = ws.x, ws.current, ws.waves
    for lane in range(LANES):
        i = min(block * LANES + lane, last)
        eta_dot = product(rotation_matrix(four(x.attitude, lane)), three(x.velocity, lane))
        waves.x[lane], waves.y[lane], z = add(three(x.position, lane), scale(half, eta_dot))
        waves.depth[lane] = max(-z, 0.0)  # above the mean surface, the water moves as at the surface
        waves.time[lane] = time[i] + begin + half
        put3(current.velocity, lane, vector(currents[i].velocity))
        put3(waves.acceleration, lane, ZERO)
    sea, beams = components.reshape(-1).view(COMPONENT), rays[block].reshape(-1).view(RAY)
    for m in range(sea.shape[0]):
        ray = beams[m]
        turns, frequency, speed = sea[m].turns, sea[m].frequency, sea[m].speed
        k, omega = 2.0 * math.pi * turns, 2.0 * math.pi * frequency
        for lane in range(LANES):
            c, s = ray.cosine[lane], ray.sine[lane]
            along = c * waves.x[lane] + s * waves.y[lane]
            theta = turns * along - frequency * waves.time[lane] + ray.phase[lane]
            sine, cosine = sine_cosine(theta)
            size = speed * decay(k * waves.depth[lane])
            sine *= size
            cosine *= size
            add3(current.velocity, lane, (c * cosine, s * cosine, sine))
            sine *= omega
            add3(waves.acceleration, lane, (c * sine, s * sine, -(omega * cosine)))


@inline
def pressure_head(
    components: FloatArray, rays: FloatArray, lane: int, time: float, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """Return the waves' pressure head at a point, m, the head's variance over time, m2, and the head's mean frequency, Hz.

    The pressure head is pressure / (density gravity), the sum of a exp(-k d) cos theta over the components.

    Args:
        components: (m, 3) components of `Waves`.
        rays: (m, 3, LANES) rays of the vehicle's block.
        lane: lane of the vehicle in the block.
        time: time, s.
        x: east coordinate, m.
        y: north coordinate, m.
        z: height over the mean surface, m; above the surface, the pressure head of the surface applies.
    """
    head, variance, weighted = 0.0, 0.0, 0.0
    for m in range(components.shape[0]):
        turns, frequency, speed = components[m]
        c, s, phase = three(rays[m], lane)
        _, cosine = sine_cosine(turns * (c * x + s * y) - frequency * time + phase)
        amplitude = speed / (2.0 * math.pi * frequency) * decay(2.0 * math.pi * turns * max(-z, 0.0))
        head += amplitude * cosine
        variance += 0.5 * amplitude * amplitude
        weighted += 0.5 * amplitude * amplitude * frequency
    return head, variance, weighted / variance if variance > 0.0 else 0.0


@njit(nogil=True)
def add_water_inertia(ws: Record) -> None:
    """Add the force of the accelerated water at the present stage, (M_A + rho V) v'.

    The function subtracts the force from the wrench of `ws.extra`, because `runge_kutta_stage` subtracts that wrench.
    """
    vehicle, y, extra = ws.vehicle, ws.y, ws.extra
    M_A = vehicle.M_A
    for lane in range(LANES):
        R = rotation_matrix(four(y.attitude, lane))
        v_dot = transposed_product(R, three(ws.waves.acceleration, lane))
        mass = vehicle.displaced[lane]
        A11 = symmetric_of(add(diagonal(M_A.M11, lane), (mass, mass, mass)), off_diagonal(M_A.M11, lane))
        subtract3(extra.force, lane, product(A11, v_dot))
        torque = transposed_product(matrix(M_A.M12, lane), v_dot)
        subtract3(extra.torque, lane, plus_cross(torque, three(vehicle.displaced_r_b, lane), v_dot))
