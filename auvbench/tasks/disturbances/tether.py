"""A tether: a lumped-mass cable from a point at the surface to the vehicle, in the same current as the vehicle.

After von Benzon et al., "An open-source benchmark simulator: control of a BlueROV2 underwater robot" (2022): nodes with the mass of
the cable, tension only in stretched segments, and normal and tangential drag of each segment from its velocity through the water.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from auvbench.config.disturbances import DisturbanceSpec, Factor, Need, forces
from auvbench.config.fields import number
from auvbench.dynamics.layout import Vector
from auvbench.dynamics.random import TETHER, uniform4
from auvbench.dynamics.vectors import (
    add,
    cross,
    dot,
    product,
    rotation_matrix,
    scale,
    subtract,
    transposed_product,
)
from auvbench.errors import ConfigError
from auvbench.tasks.disturbances.base import Disturbance, Integers
from auvbench.tasks.records import Record
from auvbench.tasks.rows import Vehicle, current_at, put, row, triple
from auvbench.vehicles.vehicle_model import VehicleModel

SEGMENTS = 20
NODES = SEGMENTS + 1
END = SEGMENTS
"""Index of the node at the vehicle; node 0 is at the surface"""
_SHARE = 0.5
"""Longest step of the cable times the cable's highest angular frequency; steps with a product of 2 or more are unstable"""
_DAMPED = 0.25
"""Longest step of the cable, as a fraction of the time constant with which damping stops a node"""
_SHORTEST = 2e-5
"""Shortest step of the cable, s: with shorter steps, the simulation would be slower than real time"""


@dataclass(kw_only=True)
class Tether(Factor):
    """A cable to the surface."""

    length: float = number(0.0, 2000.0)  # m
    diameter: float = number(1e-4, 0.5)  # m
    mass: float = number(1e-3, 100.0)  # kg/m
    weight: float = number(-100.0, 1000.0)  # N/m, in water
    stiffness: float = number(1.0, 1e8)  # N, per strain
    damping: float = number(0.0, 1e6)  # N s, per strain rate
    normal_drag: float = number(0.0, 10.0)
    tangential_drag: float = number(0.0, 10.0)
    east: float = number(-1000.0, 1000.0)  # m
    north: float = number(-1000.0, 1000.0)  # m
    attached_x: float = number(-5.0, 5.0)  # m
    attached_z: float = number(-5.0, 5.0)  # m

    @property
    def active(self) -> bool:
        return self.length > 0.0

    def needs(self, key: str) -> Iterator[Need]:
        yield forces(key)


@row
def plus(a: Vector, share: float, b: Vector) -> Vector:
    """Return a + share b."""
    return add(a, scale(share, b))


@row
def tension(x: Any, v: Any, k: int, p: Record) -> Vector:
    """Return the force in N with which segment k pulls node k towards node k + 1; it is 0 for a slack segment."""
    along = subtract(triple(x[k + 1]), triple(x[k]))
    length = math.sqrt(dot(along, along))
    strain = length / p.segment - 1.0
    if strain <= 0.0:
        return 0.0, 0.0, 0.0
    rate = dot(along, subtract(triple(v[k + 1]), triple(v[k]))) / (length * p.segment)
    pull = max(0.0, p.stiffness * strain + p.damping * rate)
    return scale(pull / length, along)


@row
def tangent(x: Any, k: int) -> Vector:
    """Return the direction of the cable at a node."""
    along = subtract(triple(x[min(k + 1, END)]), triple(x[max(k - 1, 0)]))
    length = math.sqrt(dot(along, along))
    return scale(1.0 / max(length, 1e-9), along)


@row
def drag(along: Vector, u: Vector, share: float, p: Record) -> tuple[float, float]:
    """Return the ratios of drag to velocity in N s/m, across and along the cable, for a fraction `share` of a segment.

    `u` is the segment's velocity through the water.
    """
    lengthwise = dot(along, u)
    across = plus(u, -lengthwise, along)
    speed = math.sqrt(dot(across, across))
    return share * p.normal * speed, share * p.tangential * abs(lengthwise)


@row
def move(x: Any, v: Any, k: int, share: float, force: Vector, w: Record, h: float, p: Record) -> None:
    """Advance node k, with a fraction `share` of a segment's mass, by h s under a force in N; drag is implicit in the velocity."""
    mass = share * p.node
    _, _, z = triple(x[k])
    water = current_at(w, z)
    along, u = tangent(x, k), subtract(triple(v[k]), water)
    across_drag, along_drag = drag(along, u, share, p)
    u = plus(u, h / mass, force)
    lengthwise = dot(along, u)
    across = plus(u, -lengthwise, along)
    u = plus(
        scale(1.0 / (1.0 + h * across_drag / mass), across),
        lengthwise / (1.0 + h * along_drag / mass),
        along,
    )
    velocity = add(water, u)
    put(v[k], velocity)
    put(x[k], plus(triple(x[k]), h, velocity))


@row
def step(x: Any, v: Any, w: Record, h: float, p: Record, free: bool) -> Vector:
    """Advance the cable by h s; return the force in N of the cable's end on the vehicle, 0 if the end hangs free.

    Args:
        x: positions (NODES, 3) of the nodes, m, world axes.
        v: velocities (NODES, 3) of the nodes, m/s.
        w: current.
        h: duration of the step, s.
        p: parameters.
        free: whether the end hangs free; otherwise the caller moves it with the vehicle.
    """
    before = tension(x, v, 0, p)
    down = (0.0, 0.0, -p.weight_of_segment)
    for k in range(1, SEGMENTS):
        after = tension(x, v, k, p)
        move(x, v, k, 1.0, add(subtract(after, before), down), w, h, p)
        before = after
    pull = subtract(scale(0.5, down), before)
    if free:
        move(x, v, END, 0.5, pull, w, h, p)
        return 0.0, 0.0, 0.0
    _, _, z = triple(x[END])
    along, u = tangent(x, END), subtract(triple(v[END]), current_at(w, z))
    across_drag, along_drag = drag(along, u, 0.5, p)
    lengthwise = dot(along, u)
    pull = plus(pull, -across_drag, plus(u, -lengthwise, along))
    return plus(pull, -along_drag * lengthwise, along)


@row
def draw(e: Record, d: Record, p: Record, stream: int) -> None:
    """Lay the cable between surface and vehicle: straight if it is just long enough, otherwise bent at its middle in a random direction."""
    x, y, z = triple(e.start)
    top = (x + p.east, y + p.north, 0.0)
    bow_x, bow_y = math.cos(e.start_yaw), math.sin(e.start_yaw)
    end = (x + p.attached_x * bow_x, y + p.attached_x * bow_y, z + p.attached_z)
    chord = subtract(end, top)
    distance = math.sqrt(dot(chord, chord))
    share, _, _, _ = uniform4(e.seed, TETHER | stream, 0, 0, e.episode, e.environment)
    aside = (math.cos(2.0 * math.pi * share), math.sin(2.0 * math.pi * share), 0.0)
    aside = plus(aside, -dot(aside, chord) / max(distance * distance, 1e-9), chord)
    width = math.sqrt(dot(aside, aside))
    sag = 0.5 * math.sqrt(max(0.0, p.length * p.length - distance * distance)) / max(width, 1e-9)
    for k in range(NODES):
        part = k / SEGMENTS
        put(d.position[k], plus(plus(top, part, chord), sag * (1.0 - abs(2.0 * part - 1.0)), aside))


@row
def push(e: Record, d: Record, p: Record, v: Vehicle, w: Record, duration: float, wrench: Any) -> None:
    """Advance the cable while the vehicle moves; add the cable's mean force and moment on the vehicle to `wrench`."""
    rotation = rotation_matrix(v.attitude)
    arm = (p.attached_x, 0.0, p.attached_z)
    velocity = product(rotation, add(v.velocity, cross(v.rates, arm)))
    end = add(v.position, product(rotation, arm))
    count = max(1, math.ceil(duration / p.longest))
    h = duration / count
    mean = (0.0, 0.0, 0.0)
    nodes, velocities = d.position, d.velocity
    for _ in range(count):
        put(nodes[END], end)
        put(velocities[END], velocity)
        mean = plus(mean, 1.0 / count, step(nodes, velocities, w, h, p, False))
        end = plus(end, h, velocity)
    fx, fy, fz = transposed_product(rotation, mean)
    mx, my, mz = cross(arm, (fx, fy, fz))
    wrench[0] += fx
    wrench[1] += fy
    wrench[2] += fz
    wrench[3] += mx
    wrench[4] += my
    wrench[5] += mz


class Cable(Disturbance):
    """The tethers of N vehicles."""

    draw = staticmethod(draw)
    push = staticmethod(push)
    longest = 0.02
    fields = (
        ("position", "f8", (NODES, 3)),  # m, world axes
        ("velocity", "f8", (NODES, 3)),  # m/s
    )
    settings: Tether

    @staticmethod
    def check(settings: Tether, vehicle: VehicleModel) -> None:
        """Raise ConfigError for a cable that needs steps shorter than `_SHORTEST`."""
        if not settings.active:
            return
        p = parameters(settings, vehicle)
        mass = p["node"] * p["segment"]
        largest = {"stiffness": mass * (0.5 * _SHARE / _SHORTEST) ** 2, "damping": mass * _DAMPED / _SHORTEST}
        for key, most in largest.items():
            if (value := getattr(settings, key)) > most:
                raise ConfigError(
                    f"disturbance.tether.{key}={value:g}: must be at most {most:.3g} for a cable of this length, diameter and mass, "
                    f"since a higher value needs time steps of less than {_SHORTEST:g} s"
                )

    def draw_rows(self, indices: Integers) -> None:
        """Lay the cables of new episodes.

        Raises:
            ConfigError: the cable is too short for a start.
        """
        super().draw_rows(indices)
        nodes, length = self.field["position"][indices], self.settings.length
        distance = np.linalg.norm(nodes[:, END] - nodes[:, 0], axis=1).max(initial=0.0)
        if distance > length * (1.0 + 1e-9):
            raise ConfigError(
                f"disturbance.tether.length={length:g}: an episode starts {distance:.4g} m from the point at the surface; "
                "set a length of at least this distance"
            )

    def own_parameters(self, settings: Tether) -> dict[str, Any]:
        return parameters(settings, self.vehicle)


def parameters(settings: Tether, vehicle: VehicleModel) -> dict[str, Any]:
    """Return the parameters of the cable in the vehicle's water."""
    segment, diameter = settings.length / SEGMENTS, settings.diameter
    # A node has the added mass of a cylinder in all directions. A real cable has this added mass only across the cable. The
    # added mass along the cable does not change any equilibrium.
    node = (settings.mass + vehicle.density * math.pi / 4.0 * diameter**2) * segment
    fastest = 2.0 * math.sqrt(settings.stiffness / segment / node)
    damped = settings.damping / segment
    return {
        "length": settings.length,
        "segment": segment,
        "node": node,
        "weight_of_segment": settings.weight * segment,
        "stiffness": settings.stiffness,
        "damping": settings.damping,
        "normal": 0.5 * vehicle.density * diameter * segment * settings.normal_drag,
        "tangential": 0.5 * vehicle.density * math.pi * diameter * segment * settings.tangential_drag,
        "east": settings.east,
        "north": settings.north,
        "attached_x": settings.attached_x,
        "attached_z": settings.attached_z,
        "longest": min(_SHARE / fastest, _DAMPED * node / damped if damped > 0.0 else math.inf),
    }


tether = DisturbanceSpec("tether", "tether", "auvbench.tasks.disturbances.tether:Cable", Tether)
