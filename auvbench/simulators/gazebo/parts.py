"""Parts of a vehicle's model: mass, displaced water, propellers, publishers and hydrodynamics."""

from __future__ import annotations

import math
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray

from auvbench.simulators.gazebo import masses
from auvbench.simulators.gazebo.elements import Cite, number, numbers, plugin
from auvbench.vehicles.vehicle_model import VehicleModel

FloatArray = NDArray[np.float64]

LINK = "base_link"
_MOTION = "UVWPQR"
_REACTION = "xyzkmn"


def inertial(vehicle: VehicleModel, hydrodynamics: str, cite: Cite, thrusters: bool) -> list[str]:
    """Return mass, centre and inertia of the link, and `corrected` added mass."""
    mass, r_g, inertia = masses.hull(vehicle) if thrusters else masses.whole(vehicle)
    note = f"    <!-- The propellers' {len(vehicle.units)} x {masses.PROPELLER:g} kg are taken off. -->"
    lines = [note] if thrusters and vehicle.units else []
    lines += [
        "    <inertial>",
        f"      <pose>{numbers(r_g)} 0 0 0</pose>{cite('rigid_body', 'center_of_gravity')}",
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


def displaced(vehicle: VehicleModel, cite: Cite) -> list[str]:
    """Return the displaced water: a sphere at the centre of buoyancy without contacts."""
    volume = vehicle.buoyancy / (vehicle.density * vehicle.gravity)
    if volume == 0.0:
        return []
    centre = f"<pose>{numbers(vehicle.center_of_buoyancy)} 0 0 0</pose>"
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


def propeller(vehicle: VehicleModel, index: int, space: str, cite: Cite) -> list[str]:
    """Return link, joint and Thruster plugin of one propeller."""
    unit = vehicle.thrusters[index][1]
    low, high = sorted(float(limit) for limit in vehicle.force_limits[index])
    if unit.rotor_constant:
        turning = [
            "<!-- F = k rho D^4 n|n| with D = 1 m: k rho D^4 is the sheet's. -->",
            f"<thrust_coefficient>{number(unit.rotor_constant / vehicle.density)}</thrust_coefficient>",
        ]
    else:
        turning = [
            "<!-- The command is the force in N; this sets only the visible speed of the propeller. -->",
            "<thrust_coefficient>1</thrust_coefficient>",
        ]
    spin = number(masses.spin(masses.PROPELLER))
    return [
        f'  <link name="{unit.name}_propeller">',
        f"    <pose>{numbers(unit.position)} 0 0 0</pose>{_position_source(cite, unit.name)}",
        f"    <inertial><mass>{masses.PROPELLER}</mass><inertia><ixx>{spin}</ixx><iyy>{spin}</iyy><izz>{spin}</izz></inertia></inertial>",
        '    <visual name="propeller"><geometry><sphere><radius>0.02</radius></sphere></geometry></visual>',
        "  </link>",
        f'  <joint name="{unit.name}_joint" type="revolute">',
        f"    <parent>{LINK}</parent><child>{unit.name}_propeller</child>",
        f"    <axis><xyz>{numbers(unit.direction)}</xyz><limit><lower>-1e16</lower><upper>1e16</upper></limit></axis>",
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
    """Return the sources of a thruster's position, its group's or its own."""
    return cite("actuators", "thrusters", "positions") or cite("actuators", name, "position")


def publishers(space: str) -> list[str]:
    """Return publishers of pose and odometry, with the names that Centrale Nantes' bridge expects."""
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
            # Its default topic is that of the poses, which have another type.
            f"<tf_topic>/model/{escape(space)}/tf</tf_topic>",
            "<dimensions>3</dimensions>",
            "<odom_publish_frequency>100</odom_publish_frequency>",
        ),
    ]


def hydrodynamics_plugin(
    vehicle: VehicleModel, hydrodynamics: str, cite: Cite, current: FloatArray | None
) -> str:
    """Return the Hydrodynamics plugin: damping, and `published` added mass, as derivatives, hence the minus."""
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
        body.append(f"<default_current>{numbers(current)}</default_current>")
    return plugin("hydrodynamics", "Hydrodynamics", *body)
