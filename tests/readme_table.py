"""Write the generated blocks of README.md, docs/ and results/: tables from the published studies, code from `examples/`.

`python -m tests.readme_table` in the root of the repository. The best value of each column of a table is bold. A page
marks a block by `<!-- begin: NAME -->` and `<!-- end: NAME -->`. NAME is a table or the path of a file of code.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Sequence
from pathlib import Path

NO_BREAK = "\u00a0"
"""a space at which narrow screens do not break a cell"""
ROOT = Path(__file__).parents[1]
LEADERBOARD, ROBUST, STATION, SUITE = (
    ROOT / "results" / name for name in ("leaderboard", "robust", "station", "suite")
)
AGENTS = ("MPC", "PPO added to PID", "PID", "PPO", "SAC")
MORE_AGENTS = ("MPC, tuned", "MPC", "PID", "LQR", "SMC", "PPO added to PID", "PPO", "SAC", "TD3")
CONDITIONS = {
    "1 m/s current": "current=1",
    "realistic inertia": "vehicle=bluerov2-realistic-inertia",
    "other hydrodynamics": "vehicle=bluerov2-wu2018",
}
VEHICLES = {
    name: f"vehicle={name.replace('_', '-')}"
    for name in ("bluerov2", "bluerov2_realistic_inertia", "bluerov2_wu2018")
}
TASKS = {  # title, measure, unit and its factor
    "": ("waypoints reached", "success_rate", "%", 100.0),
    "station_keeping": ("station keeping, RMS error", "mean_position_error_rms_m", "cm", 100.0),
    "trajectory_tracking": ("trajectories, RMS error", "mean_position_error_rms_m", "cm", 100.0),
    "path_following": ("paths, RMS distance", "mean_cross_track_rms_m", "cm", 100.0),
    "docking": ("docking, PAR-1 time", "par1_time_s", "s", 1.0),
}
SIGNS = {"ahead": "▲", "equivalent": "■", "behind": "▼", "open": "○", "baseline": ""}
SEA = {  # title, condition
    "trained round": "nominal",
    "`bluerov2_wu2018`": "vehicle=bluerov2-wu2018",
    "0.5 m/s current": "current=0.5",
}
MODELS = {
    "trained round": "nominal",
    "`bluerov2`": "vehicle=bluerov2",
    "`bluerov2_wu2018`": "vehicle=bluerov2-wu2018",
    "`gz_sim_8_11`": "vehicle=bluerov2-gz-sim-8-11",
    "`gz_sim_8_12`": "vehicle=bluerov2-gz-sim-8-12",
    "1 m/s current": "current=1",
}


def leaderboard() -> str:
    """Return five rows: time to the waypoint with its interval, then success under each condition."""
    ranked = {row["agent"]: row for row in _rows(LEADERBOARD, "table.csv")}
    chosen = [ranked[agent] for agent in AGENTS]
    least = min(float(row["par1_time_s"]) for row in chosen)
    times = [_time(row, float(row["par1_time_s"]) == least) for row in chosen]
    still = _shares([float(row["success_rate"]) for row in chosen])
    columns = [times, still, *(_success(LEADERBOARD, AGENTS, condition) for condition in CONDITIONS.values())]
    return _table(("waypoints", "mean time", "still water", *CONDITIONS), AGENTS, columns)


def vehicles() -> str:
    """Return the success of some agents on each vehicle of the transfer test."""
    columns = [_success(LEADERBOARD, MORE_AGENTS, condition) for condition in VEHICLES.values()]
    return _table(("agent", *(f"`{name}`" for name in VEHICLES)), MORE_AGENTS, columns)


def robust() -> str:
    """Return the success of controllers, and of PPO without each ingredient, on each model of the vehicle."""
    ranked = [row for row in _rows(ROBUST, "table.csv") if row["agent"] != "random"]
    agents = [row["agent"] for row in ranked]
    times = [_time(row, row is ranked[0]) for row in ranked]
    columns = [times, *(_success(ROBUST, agents, condition) for condition in MODELS.values())]
    return _table(("agent", "mean time", *MODELS), agents, columns)


def station() -> str:
    """Return how near agents stay to a station in sea state 3 on models of the vehicle, and how many stations they hold."""
    agents = [row["agent"] for row in _rows(STATION, "table.csv") if row["agent"] != "random"]
    rows = _rows(STATION, "conditions.csv")
    errors = [
        {row["agent"]: 100 * float(row["mean_position_error_rms_m"]) for row in rows if row["condition"] == c}
        for c in SEA.values()
    ]
    least = [min(found[a] for a in agents) for found in errors]
    columns = [
        [f"**{found[a]:.1f} cm**" if found[a] == best else f"{found[a]:.1f} cm" for a in agents]
        for found, best in zip(errors, least, strict=True)
    ]
    heads = ("agent", *SEA, *(f"held, {title}" for title in list(SEA)[1:]))
    held = [_success(STATION, agents, condition) for condition in list(SEA.values())[1:]]
    return _table(heads, agents, [*columns, *held])


def suite() -> str:
    """Return what each agent reaches on each task, with a sign of its verdict against PID."""
    rows = _rows(SUITE, "table.csv")
    agents = list(dict.fromkeys(row["agent"] for row in rows if row["agent"] not in ("ALOS", "random")))
    columns = []
    for task, (_, measure, unit, scale) in TASKS.items():
        section = "bluerov2_heavy" + (f", task {task}" if task else "")
        found = {row["agent"]: row for row in rows if row["vehicle"] == section}
        columns.append(
            [
                f"{_digits(scale * float(found[a][measure]))} {unit} {SIGNS[found[a]['verdict']]}".strip()
                for a in agents
            ]
        )
    return _table(("agent", *(title for title, *_ in TASKS.values())), agents, columns)


TABLES: dict[str, Callable[[], str]] = {
    "leaderboard": leaderboard,
    "vehicles": vehicles,
    "robust": robust,
    "station": station,
    "suite": suite,
}
LANGUAGES = {".py": "python", ".toml": "toml", ".yaml": "yaml"}
EXAMPLE = "examples/auvbench-example"
PACKAGE = f"{EXAMPLE}/auvbench_example"
PAGES = {
    "README.md": ("leaderboard",),
    "docs/index.md": ("leaderboard",),
    "docs/results.md": ("suite",),
    "docs/adding-a-controller.md": (
        f"{EXAMPLE}/pyproject.toml",
        f"{PACKAGE}/conf/algo/pursuit.yaml",
        f"{PACKAGE}/pursuit.py",
        f"{PACKAGE}/search.py",
    ),
    "docs/adding-a-task.md": (
        f"{EXAMPLE}/pyproject.toml",
        f"{PACKAGE}/conf/task/circling.yaml",
        f"{PACKAGE}/circling.py",
        f"{PACKAGE}/view.py",
    ),
    "docs/adding-a-vehicle.md": ("examples/polyu.yaml",),
    "results/leaderboard/README.md": ("vehicles",),
    "results/robust/README.md": ("robust",),
    "results/station/README.md": ("station",),
    "results/suite/README.md": ("suite",),
}


def page(name: str) -> str:
    """Return a page with its blocks renewed.

    Raises:
        ValueError: the page does not have exactly one place for each block.
    """
    text = (ROOT / name).read_text(encoding="utf-8")
    for block in PAGES[name]:
        begin, end = (f"<!-- {word}: {block} -->" for word in ("begin", "end"))
        made = f"{begin}\n{TABLES[block]() if block in TABLES else code(block)}\n{end}"
        text, places = re.subn(
            f"{re.escape(begin)}.*?{re.escape(end)}", lambda _, made=made: made, text, flags=re.DOTALL
        )
        if places != 1:
            raise ValueError(f"{name}: {places} places for the block {begin} ... {end}, must have 1")
    return text


def code(path: str) -> str:
    """Return a file of the repository as a block of code, with its path above: GitHub shows no title of a block."""
    text = (ROOT / path).read_text(encoding="utf-8").strip("\n")
    return f"`{path}`:\n\n```{LANGUAGES[Path(path).suffix]}\n{text}\n```"


def _digits(value: float) -> str:
    """Return three digits; of a share just below 100 a fourth."""
    return f"{value:#.{4 if 99.9 < value < 100.0 else 3}g}".rstrip(".")


def _rows(study: Path, name: str) -> list[dict[str, str]]:
    with open(study / name, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def _success(study: Path, agents: Sequence[str], condition: str) -> list[str]:
    found = {
        row["agent"]: float(row["success_rate"])
        for row in _rows(study, "conditions.csv")
        if row["condition"] == condition
    }
    return _shares([found[agent] for agent in agents])


def _time(row: dict[str, str], best: bool) -> str:
    value, low, high = (float(row[f"par1_time_s{end}"]) for end in ("", "_low", "_high"))
    shown = f"{value:.1f}{NO_BREAK}s"
    return f"{f'**{shown}**' if best else shown} [{low:.1f},{NO_BREAK}{high:.1f}]"


def _shares(values: list[float]) -> list[str]:
    cells = [f"{_digits(100 * value)}{NO_BREAK}%" for value in values]
    return [f"**{cell}**" if v == max(values) else cell for v, cell in zip(values, cells, strict=True)]


def _table(heads: Sequence[str], agents: Sequence[str], columns: list[list[str]]) -> str:
    rows = [heads, *zip(agents, *columns, strict=True)]
    first, *rest = ("| " + " | ".join(row) + " |" for row in rows)
    return "\n".join([first, "|---" * len(heads) + "|", *rest])


if __name__ == "__main__":
    for page_name in PAGES:
        (ROOT / page_name).write_text(page(page_name), encoding="utf-8")
        print(f"wrote {page_name}")
