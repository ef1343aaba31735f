"""Convert a vehicle's sheet to SDF for Gazebo Harmonic (gz-sim 8, DART): a model, and a world of water for models.

Gazebo and auvbench have the same axes (world ENU, body FLU), and the link frame is the body origin, so the
numbers of the `VehicleModel` are written unchanged. Only the tags of the Hydrodynamics plugin have a minus sign,
because they are Fossen's derivatives.

`files` returns the files of `auvbench vehicles NAME --sdf DIR`: model, world, ROS 2 bridge and launch file.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from string import Template
from xml.sax.saxutils import escape

import numpy as np
import yaml
from numpy.typing import NDArray

from auvbench.errors import VehicleError
from auvbench.integrations.gazebo import parts
from auvbench.integrations.gazebo.parts import LINK, comment, number, plugin
from auvbench.vehicles.vehicle_model import VehicleModel

FloatArray = NDArray[np.float64]

HYDRODYNAMICS = ("corrected", "published")
"""Implementations of added mass.

`corrected`: `<fluid_added_mass>`, which DART adds to the body's inertia; DART then also computes the Coriolis term.
`published`: the explicit added mass of the Hydrodynamics plugin, as in models with `<xDotU>` tags. Its
Coriolis term has the wrong sign (measured in gz-sim 8.14.0) or wrong entries (before 8.12.0).
"""

VERSION = "1.11"

WORLD = "ocean"
"""Name of the world, the same as for Centrale Nantes' BlueROV2."""

_MEANING = {
    "corrected": "added mass as <fluid_added_mass>, which DART integrates with its Coriolis term",
    "published": "added mass in the Hydrodynamics plugin, explicit and with a wrong Coriolis term, as in the thesis",
}


def check_vehicle(vehicle: VehicleModel, hydrodynamics: str) -> None:
    """Check that Gazebo's plugins can simulate a vehicle.

    Raises:
        VehicleError: the vehicle has actuators other than thrusters, a weight that is not mass times gravity,
            a Coriolis term of added mass that DART cannot compute, or added mass that diverges as an explicit force.
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
            f"vehicle {vehicle.name}: its added-mass Coriolis term is a copy of Gazebo's plugin ({vehicle.plugin}); "
            "in Gazebo use the original vehicle with simulator.hydrodynamics=published"
        )
    if hydrodynamics == "corrected":
        if not vehicle.added_mass_coriolis and np.any(vehicle.M_A):
            raise VehicleError(
                f"vehicle {vehicle.name}: added_mass_coriolis is false, but <fluid_added_mass> includes that term;"
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
        vehicle: vehicle of the model.
        hydrodynamics: one of `HYDRODYNAMICS`.
        name: name of the model; default: the vehicle's name.
        thrusters: whether to add links, joints and Thruster plugins, and publishers of pose and odometry.
        current: initial velocity of the water around the model in world axes, (3,), m/s; a message on
            `/ocean_current` changes the velocity.

    Raises:
        VehicleError: see `check_vehicle`.
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
        vehicle: vehicle that defines gravity and density.
        name: name of the world.
        step: physics step, s.
        real_time_factor: 1 for real time, 0 for as fast as possible.
        scene: whether to add light and SceneBroadcaster for a window.
        header: comment at the top.
    """
    lines = _opening(header)
    lines += [
        f'<sdf version="{VERSION}" xmlns:gz="http://gazebosim.org/schema">',
        f'<world name="{escape(name)}">',
    ]
    if not scene:  # threads would cost more time than the post-updates that they run
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
        # One fluid everywhere, since the sheet's buoyancy also acts on a vehicle above the surface.
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


def files(vehicle: VehicleModel, hydrodynamics: str, step: float) -> dict[str, str]:
    """Return the contents of all files of a vehicle, by path below the output folder.

    Args:
        vehicle: vehicle of the model.
        hydrodynamics: one of `HYDRODYNAMICS`.
        step: physics step of the world, s.

    Raises:
        VehicleError: see `check_vehicle`.
    """
    name = vehicle.name
    own = model(vehicle, hydrodynamics)
    header = "\n".join(
        [
            f"{vehicle.title}, written by auvbench from its sheet.",
            f"Hydrodynamics {hydrodynamics}: {_MEANING[hydrodynamics]}.",
            "World east, north, up; body forward, port, up; SI units.",
            "Sources of the sheet's numbers:",
            *(f"{key}: {citation}" for key, citation in vehicle.sources),
            f"Thrust in N: gz topic -t /{name}/{vehicle.actuators[0]}/cmd -m gz.msgs.Double -p 'data: 10'",
        ]
    )
    opening = "\n".join(_opening(header))
    return {
        f"{name}/model.config": _config(vehicle),
        f"{name}/model.sdf": f'{opening}\n<sdf version="{VERSION}">\n{own}\n</sdf>\n',
        f"{name}.world.sdf": world([own], vehicle, name=WORLD, step=step, header=header),
        f"{name}.bridge.yaml": bridge(vehicle),
        f"{name}.launch.py": _LAUNCH.substitute(name=name, world=WORLD),
    }


def _opening(header: str) -> list[str]:
    """Return the first lines of an SDF file, with `header` as a comment unless it is empty."""
    lines = ['<?xml version="1.0"?>']
    if header:
        lines += ["<!--", *(f"  {comment(line)}" for line in header.splitlines()), "-->"]
    return lines


def write(folder: Path, contents: Mapping[str, str]) -> list[Path]:
    """Write files below `folder`, and return their paths."""
    paths = []
    for name, text in contents.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        paths.append(path)
    return paths


def _config(vehicle: VehicleModel) -> str:
    return "\n".join(
        [
            '<?xml version="1.0"?>',
            "<model>",
            f"  <name>{escape(vehicle.name)}</name>",
            "  <version>1.0</version>",
            f'  <sdf version="{VERSION}">model.sdf</sdf>',
            f"  <description>{escape(vehicle.title)}</description>",
            "</model>",
            "",
        ]
    )


def bridge(vehicle: VehicleModel) -> str:
    """Return the parameter file of `ros_gz_bridge`, with the topics of Centrale Nantes' BlueROV2."""
    name = vehicle.name
    rows = [
        (
            f"/{name}/cmd_{unit}",
            f"/{name}/{unit}/cmd",
            "std_msgs/msg/Float64",
            "gz.msgs.Double",
            "ROS_TO_GZ",
        )
        for unit in vehicle.actuators
    ]
    rows += [
        ("/current", "/ocean_current", "geometry_msgs/msg/Vector3", "gz.msgs.Vector3d", "ROS_TO_GZ"),
        (
            f"/{name}/pose_gt",
            f"/model/{name}/pose",
            "geometry_msgs/msg/Pose",
            "gz.msgs.Pose",
            "GZ_TO_ROS",
        ),
        (
            f"/{name}/odom",
            f"/model/{name}/odometry",
            "nav_msgs/msg/Odometry",
            "gz.msgs.Odometry",
            "GZ_TO_ROS",
        ),
        ("/clock", "/clock", "rosgraph_msgs/msg/Clock", "gz.msgs.Clock", "GZ_TO_ROS"),
    ]
    keys = ("ros_topic_name", "gz_topic_name", "ros_type_name", "gz_type_name", "direction")
    header = f"# Topics of {name} between ROS 2 and Gazebo Harmonic, for ros_gz_bridge's parameter_bridge.\n"
    return header + yaml.safe_dump([dict(zip(keys, row, strict=True)) for row in rows], sort_keys=False)


_LAUNCH = Template('''"""Gazebo Harmonic with $name, headless, and the bridge to ROS 2 Jazzy.

    ros2 launch $name.launch.py            # gui:=true opens Gazebo's window

Needs ros-jazzy-ros-gz. The services need ros_gz 1.0.11 or later.
"""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.conditions import IfCondition, UnlessCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

HERE = Path(__file__).resolve().parent
WORLD = str(HERE / "$name.world.sdf")
BRIDGE = str(HERE / "$name.bridge.yaml")


def generate_launch_description() -> LaunchDescription:
    gui = LaunchConfiguration("gui")
    return LaunchDescription(
        [
            DeclareLaunchArgument("gui", default_value="false"),
            ExecuteProcess(cmd=["gz", "sim", "-r", "-s", WORLD], condition=UnlessCondition(gui)),
            ExecuteProcess(cmd=["gz", "sim", "-r", WORLD], condition=IfCondition(gui)),
            Node(
                package="ros_gz_bridge",
                executable="parameter_bridge",
                arguments=[
                    "/world/$world/set_pose@ros_gz_interfaces/srv/SetEntityPose",
                    "/world/$world/control@ros_gz_interfaces/srv/ControlWorld",
                ],
                parameters=[{"config_file": BRIDGE}],
            ),
        ]
    )
''')
