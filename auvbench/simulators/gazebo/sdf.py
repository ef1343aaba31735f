"""A vehicle's sheet as SDF for Gazebo Harmonic (gz-sim 8, DART): a model, and a world of water around models.

Gazebo's axes are auvbench's (world ENU, body FLU), and the link frame is the body origin, so numbers are those of the
`VehicleModel`. The plugin's tags are Fossen's derivatives and so have a minus.
"""

from __future__ import annotations

from collections.abc import Sequence
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray

from auvbench.errors import VehicleError
from auvbench.simulators.gazebo import parts
from auvbench.simulators.gazebo.parts import LINK, comment, number, plugin
from auvbench.vehicles.vehicle_model import VehicleModel

FloatArray = NDArray[np.float64]

HYDRODYNAMICS = ("corrected", "published")
"""How added mass acts.

`corrected`: `<fluid_added_mass>`, which DART adds to the body's inertia, so that the Coriolis term follows.
`published`: the Hydrodynamics plugin's explicit added mass, as in models with `<xDotU>` tags. Its Coriolis term has the
wrong sign (measured in gz-sim 8.14.0) or wrong entries (before 8.12.0).
"""

VERSION = "1.11"


def check_vehicle(vehicle: VehicleModel, hydrodynamics: str) -> None:
    """Check that Gazebo's plugins can simulate a vehicle.

    Raises:
        VehicleError: it has actuators other than thrusters, a weight that is not mass times gravity, a Coriolis term of
            added mass that DART cannot have, or added mass that diverges when it is explicit.
    """
    others = [unit for unit in vehicle.units if unit.name in vehicle.others]
    if others:
        raise VehicleError(
            f"vehicle {vehicle.name}: {others[0].name} is a {others[0].kind}; in Gazebo all actuators must be thrusters"
        )
    if abs(vehicle.weight - vehicle.mass * vehicle.gravity) > 1e-9 * vehicle.weight:
        raise VehicleError(
            f"vehicle {vehicle.name}: weight {vehicle.weight:g} N is not mass x gravity ="
            f" {vehicle.mass * vehicle.gravity:g} N, the weight that Gazebo computes"
        )
    if vehicle.plugin:
        raise VehicleError(
            f"vehicle {vehicle.name}: its added-mass Coriolis term copies that of Gazebo's plugin ({vehicle.plugin}); "
            "in Gazebo use the original vehicle with simulator.hydrodynamics=published"
        )
    if hydrodynamics == "corrected":
        if not vehicle.added_mass_coriolis and np.any(vehicle.M_A):
            raise VehicleError(
                f"vehicle {vehicle.name}: added_mass_coriolis is false, and <fluid_added_mass> includes that term;"
                " use hydrodynamics=published"
            )
        return
    growth = parts.explicit_growth(vehicle)
    if growth >= 1.0:
        raise VehicleError(
            f"vehicle {vehicle.name}: the plugin's explicit added mass diverges, the largest eigenvalue of"
            f" M_RB^-1 M_A is {growth:.3g} and must be below 1; use hydrodynamics=corrected"
        )


def model(
    vehicle: VehicleModel,
    hydrodynamics: str,
    *,
    name: str | None = None,
    thrusters: bool = True,
    current: FloatArray | None = None,
) -> str:
    """Return the `<model>` element.

    Args:
        vehicle: the vehicle.
        hydrodynamics: one of `HYDRODYNAMICS`.
        name: of the model; the vehicle's by default.
        thrusters: with links, joints and Thruster plugins, and with publishers of pose and odometry; else the bare body.
        current: (3,) m/s, world axes, of the water around the model until a message on `/ocean_current` changes it.

    Raises:
        VehicleError: as `check_vehicle`.
    """
    check_vehicle(vehicle, hydrodynamics)
    name = name or vehicle.name
    lines = [f'<model name="{escape(name)}">', f'  <link name="{LINK}">']
    lines += parts.inertial(vehicle, hydrodynamics, thrusters)
    lines += parts.displaced(vehicle)
    lines.append("  </link>")
    if thrusters:
        lines += [line for i in range(len(vehicle.units)) for line in parts.propeller(vehicle, i, name)]
        lines += parts.publishers(name)
    lines.append(parts.hydrodynamics_plugin(vehicle, hydrodynamics, current))
    return "\n".join([*lines, "</model>"])


def world(
    models: Sequence[str],
    vehicle: VehicleModel,
    *,
    name: str = "ocean",
    step: float = 0.001,
    real_time_factor: float = 1.0,
    scene: bool = True,
    header: str = "",
) -> str:
    """Return an SDF file: unbounded water around `models`, without sensors.

    Args:
        models: `<model>` elements.
        vehicle: gives gravity and density.
        name: of the world.
        step: s, the physics step.
        real_time_factor: 1 for real time, 0 for as fast as possible.
        scene: with light and SceneBroadcaster for a window.
        header: a comment at the top.
    """
    lines = ['<?xml version="1.0"?>']
    if header:
        lines += ["<!--", *(f"  {comment(line)}" for line in header.splitlines()), "-->"]
    lines += [
        f'<sdf version="{VERSION}" xmlns:gz="http://gazebosim.org/schema">',
        f'<world name="{escape(name)}">',
    ]
    if not scene:  # threads for these systems' last call cost more than the call
        lines.append("  <gz:policies><parallel_postupdates>false</parallel_postupdates></gz:policies>")
    lines += [
        '  <physics name="dart" type="dart">',
        f"    <max_step_size>{number(step)}</max_step_size>",
        f"    <real_time_factor>{number(real_time_factor)}</real_time_factor>",
        "  </physics>",
        f"  <gravity>0 0 {number(-vehicle.gravity)}</gravity>",
        plugin("physics", "Physics"),
        plugin("user-commands", "UserCommands"),
    ]
    if scene:
        lines.append(plugin("scene-broadcaster", "SceneBroadcaster"))
    lines += [
        # One fluid everywhere: the sheets' buoyancy does not end at the surface.
        plugin(
            "buoyancy",
            "Buoyancy",
            f"<uniform_fluid_density>{number(vehicle.density)}</uniform_fluid_density>",
        )
    ]
    if scene:
        lines += [
            '  <light type="directional" name="sun"><cast_shadows>false</cast_shadows>',
            "    <direction>-0.5 0.1 -0.9</direction></light>",
        ]
    lines += [f"  {line}" for text in models for line in text.splitlines()]
    return "\n".join([*lines, "</world>", "</sdf>", ""])
