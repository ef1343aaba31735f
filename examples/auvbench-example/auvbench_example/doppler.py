"""A block of an observation: the velocity that a Doppler log measures."""

from auvbench.blocks import BODY_AXES, FASTEST, BlockSpec, normals, vector

SIGMA = 0.02  # m/s


def write(m, e, p, out):
    """Write the velocity over ground in m/s, body axes, with noise."""
    u, v, w = m.velocity
    nu, nv, nw, _ = normals(m, e, 0)
    out[0], out[1], out[2] = u + SIGMA * nu, v + SIGMA * nv, w + SIGMA * nw


def describe(setting):
    """Return labels, unit, bounds, meaning and axes."""
    return vector("doppler", "m/s", (FASTEST,) * 3, "velocity over ground with noise", BODY_AXES)


SPEC = BlockSpec("doppler", write, describe, reads=("velocity",))
