"""Warn about properties of a vehicle that a pilot or modeller should know before using the vehicle."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from auvbench.vehicles.inspect import (
    AXES,
    free_speed,
    gyration,
    independent_axes,
    instabilities,
    net_buoyancy,
    reach,
    static_trim,
)
from auvbench.vehicles.vehicle_model import VehicleModel

FloatArray = NDArray[np.float64]


def warnings(vehicle: VehicleModel) -> list[str]:
    """Return the warnings about a vehicle's numbers, one sentence each."""
    return [
        *_buoyancy_warnings(vehicle),
        *_actuation_warnings(vehicle),
        *_stability_warnings(vehicle),
        *_inertia_warnings(vehicle),
        *vehicle.remarks,
    ]


def _buoyancy_warnings(vehicle: VehicleModel) -> list[str]:
    net, share = net_buoyancy(vehicle), abs(net_buoyancy(vehicle)) / vehicle.weight
    texts = []
    if share > 1e-9:
        verb = "rises" if net > 0 else "sinks"
        how = "buoyancy exceeds weight" if net > 0 else "weight exceeds buoyancy"
        texts.append(
            f"{verb} at {abs(free_speed(vehicle)):.3f} m/s without thrust: {how} by {abs(net):.3g} N"
            f" ({100 * share:.2g} % of the weight)"
        )
    trim = static_trim(vehicle)
    if not trim.determined:
        texts.append(
            "no restoring moment: weight and buoyancy act at the same point, so that nothing levels the vehicle"
        )
    elif max(abs(trim.roll), abs(trim.pitch)) > np.pi / 2:
        texts.append(
            "upright is unstable: the centre of gravity is above the centre of buoyancy, so that the vehicle turns over"
        )
    elif max(abs(trim.roll), abs(trim.pitch)) > np.radians(1.0):
        texts.append(
            f"does not rest level: roll {np.degrees(trim.roll):.1f} deg, pitch {np.degrees(trim.pitch):.1f} deg"
        )
    return texts


def _and(names: list[str]) -> str:
    return " and ".join([", ".join(names[:-1]), names[-1]]).removeprefix(" and ")


def _actuation_warnings(vehicle: VehicleModel) -> list[str]:
    own = independent_axes(vehicle)
    names_of_others = vehicle.others
    missing = [axis for axis in range(6) if axis not in own]
    texts = []
    if missing:
        names = _and([AXES[axis] for axis in missing])
        verb = "is" if len(missing) == 1 else "are"
        text = f"rank {len(own)}: {names} {verb} not independently actuated by the thrusters"
        text += f"; {', '.join(names_of_others)} act as well" if names_of_others else ""
        texts.append(text)
    # Most actuators of one kind share a curve, so a warning about the curve is printed only once.
    first: dict[str, str] = {}
    for unit in vehicle.units:
        for text in unit.warnings():
            first.setdefault(text, unit.name)
    texts += [f"{name}: {text}" for text, name in first.items()]
    return texts


def _stability_warnings(vehicle: VehicleModel) -> list[str]:
    texts = []
    for case in instabilities(vehicle):
        where = "at any speed" if case.above < 0.01 else f"above {case.above:.2f} m/s"
        texts.append(
            f"open loop, straight flight ahead is unstable in {case.plane} {where} (Munk moment; deviations grow by"
            f" {case.growth:.2g} 1/s at {case.speed:.2f} m/s): a controller must hold it"
        )
    linear = [a for a in range(3) if vehicle.quadratic_damping[a] == 0.0 < vehicle.linear_damping[a]]
    top = max((row.speed for row in reach(vehicle) if row.axis in linear), default=0.0)
    if linear and top > 0.0:
        texts.append(
            f"drag is only linear in {_and([AXES[a] for a in linear])}: real drag grows with the square of speed, so"
            f" the vehicle will not reach the {top:.1f} m/s computed for full thrust"
        )
    for axis in range(6):
        if vehicle.linear_damping[axis] == 0.0 and vehicle.quadratic_damping[axis] == 0.0:
            texts.append(f"no damping in {AXES[axis]}: a motion along this axis never stops by itself")
    return texts


def _inertia_warnings(vehicle: VehicleModel) -> list[str]:
    radii, arm = gyration(vehicle)
    worst = int(np.argmax(radii))
    if arm > 0.0 and radii[worst] > 1.5 * arm:
        return [
            f"inertia looks too large: a radius of gyration of {radii[worst]:.2f} m in {AXES[3 + worst]}, though the"
            f" farthest actuator is {arm:.2f} m from the centre of gravity"
        ]
    return []
