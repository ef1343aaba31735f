"""Tabulate the study of the thrusters' lag, whose commands are in conf/experiment/lag.yaml: `python -m benchmarks.lag outputs/lag`.

It reads the report of the study. `--write` renews docs/physics.md.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

from auvbench.runs.directory import RunDirectory
from benchmarks import pages

PAGE = Path(__file__).parents[1] / "docs" / "physics.md"
MARK = "python -m benchmarks.lag outputs/lag --write"
MEASURES = {  # of a task: title, column, factor, digits
    "waypoint": ("mean time to a waypoint, s", "par1_time_s", 1.0, 1),
    "station_keeping": ("RMS position error of station keeping, cm", "mean_position_error_rms_m", 100.0, 2),
}
AGENTS = ("MPC", "PID", "PPO")


def table(folder: Path) -> str:
    """Return the table of a study that was tested and reported."""
    cells: dict[tuple[str, str], dict[float, str]] = {}
    with (folder / "report" / "table.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            config = RunDirectory(folder / row["runs"].split()[0]).config()
            _, column, factor, digits = MEASURES[config["task"]["name"]]
            lag = float(config["vehicle"]["actuators"]["thrusters"]["lag"]["value"])
            low, value, high = (factor * float(row[f"{column}{end}"]) for end in ("_low", "", "_high"))
            shown = f"{value:.{digits}f} [{low:.{digits}f}, {high:.{digits}f}]"
            cells.setdefault((config["task"]["name"], row["agent"]), {})[lag] = shown
    lags = sorted({lag for row in cells.values() for lag in row})
    lines = [f"| | {' | '.join(f'{1000 * lag:g} ms' for lag in lags)} |", "|---|" + "---:|" * len(lags)]
    for task, (title, *_) in MEASURES.items():
        lines.append(f"| *{title}* |" + " |" * len(lags))
        lines += [f"| {agent} | {' | '.join(cells[task, agent][lag] for lag in lags)} |" for agent in AGENTS]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Print the table, or write it into the page."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.lag", description=__doc__)
    parser.add_argument("folder", type=Path, help="runs of the study, with their report")
    parser.add_argument("--write", action="store_true", help="renew docs/physics.md")
    given = parser.parse_args()
    if not (given.folder / "report" / "table.csv").is_file():
        parser.error(f"{given.folder} has no report; type auvbench report {given.folder}")
    made = table(given.folder)
    if not given.write:
        print(made, end="")
        return
    PAGE.write_text(pages.replaced(PAGE.read_text(encoding="utf-8"), MARK, f"\n{made}"), encoding="utf-8")


if __name__ == "__main__":
    main()
