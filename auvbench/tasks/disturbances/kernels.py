"""Disturbances, compiled: draws at the start of an episode and changes during it, for N environments.

One row per environment in two arrays, `D` (floats, columns `D_*`) and `I` (integers, columns `I_*`), next to the
task's episodes (`records.EPISODE`). Each factor draws from a stream of its own, so that switching one on leaves the draws of the
others as they were; every draw is a function of (seed, stream, environment, episode, step, channel).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.dynamics.compiled import compiled
from auvbench.dynamics.random import BIAS, CURRENT, DRIFT, FAULT, RANDOMISATION, SENSOR, normal4, uniform4

Rows = Any
"""episodes of a task: the fields that every task has"""
Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

# Columns of D.
D_TOP = 0  # x, y, z of the mean current at the top of its profile, m/s, world axes
D_BOTTOM = 3  # x, y, z of the mean current at the bottom, m/s
D_FLUCTUATION = 6  # x, y, z of the Gauss-Markov part, m/s
D_BIAS = 9  # x, y, z in m, yaw in rad
D_DRIFT = 13  # x, y, z in m, yaw in rad
D_HELD = 17  # command that a stuck actuator holds
N_FLOATS = 18

# Columns of I.
I_MODE = 0  # HEALTHY or what fails
I_ACTUATOR = 1
I_BEGIN = 2  # agent step with which the fault begins
I_BEGUN = 3  # 1 once it has
N_INTEGERS = 4

HEALTHY = 0
DEAD = 1
WEAK = 2
STUCK = 3
ANY = 4  # in the parameters only: one of the three, evenly drawn
MODES = ("none", "dead", "weak", "stuck", "any")

# Entries of the parameter vector Q. A range of one value draws that value exactly.
Q_SPEED = 0  # low, high in m/s
Q_DIRECTION = 2  # low, high in rad
Q_ELEVATION = 4  # rad
Q_SIGMA = 5  # x, y, z in m/s
Q_DECAY = 8  # e^(-mu dt)
Q_INNOVATION = 9  # sqrt(1 - e^(-2 mu dt))
Q_FACTOR = 10  # speed at the bottom over speed at the top
Q_TURN = 11  # rad
Q_FAULT = 12  # mode
Q_PROBABILITY = 13
Q_TIME = 14  # low, high in s
Q_WEAK = 16  # factor of a weak thruster
Q_GAUSSIAN = 17  # x, y, z, yaw
Q_BIAS = 21  # x, y, z, yaw
Q_STEP_DRIFT = 25  # x, y, z, yaw: standard deviation of one step's increment
Q_SCALE_LOW = 29  # mass, buoyancy, inertia, added mass, damping, thrust
Q_SCALE_HIGH = 35
Q_LOGARITHMIC = 41
Q_KEEP_TRIM = 42
Q_WEIGHT_RATIO = 43  # weight over buoyancy of the sheet
Q_FREQUENCY = 44  # agent steps per second
N_PARAMETERS = 45

# Blocks of channels within a stream.
_MEAN = 0  # CURRENT: speed, direction
_FLUCTUATION = 1  # CURRENT: three normals per step
_GAUSSIAN = 1  # SENSOR: block 0 is the task's uniform noise


@compiled("dynamics")
def draw_current(indices: Integers, episodes: Rows, Q: Floats, test: int, D: Floats) -> None:
    """Draw mean current and stationary fluctuation of new episodes."""
    for k in range(indices.shape[0]):
        i = indices[k]
        e = episodes[i]
        u = uniform4(e.seed, CURRENT | test, _MEAN, 0, e.episode, e.environment)
        speed = Q[Q_SPEED] + (Q[Q_SPEED + 1] - Q[Q_SPEED]) * u[0]
        direction = Q[Q_DIRECTION] + (Q[Q_DIRECTION + 1] - Q[Q_DIRECTION]) * u[1]
        level = speed * math.cos(Q[Q_ELEVATION])
        rise = speed * math.sin(Q[Q_ELEVATION])
        D[i, D_TOP] = level * math.cos(direction)
        D[i, D_TOP + 1] = level * math.sin(direction)
        D[i, D_TOP + 2] = rise
        D[i, D_BOTTOM] = Q[Q_FACTOR] * level * math.cos(direction + Q[Q_TURN])
        D[i, D_BOTTOM + 1] = Q[Q_FACTOR] * level * math.sin(direction + Q[Q_TURN])
        D[i, D_BOTTOM + 2] = Q[Q_FACTOR] * rise
        z = normal4(e.seed, CURRENT | test, _FLUCTUATION, 0, e.episode, e.environment)
        D[i, D_FLUCTUATION] = Q[Q_SIGMA] * z[0]
        D[i, D_FLUCTUATION + 1] = Q[Q_SIGMA + 1] * z[1]
        D[i, D_FLUCTUATION + 2] = Q[Q_SIGMA + 2] * z[2]


@compiled("dynamics")
def advance_current(episodes: Rows, Q: Floats, test: int, D: Floats) -> None:
    """Advance the Gauss-Markov process by one agent step, exactly discretised (Fossen 2021, section 10.3).

    V[k+1] = Vbar + (V[k] - Vbar) e^(-mu dt) + sigma sqrt(1 - e^(-2 mu dt)) N(0, 1); `D_FLUCTUATION` is V - Vbar.
    """
    decay, innovation = Q[Q_DECAY], Q[Q_INNOVATION]
    for i in range(episodes.shape[0]):
        e = episodes[i]
        step = e.steps
        if step == 0:
            continue  # the draw of the start is stationary already
        z = normal4(e.seed, CURRENT | test, _FLUCTUATION, step, e.episode, e.environment)
        for axis in range(3):
            D[i, D_FLUCTUATION + axis] = (
                decay * D[i, D_FLUCTUATION + axis] + innovation * Q[Q_SIGMA + axis] * z[axis]
            )


@compiled("dynamics")
def draw_faults(
    indices: Integers,
    episodes: Rows,
    Q: Floats,
    candidates: Integers,
    test: int,
    D: Floats,
    I: Integers,  # noqa: E741
) -> None:
    """Draw the faults of new episodes; `candidates` are the actuators that may fail."""
    for k in range(indices.shape[0]):
        i = indices[k]
        e = episodes[i]
        u = uniform4(e.seed, FAULT | test, 0, 0, e.episode, e.environment)
        v = uniform4(e.seed, FAULT | test, 1, 0, e.episode, e.environment)
        mode = int(Q[Q_FAULT])
        if mode == ANY:
            mode = DEAD + int(3.0 * v[0])
        # Draws lie strictly inside (0, 1), so that probability 1 always fails and 0 never does.
        I[i, I_MODE] = mode if u[0] < Q[Q_PROBABILITY] else HEALTHY
        I[i, I_ACTUATOR] = candidates[int(candidates.shape[0] * u[1])]
        time = Q[Q_TIME] + (Q[Q_TIME + 1] - Q[Q_TIME]) * u[2]
        # The margin keeps 0.3 s at 10 Hz at step 3, for any last bit of the product.
        I[i, I_BEGIN] = math.ceil(time * Q[Q_FREQUENCY] - 1e-9)
        I[i, I_BEGUN] = 0
        D[i, D_HELD] = 0.0


@compiled("dynamics")
def apply_faults(
    episodes: Rows,
    Q: Floats,
    D: Floats,
    I: Integers,  # noqa: E741
    command: Floats,
    effectiveness: Floats,
) -> None:
    """Change the acting `command` (n, n_u) and `effectiveness` (n, n_u) in place by faults that have begun.

    A dead thruster also draws no power: its command becomes 0. A stuck actuator holds the command that acts when
    the fault begins.
    """
    for i in range(episodes.shape[0]):
        e = episodes[i]
        mode = I[i, I_MODE]
        if mode == HEALTHY or e.steps < I[i, I_BEGIN]:
            continue
        a = I[i, I_ACTUATOR]
        if mode == DEAD:
            command[i, a] = 0.0
            effectiveness[i, a] = 0.0
        elif mode == WEAK:
            effectiveness[i, a] = Q[Q_WEAK]
        elif I[i, I_BEGUN] == 0:
            D[i, D_HELD] = command[i, a]
        else:
            command[i, a] = D[i, D_HELD]
        I[i, I_BEGUN] = 1


@compiled("dynamics")
def draw_scales(indices: Integers, episodes: Rows, Q: Floats, test: int, scales: Floats) -> None:
    """Draw factors (len(indices), 6) on mass, buoyancy, inertia, added mass, damping and thrust of new episodes.

    With `Q_KEEP_TRIM` the factor on buoyancy is multiplied by (B + (s - 1) W) / B, where s is the factor on
    mass: net buoyancy B - W stays what it was before the factor on buoyancy itself.
    """
    for k in range(indices.shape[0]):
        i = indices[k]
        e = episodes[i]
        u = uniform4(e.seed, RANDOMISATION | test, 0, 0, e.episode, e.environment)
        v = uniform4(e.seed, RANDOMISATION | test, 1, 0, e.episode, e.environment)
        for j in range(6):
            low, high = Q[Q_SCALE_LOW + j], Q[Q_SCALE_HIGH + j]
            fraction = u[j] if j < 4 else v[j - 4]
            if Q[Q_LOGARITHMIC] > 0.0:
                scales[k, j] = low * math.exp(fraction * math.log(high / low))
            else:
                scales[k, j] = low + (high - low) * fraction
        if Q[Q_KEEP_TRIM] > 0.0:
            scales[k, 1] *= 1.0 + (scales[k, 0] - 1.0) * Q[Q_WEIGHT_RATIO]


@compiled("dynamics")
def draw_bias(indices: Integers, episodes: Rows, Q: Floats, test: int, D: Floats) -> None:
    """Draw the bias of the readings of new episodes; their drift begins at zero."""
    for k in range(indices.shape[0]):
        i = indices[k]
        e = episodes[i]
        z = normal4(e.seed, BIAS | test, 0, 0, e.episode, e.environment)
        for channel in range(4):
            D[i, D_BIAS + channel] = Q[Q_BIAS + channel] * z[channel]
            D[i, D_DRIFT + channel] = 0.0


@compiled("dynamics")
def advance_drift(episodes: Rows, Q: Floats, test: int, D: Floats) -> None:
    """Advance the random walks by one agent step: increments of variance drift^2 dt, exact at any step."""
    for i in range(episodes.shape[0]):
        e = episodes[i]
        z = normal4(e.seed, DRIFT | test, 0, e.steps, e.episode, e.environment)
        for channel in range(4):
            D[i, D_DRIFT + channel] += Q[Q_STEP_DRIFT + channel] * z[channel]


@compiled("dynamics")
def offsets(
    indices: Integers,
    episodes: Rows,
    Q: Floats,
    test: int,
    noisy: bool,
    D: Floats,
    offset: Floats,
) -> None:
    """Compute the errors (n, 4) of the position (m) and yaw (rad) readings of the environments in `indices`."""
    for k in range(indices.shape[0]):
        i = indices[k]
        e = episodes[i]
        for channel in range(4):
            offset[i, channel] = D[i, D_BIAS + channel] + D[i, D_DRIFT + channel]
        if noisy:
            z = normal4(e.seed, SENSOR | test, _GAUSSIAN, e.steps, e.episode, e.environment)
            for channel in range(4):
                offset[i, channel] += Q[Q_GAUSSIAN + channel] * z[channel]
