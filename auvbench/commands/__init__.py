"""One short file per command, the only place that joins rooms together."""

COMMANDS: dict[str, str] = {
    "train": "train one run, or a grid of runs with -m",
    "resume": "finish interrupted runs, or extend runs to a larger budget",
    "evaluate": "apply a test protocol to trained runs",
    "report": "rank runs and write tables, figures and a page",
    "plan": "say how many seeds and episodes resolve a difference",
    "vehicles": "list vehicles, or show what one vehicle's numbers imply",
    "simulate": "integrate one vehicle open loop, to CSV or a plot",
    "runs": "list runs with state, progress and success",
    "replay": "show one test episode again: summary, figure, film",
    "completion": "print a script for tab completion in bash, zsh or fish",
}
"""Name and one line of help, in the order of `auvbench --help`."""
