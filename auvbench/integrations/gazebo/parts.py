"""Write parts of a vehicle's model as SDF: mass, displaced water, propellers, publishers and hydrodynamics."""

from __future__ import annotations

import math
import re
from typing import Any
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray

from auvbench.errors import VehicleError
from auvbench.vehicles.vehicle_model import VehicleModel

FloatArray = NDArray[np.float64]

LINK = "base_link"
_MOTION = "UVWPQR"
_REACTION = "xyzkmn"

PROPELLER = 0.01
"""Mass in kg of each propeller link. A Thruster plugin needs this link, but the sheets do not describe it. The link's
mass and inertia are subtracted from the hull.
"""
SPIN = 0.4 * PROPELLER * 0.02**2
"""Moment of inertia in kg m2 of a propeller link, modelled as a sphere of 2 cm radius"""


def inertial(vehicle: VehicleModel, hydrodynamics: str, thrusters: bool) -> list[str]:
    """Return the lines of the link's `<inertial>` element; for `corrected` it includes the added mass."""
    mass, r_g, inertia = vehicle.mass, vehicle.center_of_gravity, vehicle.inertia
    if thrusters:
        mass, r_g, inertia = hull(vehicle)
    note = (
        f"    <!-- The propellers' {len(vehicle.units)} x {PROPELLER:g} kg are subtracted from the hull. -->"
    )
    lines = [note] if thrusters and vehicle.units else []
    lines += [
        "    <inertial>",
        f"      <pose>{numbers(r_g)} 0 0 0</pose>",
        f"      <mass>{number(mass)}</mass>",
        "      <inertia>",
    ]
    lines += [*_entries(inertia, "xyz", "i"), "      </inertia>"]
    if hydrodynamics == "corrected" and np.any(vehicle.M_A):
        lines.append("      <fluid_added_mass>")
        lines += [*_entries(vehicle.M_A, "xyzpqr"), "      </fluid_added_mass>"]
    return [*lines, "    </inertial>"]


def _entries(matrix: FloatArray, axes: str, prefix: str = "") -> list[str]:
    """Return the upper triangle of a symmetric matrix as XML elements, one line for each row."""
    lines = []
    for i, row in enumerate(axes):
        tags = [f"{prefix}{row}{column}" for column in axes[i:]]
        values = zip(tags, matrix[i, i:], strict=True)
        lines.append("        " + "".join(f"<{tag}>{number(value)}</{tag}>" for tag, value in values))
    return lines


def displaced(vehicle: VehicleModel) -> list[str]:
    """Return the SDF lines of the displaced water: a sphere without contacts, with its centre at the centre of buoyancy."""
    volume = vehicle.buoyancy / (vehicle.density * vehicle.gravity)
    if volume == 0.0:
        return []
    centre = f"<pose>{numbers(vehicle.center_of_buoyancy)} 0 0 0</pose>"
    geometry = f"<geometry><sphere><radius>{number((0.75 * volume / math.pi) ** (1 / 3))}</radius></sphere></geometry>"
    return [
        f"    <!-- The Buoyancy system takes its volume, {volume:.9g} m3, from here. -->",
        f'    <collision name="displaced_water">{centre}',
        f"      {geometry}",
        "      <surface><contact><collide_bitmask>0</collide_bitmask></contact></surface>",
        "    </collision>",
        f'    <visual name="hull">{centre}',
        f"      {geometry}",
        "      <material><diffuse>0.1 0.3 0.7 0.6</diffuse></material>",
        "    </visual>",
    ]


def propeller(vehicle: VehicleModel, index: int, space: str) -> list[str]:
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
    spin = number(SPIN)
    return [
        f'  <link name="{unit.name}_propeller">',
        f"    <pose>{numbers(unit.position)} 0 0 0</pose>",
        f"    <inertial><mass>{PROPELLER}</mass><inertia><ixx>{spin}</ixx><iyy>{spin}</iyy><izz>{spin}</izz></inertia></inertial>",
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


def publishers(space: str) -> list[str]:
    """Return the plugins that publish pose and odometry, with the topic names that Centrale Nantes' bridge expects."""
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
            # By default, the plugin's transforms have the topic of the PosePublisher, but another message type.
            f"<tf_topic>/model/{escape(space)}/tf</tf_topic>",
            "<dimensions>3</dimensions>",
            "<odom_publish_frequency>100</odom_publish_frequency>",
        ),
    ]


def hydrodynamics_plugin(vehicle: VehicleModel, hydrodynamics: str, current: FloatArray | None) -> str:
    """Return the Hydrodynamics plugin with damping and, for `published`, added mass.

    The plugin's tags are Fossen's derivatives, so their values are negative.
    """
    body = [f"<link_name>{LINK}</link_name>"]
    for form, values in (
        ("{r}{m}", vehicle.linear_damping),
        ("{r}{m}abs{m}", vehicle.quadratic_damping),
    ):
        tags = [form.format(r=r, m=m) for r, m in zip(_REACTION, _MOTION, strict=True)]
        body += [f"<{tag}>{number(-v)}</{tag}>" for tag, v in zip(tags, values, strict=True) if v != 0.0]
    if hydrodynamics == "corrected":
        body += [
            "<!-- Added mass is the link's <fluid_added_mass>. -->",
            "<disable_added_mass>true</disable_added_mass>",
            "<disable_coriolis>true</disable_coriolis>",
        ]
    else:
        body += [
            f"<{_REACTION[i]}Dot{_MOTION[j]}>{number(-vehicle.M_A[i, j])}</{_REACTION[i]}Dot{_MOTION[j]}>"
            for i in range(6)
            for j in range(6)
            if vehicle.M_A[i, j] != 0.0
        ]
        if not vehicle.added_mass_coriolis:
            body.append("<disable_coriolis>true</disable_coriolis>")
    if current is not None:
        body.append(f"<default_current>{numbers(current)}</default_current>")
    return plugin("hydrodynamics", "Hydrodynamics", *body)


def explicit_growth(vehicle: VehicleModel) -> float:
    """Return the growth factor per step of an acceleration error if added mass is an explicit force.

    For M_RB a[k+1] = tau - M_A a[k], each step multiplies an error by the largest eigenvalue of M_RB^-1 M_A, for any
    step size.
    """
    return float(np.abs(np.linalg.eigvals(np.linalg.solve(vehicle.M_RB, vehicle.M_A))).max())


def hull(vehicle: VehicleModel) -> tuple[float, FloatArray, FloatArray]:
    """Return mass in kg, centre of gravity (3,) in m and inertia (3, 3) in kg m2 of a vehicle without its propellers."""
    mass = vehicle.mass - PROPELLER * len(vehicle.units)
    if mass <= 0.0:
        raise VehicleError(
            f"vehicle {vehicle.name}: {len(vehicle.units)} propellers of {PROPELLER:g} kg exceed its"
            f" {vehicle.mass:g} kg"
        )
    moment = vehicle.mass * vehicle.center_of_gravity - PROPELLER * sum(
        (unit.position for unit in vehicle.units), np.zeros(3)
    )
    r_g = moment / mass
    inertia = vehicle.inertia + _parallel(vehicle.mass, vehicle.center_of_gravity)
    for unit in vehicle.units:
        inertia = inertia - _parallel(PROPELLER, unit.position) - SPIN * np.eye(3)
    return mass, r_g, inertia - _parallel(mass, r_g)


def _parallel(mass: float, r: FloatArray) -> FloatArray:
    """Return the inertia (3, 3) of a point mass at `r` (3,) about the origin."""
    return np.asarray(mass * (float(r @ r) * np.eye(3) - np.outer(r, r)))


def comment(text: str) -> str:
    """Escape `text` for an XML comment."""
    return re.sub("-{2,}", "-", text)


def plugin(library: str, name: str, *body: str) -> str:
    """Return a `<plugin>` element of one of Gazebo's systems, indented by two spaces."""
    opening = f'  <plugin filename="gz-sim-{library}-system" name="gz::sim::systems::{name}"'
    if not body:
        return f"{opening}/>"
    return "\n".join([f"{opening}>", *(f"    {line}" for line in body), "  </plugin>"])


def number(value: float) -> str:
    """Return the shortest decimal text that converts back to exactly this number."""
    value = float(value) + 0.0  # no negative zero
    return str(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(value)


def numbers(values: Any) -> str:
    """Return numbers separated by spaces."""
    return " ".join(number(value) for value in values)
