"""Name the integrations: what talks to foreign systems, each in a folder of its own.

An integration enters as an installed package does, by the specs that are named here. Without the folders and the lines below, the
core works; some integrations use others.
"""

from __future__ import annotations

_HERE = "auvbench.integrations"
REGISTERED: dict[str, dict[str, str]] = {
    "auvbench.agents": {"ardusub": f"{_HERE}.ardusub.spec:agent"},
    "auvbench.simulators": {
        "gazebo": f"{_HERE}.gazebo.spec:simulator",
        "ros2": f"{_HERE}.ros2.spec:simulator",
    },
    "auvbench.commands": {
        "serve": f"{_HERE}.commands.spec:serve",
        "pilot": f"{_HERE}.commands.spec:pilot",
    },
    "auvbench.launchers": {"slurm": f"{_HERE}.cluster.spec:slurm", "ray": f"{_HERE}.cluster.spec:ray"},
    "auvbench.trackers": {
        "wandb": f"{_HERE}.tracking.spec:wandb",
        "mlflow": f"{_HERE}.tracking.spec:mlflow",
    },
}
"""Names of the integrations' specs by kind, as in `auvbench.registry`."""
LOGS: dict[str, tuple[str, str]] = {
    ".bin": ("ArduSub's .BIN", f"{_HERE}.mavlink.dataflash:read"),
    ".tlog": (".tlog", f"{_HERE}.mavlink.tlog:read"),
    "metadata.yaml": ("folders of ROS 2 bags", f"{_HERE}.ros2.bags:read"),
}
"""Logs by the ending of a file, or by a file that the log's folder contains: what help calls them, and the reader, which takes the path
and the names of the thrusters in the order of an autopilot's motors.
"""
USED = (f"{_HERE}.gazebo.bindings", f"{_HERE}.ros2.simulator", f"{_HERE}.ardusub.radio")
"""Modules whose function `used` returns the versions of the foreign programs that this process uses."""
JOBS = (f"{_HERE}.cluster.job:name",)
"""Functions that return the name of the cluster's job that contains this process, or None."""
FIGURES = {"gazebo": f"{_HERE}.gazebo.figure:draw"}
"""Figures of a report by file name, each a function as in `auvbench.reporting.figures`."""
EXPORTS = (f"{_HERE}.gazebo.export",)
"""Modules that write a vehicle for a foreign program: `add_options` adds options to `auvbench vehicles`, EXAMPLE shows one, and
`write` returns whether one was chosen.
"""
