"""A vehicle's sheet as SDF for Gazebo Harmonic (gz-sim 8, DART): a model, and a world of water around models.

Gazebo's axes are the project's (world ENU, body FLU), and the link frame is the body origin, so numbers are written
as they stand in the `VehicleModel`. Where a source uses Fossen's derivatives (negative numbers), the plugin's tags
carry the minus.
"""

from __future__ import annotations

from collections.abc import Sequence
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray

from auvbench.errors import VehicleError
from auvbench.simulators.gazebo import masses, parts
from auvbench.simulators.gazebo.elements import Cite, comment, no_citations, number, plugin
from auvbench.simulators.gazebo.parts import LINK
from auvbench.vehicles.model import VehicleModel

FloatArray = NDArray[np.float64]

HYDRODYNAMICS = ("corrected", "published")
"""How added mass acts.

`corrected`: `<fluid_added_mass>`, which DART adds to the body's inertia, so that the Coriolis term follows by itself.
`published`: the Hydrodynamics plugin's own explicit added mass, whose Coriolis term has the wrong sign (measured in
gz-sim 8.14.0) or wrong entries (before 8.12.0): what a model with `<xDotU>` tags has always simulated.
"""

VERSION = "1.11"


def check(vehicle: VehicleModel, hydrodynamics: str) -> None:
    """Whether Gazebo's plugins can be the vehicle of the sheet.

    Raises:
        VehicleError: it has actuators other than thrusters, a weight that is not mass times gravity, added mass
            without its Coriolis term where DART would add one, that of Gazebo's own plugin, or added mass that diverges
            when it is explicit.
    """
    others = [unit for unit in vehicle.units if unit.kind != "thruster"]
    if others:
        raise VehicleError(
            f"vehicle {vehicle.name}: {others[0].name} is a {others[0].kind}; Gazebo's models have thrusters only"
        )
    if abs(vehicle.weight - vehicle.mass * vehicle.gravity) > 1e-9 * vehicle.weight:
        raise VehicleError(
            f"vehicle {vehicle.name}: weight {vehicle.weight:g} N is not mass x gravity ="
            f" {vehicle.mass * vehicle.gravity:g} N, which is what Gazebo makes of the mass"
        )
    if vehicle.plugin:
        raise VehicleError(
            f"vehicle {vehicle.name}: its added-mass Coriolis term is a copy of that of Gazebo's plugin ({vehicle.plugin}); "
            "in Gazebo itself it is simulator.hydrodynamics=published with the vehicle that was copied"
        )
    if hydrodynamics == "corrected":
        if not vehicle.added_mass_coriolis and np.any(vehicle.M_A):
            raise VehicleError(
                f"vehicle {vehicle.name}: added_mass_coriolis is false, which <fluid_added_mass> cannot be;"
                " use hydrodynamics=published"
            )
        return
    growth = masses.explicit_growth(vehicle)
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
    cite: Cite = no_citations,
    thrusters: bool = True,
    namespace: str | None = None,
    current: FloatArray | None = None,
) -> str:
    """The `<model>` element.

    Args:
        vehicle: the vehicle.
        hydrodynamics: one of `HYDRODYNAMICS`.
        name: of the model; the vehicle's by default.
        cite: gives the comment beside a number.
        thrusters: with links, joints and Thruster plugins for them and with publishers of pose and odometry, as a
            user of Gazebo wants them; without, the bare body for whoever applies forces by himself.
        namespace: of the topics `/NAMESPACE/THRUSTER/cmd`; the model's name by default.
        current: (3,) m/s, world axes, of the water around the model until a message on `/ocean_current` changes it.

    Raises:
        VehicleError: as `check`.
    """
    check(vehicle, hydrodynamics)
    name = name or vehicle.name
    space = namespace or name
    lines = [f'<model name="{escape(name)}">', f'  <link name="{LINK}">']
    lines += parts.inertial(vehicle, hydrodynamics, cite, thrusters)
    lines += parts.displaced(vehicle, cite)
    lines.append("  </link>")
    if thrusters:
        lines += [
            line for i in range(len(vehicle.units)) for line in parts.propeller(vehicle, i, space, cite)
        ]
        lines += parts.publishers(space)
    lines.append(parts.hydrodynamics_plugin(vehicle, hydrodynamics, cite, current))
    return "\n".join([*lines, "</model>"])


def world(
    models: Sequence[str],
    vehicle: VehicleModel,
    *,
    name: str = "ocean",
    step: float = 0.001,
    real_time_factor: float = 1.0,
    cite: Cite = no_citations,
    scene: bool = True,
    header: str = "",
) -> str:
    """A whole SDF file: water without end around `models`, headless defaults, no sensors.

    Args:
        models: `<model>` elements.
        vehicle: whose gravity and water.
        name: of the world.
        step: s, the physics step.
        real_time_factor: 1 for real time, 0 for as fast as possible.
        cite: gives the comment beside a number.
        scene: with what a screen shows (light, SceneBroadcaster).
        header: a comment at the top.
    """
    lines = ['<?xml version="1.0"?>']
    if header:
        lines += ["<!--", *(f"  {comment(line)}" for line in header.splitlines()), "-->"]
    lines += [
        f'<sdf version="{VERSION}" xmlns:gz="http://gazebosim.org/schema">',
        f'<world name="{escape(name)}">',
    ]
    if not scene:  # threads for the systems' last call cost more than these systems do
        lines.append("  <gz:policies><parallel_postupdates>false</parallel_postupdates></gz:policies>")
    lines += [
        '  <physics name="dart" type="dart">',
        f"    <max_step_size>{number(step)}</max_step_size>",
        f"    <real_time_factor>{number(real_time_factor)}</real_time_factor>",
        "  </physics>",
        f"  <gravity>0 0 {number(-vehicle.gravity)}</gravity>{cite('environment', 'gravity')}",
        plugin("physics", "Physics"),
        plugin("user-commands", "UserCommands"),
    ]
    if scene:
        lines.append(plugin("scene-broadcaster", "SceneBroadcaster"))
    lines += [
        # One fluid everywhere: the sheets' buoyancy does not end at the surface either.
        plugin(
            "buoyancy",
            "Buoyancy",
            f"<uniform_fluid_density>{number(vehicle.density)}</uniform_fluid_density>"
            f"{cite('environment', 'density')}",
        )
    ]
    if scene:
        lines += [
            '  <light type="directional" name="sun"><cast_shadows>false</cast_shadows>',
            "    <direction>-0.5 0.1 -0.9</direction></light>",
        ]
    lines += [f"  {line}" for text in models for line in text.splitlines()]
    return "\n".join([*lines, "</world>", "</sdf>", ""])
