"""Counter-based random numbers: every draw is a pure function of its key and counter.

Philox4x32-10 of Salmon, Moraes, Dror and Shaw, "Parallel random numbers: as easy as 1, 2, 3" (SC 2011),
checked against the known-answer vectors of their Random123 library.

`(seed, stream, channel, step, episode, environment)` identifies a draw:

=========  ====================================================================
key 0      seed, 0 .. 2^32 - 1
key 1      stream: purpose of the draw (the constants below)
counter 0  block of four channels: channel // 4
counter 1  step within the episode
counter 2  episode: number of the environment's episode, from 0
counter 3  environment
=========  ====================================================================

A draw therefore does not depend on the batch size, on the number of workers or on earlier draws, and a checkpoint
needs only these counters. All functions are compiled and may be called from other compiled functions.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

SCENARIO = 0
SENSOR = 1
COMMAND = 2
CURRENT = 3
FAULT = 4
RANDOMISATION = 5
BIAS = 6
DRIFT = 7
WAVES = 8
TETHER = 10
WORLD = 11
RANGE = 12
"""readings of range sensors"""
NAVIGATION = 13
"""navigation sensors, and the errors of the estimate at the start"""
IDENTIFIED = 14
"""vehicles drawn from the covariance of an identification"""
MESSAGE = 15
"""loss of messages between vehicles"""
BLOCK = 0x80
"""observation blocks of installed packages"""
# Disturbances of installed packages use streams 64 to 127.
TEST = 0x100
"""Test protocols draw from `stream | TEST`, so that no training scenario is a test scenario."""
VALIDATION = 0x200
"""Validation draws from `stream | VALIDATION`, so that no validation scenario is a test scenario."""

_MASK = np.uint64(0xFFFFFFFF)
_SHIFT = np.uint64(32)
_MULTIPLIER_0 = np.uint64(0xD2511F53)
_MULTIPLIER_1 = np.uint64(0xCD9E8D57)
_WEYL_0 = np.uint64(0x9E3779B9)
_WEYL_1 = np.uint64(0xBB67AE85)
_TWO_PI = 2.0 * math.pi


@njit(nogil=True)
def words(
    key0: int, key1: int, c0: int, c1: int, c2: int, c3: int
) -> tuple[np.uint64, np.uint64, np.uint64, np.uint64]:
    """Return the four 32-bit words of one Philox4x32-10 block (as unsigned 64-bit integers below 2^32)."""
    k0 = np.uint64(key0) & _MASK
    k1 = np.uint64(key1) & _MASK
    x0 = np.uint64(c0) & _MASK
    x1 = np.uint64(c1) & _MASK
    x2 = np.uint64(c2) & _MASK
    x3 = np.uint64(c3) & _MASK
    for _ in range(10):
        product0 = _MULTIPLIER_0 * x0
        product1 = _MULTIPLIER_1 * x2
        x0 = (product1 >> _SHIFT) ^ x1 ^ k0
        x1 = product1 & _MASK
        x2 = (product0 >> _SHIFT) ^ x3 ^ k1
        x3 = product0 & _MASK
        k0 = (k0 + _WEYL_0) & _MASK
        k1 = (k1 + _WEYL_1) & _MASK
    return x0, x1, x2, x3


@njit(nogil=True)
def _unit(word: np.uint64) -> float:
    return (np.float64(word) + 0.5) * 2.0**-32


@njit(nogil=True)
def uniform4(key0: int, key1: int, c0: int, c1: int, c2: int, c3: int) -> tuple[float, float, float, float]:
    """Return four numbers uniform in the open interval (0, 1): (word + 1/2) 2^-32."""
    w0, w1, w2, w3 = words(key0, key1, c0, c1, c2, c3)
    return _unit(w0), _unit(w1), _unit(w2), _unit(w3)


@njit(nogil=True)
def normal4(key0: int, key1: int, c0: int, c1: int, c2: int, c3: int) -> tuple[float, float, float, float]:
    """Return four independent standard normal numbers: Box-Muller (1958) on each pair of words."""
    u0, u1, u2, u3 = uniform4(key0, key1, c0, c1, c2, c3)
    radius0 = math.sqrt(-2.0 * math.log(u0))
    radius1 = math.sqrt(-2.0 * math.log(u2))
    return (
        radius0 * math.cos(_TWO_PI * u1),
        radius0 * math.sin(_TWO_PI * u1),
        radius1 * math.cos(_TWO_PI * u3),
        radius1 * math.sin(_TWO_PI * u3),
    )


@njit(nogil=True)
def uniform(seed: int, stream: int, channel: int, step: int, episode: int, environment: int) -> float:
    """Return the uniform draw of one channel; channel c is entry c % 4 of `uniform4` at block c // 4."""
    u = uniform4(seed, stream, channel // 4, step, episode, environment)
    return u[channel % 4]
