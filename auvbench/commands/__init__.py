"""One short file per command: reads the command line and calls the other packages."""

COMMANDS: dict[str, str] = {
    "init": "make a project with a controller, task, vehicle and experiment of your own",
    "train": "train one run, or a grid of runs with -m",
    "resume": "finish interrupted runs, or extend runs to a larger budget",
    "evaluate": "apply a test protocol to trained runs",
    "tune": "search for settings of an algorithm on validation scenarios",
    "report": "rank runs and write tables, figures and a page",
    "compare": "show two runs or agents side by side",
    "publish": "copy a study's rows, tables and figures into a folder to ship",
    "submit": "check an entry of your own and write it as one archive",
    "verify": "test an entry again from its archive, and compare the rows",
    "bound": "compute the shortest time known to each waypoint",
    "plan": "say how many seeds and episodes resolve a difference",
    "vehicles": "list vehicles, or show what one vehicle's numbers imply",
    "simulate": "integrate one vehicle open loop, to CSV or a plot",
    "serve": "put a simulator behind ROS 2, or behind ArduSub",
    "pilot": "steer a vehicle over ROS 2 by an exported policy or a controller",
    "runs": "list runs with state, progress and success",
    "export": "write the policy of a run as an ONNX file with a card",
    "replay": "show one test episode again: summary, figure, film",
    "completion": "print a script for tab completion in bash, zsh or fish",
}
"""Name and one line of help, in the order of `auvbench --help`."""
