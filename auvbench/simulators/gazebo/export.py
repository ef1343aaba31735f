"""The files of `auvbench vehicles NAME --sdf DIR`: model, world, and ROS 2 bridge and launch file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from string import Template
from xml.sax.saxutils import escape

from auvbench.simulators.gazebo import parts, sdf
from auvbench.vehicles.vehicle_model import VehicleModel

WORLD = "ocean"
"""Name of the world, as for Centrale Nantes' BlueROV2."""

_MEANING = {
    "corrected": "added mass as <fluid_added_mass>, which DART integrates with its Coriolis term",
    "published": "added mass in the Hydrodynamics plugin, explicit and with a wrong Coriolis term, as in the thesis",
}


def files(vehicle: VehicleModel, hydrodynamics: str, step: float) -> dict[str, str]:
    """Return contents by path below the folder.

    Args:
        vehicle: the vehicle.
        hydrodynamics: one of `sdf.HYDRODYNAMICS`.
        step: s, the world's physics step.

    Raises:
        VehicleError: as `sdf.check_vehicle`.
    """
    name = vehicle.name
    model = sdf.model(vehicle, hydrodynamics)
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
    alone = "\n".join(
        [
            '<?xml version="1.0"?>',
            "<!--",
            *(f"  {parts.comment(line)}" for line in header.splitlines()),
            "-->",
        ]
    )
    return {
        f"{name}/model.config": _config(vehicle),
        f"{name}/model.sdf": f'{alone}\n<sdf version="{sdf.VERSION}">\n{model}\n</sdf>\n',
        f"{name}.world.sdf": sdf.world([model], vehicle, name=WORLD, step=step, header=header),
        f"{name}.bridge.yaml": bridge(vehicle),
        f"{name}.launch.py": _LAUNCH.substitute(name=name, world=WORLD),
    }


def write(folder: Path, contents: Mapping[str, str]) -> list[Path]:
    """Write files below `folder`; return their paths."""
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
            f'  <sdf version="{sdf.VERSION}">model.sdf</sdf>',
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
    lines = [f"# Topics of {name} between ROS 2 and Gazebo Harmonic, for ros_gz_bridge's parameter_bridge."]
    for row in rows:
        lines += [
            f"{'- ' if i == 0 else '  '}{key}: {value}"
            for i, (key, value) in enumerate(zip(keys, row, strict=True))
        ]
    return "\n".join([*lines, ""])


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
