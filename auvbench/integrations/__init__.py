"""Register the integrations, which connect auvbench to foreign systems; each has its own folder.

The specs of an integration register it, like the specs of an installed package. The core works without the integrations' folders and
without the entries below. Some integrations use other integrations.
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
"""Import path of each integration's spec, by kind and name, as in `auvbench.registry`."""
LOGS: dict[str, tuple[str, str]] = {
    ".bin": ("ArduSub's .BIN", f"{_HERE}.mavlink.dataflash:read"),
    ".tlog": (".tlog", f"{_HERE}.mavlink.tlog:read"),
    "metadata.yaml": ("folders of ROS 2 bags", f"{_HERE}.ros2.bags:read"),
}
"""Log formats by the ending of a file, or by the name of a file in the log's folder.

Each value is the format's name in help texts and the import path of its reader. A reader takes the path of the log and the names of
the thrusters in the order of an autopilot's motors.
"""
USED = (f"{_HERE}.gazebo.bindings", f"{_HERE}.ros2.simulator", f"{_HERE}.ardusub.radio")
"""Modules whose function `used` returns the versions of the foreign programs that this process uses."""
JOBS = (f"{_HERE}.cluster.job:name",)
"""Functions that return the name of the cluster job in which this process runs, or None."""
FIGURES = {"gazebo": f"{_HERE}.gazebo.figure:draw"}
"""Figures of a report by file name, each a function as in `auvbench.reporting.figures`."""
EXPORTS = (f"{_HERE}.gazebo.export",)
"""Modules that write a vehicle for a foreign program. In each module `add_options` adds options to `auvbench vehicles`, `EXAMPLE` is an
example command, and `write` writes the files and returns whether the options ask for them.
"""
