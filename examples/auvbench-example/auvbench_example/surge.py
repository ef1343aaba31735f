"""A disturbance: docs/adding-a-disturbance.md."""

import math
from dataclasses import dataclass

from auvbench.dynamics.random import uniform4
from auvbench.plugin import DisturbanceConfig, DisturbanceSpec, forces, number
from auvbench.tasks.disturbances.base import Disturbance

OWN = 77
"""stream of its draws: 64 to 127 are those of packages"""


@dataclass(kw_only=True)
class SurgeConfig(DisturbanceConfig):
    """The keys of disturbance.surge."""

    force: float = number(0.0, 1e4)  # N
    period: float = number(0.1, 1e4)  # s

    @property
    def active(self):
        return self.force > 0.0

    def needs(self, key):
        yield forces(key)


def draw(e, d, p, stream):
    d.phase, _, _, _ = uniform4(e.seed, OWN | stream, 0, 0, e.episode, e.environment)


def push(e, d, p, v, w, duration, wrench):
    wrench[0] += p.force * math.sin(2.0 * math.pi * (e.steps * p.duration / p.period + d.phase))


class Surge(Disturbance):
    """A force along the bow that swells and ebbs, with a phase drawn per episode."""

    draw = staticmethod(draw)
    push = staticmethod(push)
    fields = (("phase", "f8"),)


SPEC = DisturbanceSpec("surge", "swelling force", "auvbench_example.surge:Surge", SurgeConfig)
