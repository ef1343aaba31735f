"""A vehicle's sheet as SDF for Gazebo Harmonic (gz-sim 8, DART): a model, and a world of water around models.

Gazebo's axes are the project's (world ENU, body FLU), and the link frame is the body origin, so numbers are written
as they stand in the `VehicleModel`. Where a source uses Fossen's derivatives (negative numbers), the plugin's tags
carry the minus.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray

from auvbench.errors import VehicleError
from auvbench.simulators.gazebo import masses
from auvbench.vehicles.model import VehicleModel

FloatArray = NDArray[np.float64]

HYDRODYNAMICS = ("corrected", "published")
"""How added mass acts.

`corrected`: `<fluid_added_mass>`, which DART adds to the body's inertia, so that the Coriolis term follows by itself.
`published`: the Hydrodynamics plugin's own explicit added mass, whose Coriolis term has the wrong sign (measured in
gz-sim 8.14.0) or wrong entries (before 8.12.0): what a model with `<xDotU>` tags has always simulated.
"""

VERSION = "1.11"
LINK = "base_link"
_MOTION = "UVWPQR"
_REACTION = "xyzkmn"

Cite = Callable[..., str]


def citations(sheet: Mapping[str, Any]) -> Cite:
    """A function from a path of keys in a sheet to the comment that names the sources of the number there."""

    def cite(*path: str) -> str:
        node: Any = sheet
        for key in path:
            node = node.get(key) if isinstance(node, Mapping) else None
        named = node.get("source") if isinstance(node, Mapping) else None
        if named is None:
            return ""
        text = ", ".join(named) if isinstance(named, list | tuple) else str(named)
        return f"  <!-- {comment(text)} -->"

    return cite


def no_citations(*path: str) -> str:
    """For models that nobody reads."""
    return ""


def comment(text: str) -> str:
    """`text` as it may stand in an XML comment."""
    return re.sub("-{2,}", "-", text)


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
    lines += _inertial(vehicle, hydrodynamics, cite, thrusters)
    lines += _displaced(vehicle, cite)
    lines.append("  </link>")
    if thrusters:
        lines += [line for i in range(len(vehicle.units)) for line in _propeller(vehicle, i, space, cite)]
        lines += _publishers(space)
    lines.append(_hydrodynamics(vehicle, hydrodynamics, cite, current))
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


def plugin(library: str, name: str, *body: str) -> str:
    """A `<plugin>` element of one of Gazebo's own systems, two blanks deep."""
    opening = f'  <plugin filename="gz-sim-{library}-system" name="gz::sim::systems::{name}"'
    if not body:
        return f"{opening}/>"
    return "\n".join([f"{opening}>", *(f"    {line}" for line in body), "  </plugin>"])


def number(value: float) -> str:
    """The shortest decimal that reads back as the same double."""
    value = float(value) + 0.0  # no negative zero
    return str(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(value)


def _row(values: Any) -> str:
    return " ".join(number(value) for value in values)


def _inertial(vehicle: VehicleModel, hydrodynamics: str, cite: Cite, thrusters: bool) -> list[str]:
    mass, r_g, inertia = masses.hull(vehicle) if thrusters else masses.whole(vehicle)
    note = f"    <!-- The propellers' {len(vehicle.units)} x {masses.PROPELLER:g} kg are taken off. -->"
    lines = [note] if thrusters and vehicle.units else []
    lines += [
        "    <inertial>",
        f"      <pose>{_row(r_g)} 0 0 0</pose>{cite('rigid_body', 'center_of_gravity')}",
        f"      <mass>{number(mass)}</mass>{cite('rigid_body', 'mass')}",
        f"      <inertia>{cite('rigid_body', 'inertia')}",
    ]
    axes = "xyz"
    for i, row in enumerate(axes):
        lines.append(
            "        "
            + "".join(
                f"<i{row}{axes[j]}>{number(inertia[i, j])}</i{row}{axes[j]}>" for j in range(i, len(axes))
            )
        )
    lines.append("      </inertia>")
    if hydrodynamics == "corrected" and np.any(vehicle.M_A):
        lines.append(f"      <fluid_added_mass>{cite('hydrodynamics', 'added_mass')}")
        axes = "xyzpqr"
        for i, row in enumerate(axes):
            lines.append(
                "        "
                + "".join(
                    f"<{row}{axes[j]}>{number(vehicle.M_A[i, j])}</{row}{axes[j]}>"
                    for j in range(i, len(axes))
                )
            )
        lines.append("      </fluid_added_mass>")
    return [*lines, "    </inertial>"]


def _displaced(vehicle: VehicleModel, cite: Cite) -> list[str]:
    """The displaced water: a sphere at the centre of buoyancy, which touches nobody."""
    volume = vehicle.buoyancy / (vehicle.density * vehicle.gravity)
    if volume == 0.0:
        return []
    centre = f"<pose>{_row(vehicle.center_of_buoyancy)} 0 0 0</pose>"
    geometry = f"<geometry><sphere><radius>{number((0.75 * volume / math.pi) ** (1 / 3))}</radius></sphere></geometry>"
    source = next(
        (text for key in ("volume", "force", "net") if (text := cite("buoyancy", key))),
        "",
    )
    return [
        f"    <!-- The Buoyancy system takes its volume, {volume:.9g} m3, from here. -->{source.strip()}",
        f'    <collision name="displaced_water">{centre}{cite("buoyancy", "center")}',
        f"      {geometry}",
        "      <surface><contact><collide_bitmask>0</collide_bitmask></contact></surface>",
        "    </collision>",
        f'    <visual name="hull">{centre}',
        f"      {geometry}",
        "      <material><diffuse>0.1 0.3 0.7 0.6</diffuse></material>",
        "    </visual>",
    ]


def _propeller(vehicle: VehicleModel, index: int, space: str, cite: Cite) -> list[str]:
    unit = vehicle.units[index]
    low, high = sorted(float(limit) for limit in vehicle.force_limits[index])
    if unit.rotor_constant:
        turning = [
            "<!-- F = k rho D^4 n|n| with D = 1 m: k rho D^4 is the sheet's. -->",
            f"<thrust_coefficient>{number(unit.rotor_constant / vehicle.density)}</thrust_coefficient>",
        ]
    else:
        turning = [
            "<!-- The command is the force in N; this says only how fast the propeller is seen to turn. -->",
            "<thrust_coefficient>1</thrust_coefficient>",
        ]
    spin = number(masses.spin(masses.PROPELLER))
    return [
        f'  <link name="{unit.name}_propeller">',
        f"    <pose>{_row(unit.position)} 0 0 0</pose>{_position_source(cite, unit.name)}",
        f"    <inertial><mass>{masses.PROPELLER}</mass><inertia><ixx>{spin}</ixx><iyy>{spin}</iyy><izz>{spin}</izz></inertia></inertial>",
        '    <visual name="propeller"><geometry><sphere><radius>0.02</radius></sphere></geometry></visual>',
        "  </link>",
        f'  <joint name="{unit.name}_joint" type="revolute">',
        f"    <parent>{LINK}</parent><child>{unit.name}_propeller</child>",
        f"    <axis><xyz>{_row(unit.direction)}</xyz><limit><lower>-1e16</lower><upper>1e16</upper></limit></axis>",
        "  </joint>",
        plugin(
            "thruster",
            "Thruster",
            f"<namespace>{escape(space)}</namespace>",
            f"<topic>{unit.name}/cmd</topic>",
            f"<joint_name>{unit.name}_joint</joint_name>",
            *turning,
            "<propeller_diameter>1</propeller_diameter>",
            f"<fluid_density>{number(vehicle.density)}</fluid_density>",
            "<velocity_control>true</velocity_control>",
            f"<min_thrust_cmd>{number(low)}</min_thrust_cmd>",
            f"<max_thrust_cmd>{number(high)}</max_thrust_cmd>",
        ),
    ]


def _position_source(cite: Cite, name: str) -> str:
    """The sources of a thruster's position: of a group of them, or of one on its own."""
    return cite("actuators", "thrusters", "positions") or cite("actuators", name, "position")


def _publishers(space: str) -> list[str]:
    """Pose and odometry of the body, by the names that Centrale Nantes' bridge expects."""
    return [
        plugin(
            "pose-publisher",
            "PosePublisher",
            "<publish_model_pose>true</publish_model_pose>",
            "<publish_link_pose>false</publish_link_pose>",
            "<publish_nested_model_pose>true</publish_nested_model_pose>",
            "<use_pose_vector_msg>false</use_pose_vector_msg>",
            "<update_frequency>100</update_frequency>",
        ),
        plugin(
            "odometry-publisher",
            "OdometryPublisher",
            f"<odom_topic>/model/{escape(space)}/odometry</odom_topic>",
            "<odom_frame>world</odom_frame>",
            f"<robot_base_frame>{LINK}</robot_base_frame>",
            # Not on the topic of the poses, which by default it shares with another type of message.
            f"<tf_topic>/model/{escape(space)}/tf</tf_topic>",
            "<dimensions>3</dimensions>",
            "<odom_publish_frequency>100</odom_publish_frequency>",
        ),
    ]


def _hydrodynamics(vehicle: VehicleModel, hydrodynamics: str, cite: Cite, current: FloatArray | None) -> str:
    """Damping, and where it is `published` added mass, of the Hydrodynamics plugin: derivatives, hence the minus."""
    body = [f"<link_name>{LINK}</link_name>"]
    for key, form, values in (
        ("linear_damping", "{r}{m}", vehicle.linear_damping),
        ("quadratic_damping", "{r}{m}abs{m}", vehicle.quadratic_damping),
    ):
        source = cite("hydrodynamics", key)
        tags = [form.format(r=r, m=m) for r, m in zip(_REACTION, _MOTION, strict=True)]
        body += [
            f"<{tag}>{number(-v)}</{tag}>{source}" for tag, v in zip(tags, values, strict=True) if v != 0.0
        ]
    if hydrodynamics == "corrected":
        body += [
            "<!-- Added mass is the link's <fluid_added_mass>. -->",
            "<disable_added_mass>true</disable_added_mass>",
            "<disable_coriolis>true</disable_coriolis>",
        ]
    else:
        source = cite("hydrodynamics", "added_mass")
        body += [
            f"<{_REACTION[i]}Dot{_MOTION[j]}>{number(-vehicle.M_A[i, j])}</{_REACTION[i]}Dot{_MOTION[j]}>{source}"
            for i in range(6)
            for j in range(6)
            if vehicle.M_A[i, j] != 0.0
        ]
        if not vehicle.added_mass_coriolis:
            body.append("<disable_coriolis>true</disable_coriolis>")
    if current is not None:
        body.append(f"<default_current>{_row(current)}</default_current>")
    return plugin("hydrodynamics", "Hydrodynamics", *body)
