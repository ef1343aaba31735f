"""Write the generated blocks of README.md, docs/ and results/: tables from the published studies, code from `examples/`.

`python -m tests.readme_table` in the root of the repository. The best value of each column of a table is bold. A page
marks a block by `<!-- begin: NAME -->` and `<!-- end: NAME -->`. NAME is a table or the path of a file of code.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from auvbench.statistics import typical

NO_BREAK = "\u00a0"
"""a space at which narrow screens do not break a cell"""
ROOT = Path(__file__).parents[1]
(
    FORMATION,
    LEADERBOARD,
    NAVIGATION,
    NAVIGATION_TASKS,
    NAVIGATION_TRANSIT,
    ROBUST,
    STATION,
    SUITE,
    SUITE_2026,
    TRANSFER,
    TRANSIT,
    TUNING,
    WAYPOINT,
) = (
    ROOT / "results" / name
    for name in (
        "formation",
        "leaderboard",
        "navigation",
        "navigation-tasks",
        "navigation-transit",
        "robust",
        "station",
        "suite",
        "suite-2026",
        "transfer",
        "transit",
        "tuning",
        "waypoint-2026",
    )
)
SEARCHED = {"pid": "PID", "lqr": "LQR", "smc": "SMC", "mpc": "MPC"}
AGENTS = ("MPC", "PPO added to PID", "PID", "PPO", "SAC")
MORE_AGENTS = ("MPC, tuned", "MPC", "PID", "LQR", "SMC", "PPO added to PID", "PPO", "SAC", "TD3")
FIRST = {  # title, task, measure, protocol and condition of the suite of 2026
    "waypoints": ("", "mean", "suite_2026", "still-water"),
    "other model": ("", "mean", "suite_2026", "vehicle=bluerov2-vonbenzon2022"),
    "stations": ("station_keeping", "mean", "suite_2026", "still-water"),
    "stations, 0.5 m/s": ("station_keeping", "mean", "suite_2026_conditions", "current=0.5"),
    "docks": ("docking", "success_rate", "suite_2026", "still-water"),
    "docks, dead thruster": ("docking", "success_rate", "suite_2026_conditions", "dead-thruster"),
}
FIRST_AGENTS = (
    "MPC, tuned",
    "PPO added to PID, tuned",
    "PPO, tuned",
    "PID, tuned",
    "LQR, tuned",
    "ADRC, tuned",
)
WATERS = {  # title, condition
    "still water": "nominal",
    "0.5 m/s current": "current=0.5",
    "sea state 3": "sea-state-3",
    "other model": "vehicle=bluerov2-vonbenzon2022",
}
LIMIT = 100.0
"""s, what a failure counts in the waypoint task"""
DOCKING_LIMIT = 60.0
"""s, what it counts in docking"""
TRANSIT_LIMIT = 120.0
"""s, what it counts in transit"""
CONDITIONS = {
    "1 m/s current": "current=1",
    "real inertia": "vehicle=bluerov2-realistic-inertia",
    "`bluerov2_wu2018`": "vehicle=bluerov2-wu2018",
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
TASK_WORDS = {
    "waypoint": "waypoints",
    "station_keeping": "stations",
    "trajectory_tracking": "trajectories",
    "path_following": "paths",
    "docking": "docks",
}
CURRENTS = {f"{speed} m/s": f"current={speed}" for speed in ("0.25", "0.5", "0.75", "1")}
IN_CURRENTS = ("PID", "PID, per task", "PPO 1M steps")
SIGNS = {"ahead": "▲", "equivalent": "■", "behind": "▼", "open": "○", "baseline": ""}
SEA = {  # title, condition
    "training vehicle": "nominal",
    "`bluerov2_wu2018`": "vehicle=bluerov2-wu2018",
    "0.5 m/s current": "current=0.5",
}
SENSORS = {  # title, condition
    "the truth": "truth",
    "survey grade": "survey",
    "DVL A50": "dvl-a50",
    "lock half the time": "half-lock",
    "no DVL, but the sheet": "no-dvl-model",
    "no DVL": "no-dvl",
}
MESSAGES = {  # title, condition: how often a vehicle is heard
    "every 1.5 s": "acoustic",
    "at once": "ideal",
    "every 4.2 s": "bytes=88",
    "every 11.4 s": "bytes=280",
    "60 % lost": "loss=0.6",
    "none": "no-message",
    "in 0.25 m/s": "current",
    "none, in 0.25 m/s": "current-no-message",
}
FIELDS = {  # title, condition: obstacles per m2
    "0.01 per m²": "density=0.01",
    "0.02": "density=0.02",
    "0.03": "density=0.03",
    "0.02, current": "current=0.25",
    "0.02, beams lost": "sonar-loss",
    "0.02, filter": "filter",
    "0.02, current, filter": "current-filter",
}
TRANSIT_LIMIT = 120.0
"""s, what a failure counts in transit"""
MODELS = {
    "training vehicle": "nominal",
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


def first_answers() -> str:
    """Return mean times to waypoints, mean errors at stations and success at docks under some conditions of the suite of 2026."""
    rows = {
        (row["vehicle"].partition(", task ")[2], row["protocol"], row["condition"], row["agent"]): row
        for row in _rows(SUITE_2026, "by_condition.csv")
    }
    columns = [
        [_answer(rows.get((task, protocol, condition, agent)), measure) for agent in FIRST_AGENTS]
        for task, measure, protocol, condition in FIRST.values()
    ]
    return _table(
        ("tuned agents", *FIRST), [agent.removesuffix(", tuned") for agent in FIRST_AGENTS], columns
    )


def _answer(row: dict[str, str] | None, column: str) -> str:
    """Return a mean with the share of successful episodes where it is not all of them, or the share; a dash if it was not tested."""
    if row is None:
        return "–"
    value, share = float(row[column]), float(row["success_rate"])
    if column == "success_rate":
        return f"{_per_cent(share)}{NO_BREAK}%"
    scaled, unit = (value, "s") if row["measure"] == "par1_time_s" else (100.0 * value, "cm")
    return _with_share(f"{scaled:.{1 if unit == 's' or scaled < 10.0 else 0}f}{NO_BREAK}{unit}", share, False)


def waters() -> str:
    """Return the mean time to the waypoint in each water, and the share that is reached where it is not all of them."""
    rows = _rows(WAYPOINT, "table.csv")
    columns = []
    for found in _times(WAYPOINT, rows, tuple(WATERS.values())):
        least = min(time for time, _ in found)
        columns.append([_reached(time, share, time == least) for time, share in found])
    columns[0] = [_time(row, cell.startswith("**")) for row, cell in zip(rows, columns[0], strict=True)]
    return _table(("mean time to a waypoint", *WATERS), [row["agent"] for row in rows], columns)


def _times(
    study: Path, rows: Sequence[dict[str, str]], conditions: Sequence[str], limit: float = LIMIT
) -> list[list[tuple[float, float]]]:
    """Return mean times to the waypoint, a failure counts `limit` s, and shares that are reached, of each row of a study's table under
    each condition.
    """
    episodes = _timed(study, limit)
    met = [episodes[episodes["condition"] == condition] for condition in conditions]
    return [
        [here[here["run"].isin(row["runs"].split())][["time", "reached"]].mean().tolist() for row in rows]
        for here in met
    ]


def _timed(study: Path, limit: float) -> pd.DataFrame:
    """Return the episodes of a study with the columns `reached` and `time`, in s; a failure counts `limit` s."""
    episodes = pd.read_parquet(study / "episodes.parquet")
    episodes["reached"] = episodes["outcome"] == "success"
    episodes["time"] = (episodes["steps"] / episodes["frequency_hz"]).where(episodes["reached"], limit)
    return episodes


def _reached(time: float, share: float, best: bool) -> str:
    return _with_share(f"{time:.1f}{NO_BREAK}s", share, best)


def _with_share(shown: str, share: float, best: bool) -> str:
    """Return a value, bold if it is the best, and the share of successful episodes where it is not all of them."""
    shown = f"**{shown}**" if best else shown
    return shown if share == 1.0 else f"{shown} ({_per_cent(share)}{NO_BREAK}%)"


def vehicles() -> str:
    """Return the success of some agents on each vehicle of the transfer test."""
    columns = [_success(LEADERBOARD, MORE_AGENTS, condition) for condition in VEHICLES.values()]
    return _table(("agent", *(f"`{name}`" for name in VEHICLES)), MORE_AGENTS, columns)


def robust() -> str:
    """Return the success of controllers, and of PPO without each ingredient, on each model of the vehicle."""
    ranked = [row for row in _rows(ROBUST, "table.csv") if row["agent"] != "random"]
    ranked.sort(key=lambda row: float(row["par1_time_s"]))
    agents = [row["agent"] for row in ranked]
    times = [_time(row, row is ranked[0]) for row in ranked]
    columns = [times, *(_success(ROBUST, agents, condition) for condition in MODELS.values())]
    return _table(("agent", "mean time", *MODELS), agents, columns)


def station() -> str:
    """Return how near agents stay to a station in sea state 3 on models of the vehicle, and how many stations they hold."""
    ranked = [row for row in _rows(STATION, "table.csv") if row["agent"] != "random"]
    agents = [row["agent"] for row in sorted(ranked, key=lambda row: float(row["mean_position_error_rms_m"]))]
    columns = []
    for values in _errors(STATION, agents, tuple(SEA.values())):
        cells = [f"{value:.1f} cm" for value in values]
        columns.append(
            [
                f"**{cell}**" if value == min(values) else cell
                for cell, value in zip(cells, values, strict=True)
            ]
        )
    heads = ("agent", *SEA, *(f"held, {title}" for title in list(SEA)[1:]))
    held = [_success(STATION, agents, condition) for condition in list(SEA.values())[1:]]
    return _table(heads, agents, [*columns, *held])


def _errors(
    study: Path,
    agents: Sequence[str],
    conditions: Sequence[str],
    task: str = "station_keeping",
    column: str = "mean_position_error_rms_m",
) -> list[list[float]]:
    """Return RMS errors in cm at a task, of each agent of a study under each condition."""
    rows = [row for row in _rows(study, "conditions.csv") if row["task"] == task]
    found = {(row["agent"], row["condition"]): row for row in rows}
    return [[100 * float(found[agent, condition][column]) for agent in agents] for condition in conditions]


def sensors(study: Path = NAVIGATION, task: str = "station_keeping") -> str:
    """Return how near agents stay to a reference with what each set of sensors lets them know, in cm."""
    rows = [row for row in _rows(study, "conditions.csv") if row["task"] == task]
    agents = sorted({row["agent"] for row in rows})
    columns = [
        [f"{value:.{0 if value >= 100 else 1}f}{NO_BREAK}cm" for value in values]
        for values in _errors(study, agents, tuple(SENSORS.values()), task)
    ]
    return _table(("RMS position error", *SENSORS), agents, columns)


def sensors_trajectories() -> str:
    """Return how near agents stay to a moving reference with what each set of sensors lets them know, in cm."""
    return sensors(NAVIGATION_TASKS, "trajectory_tracking")


def sensors_waypoints(
    study: Path = NAVIGATION,
    section: str = "bluerov2_2026",
    title: str = "mean time to a waypoint",
    limit: float = LIMIT,
    conditions: Mapping[str, str] = SENSORS,
) -> str:
    """Return how soon agents reach goals with what each set of sensors lets them know, and the share that they reach."""
    rows = [row for row in _rows(study, "table.csv") if row.get("vehicle", "") == section]
    rows.sort(key=lambda row: row["agent"])
    columns = [
        [_reached(*found, best=False) for found in times]
        for times in _times(study, rows, tuple(conditions.values()), limit)
    ]
    return _table((title, *conditions), [row["agent"] for row in rows], columns)


def sensors_docks() -> str:
    """Return how soon agents are in docks with what each set of sensors lets them know, and the share that succeeds."""
    section = "bluerov2_2026, task docking"
    return sensors_waypoints(NAVIGATION_TASKS, section, "mean time to the dock", limit=DOCKING_LIMIT)


def sensors_transit() -> str:
    """Return how soon agents cross fields with what each set of sensors lets them know, and the share that arrives."""
    title = "mean time, a failure as 120 s"
    conditions = SENSORS | {"current, the truth": "truth-current", "current, DVL A50": "dvl-a50-current"}
    return sensors_waypoints(NAVIGATION_TRANSIT, "", title, TRANSIT_LIMIT, conditions)


def transit_ends() -> str:
    """Return how crossings of fields end with some sets of sensors."""
    episodes = pd.read_parquet(NAVIGATION_TRANSIT / "episodes.parquet")
    rows = sorted(_rows(NAVIGATION_TRANSIT, "table.csv"), key=lambda row: row["agent"])
    agents = [row["agent"] for row in rows]
    columns, heads = [], []
    for title in ("the truth", "DVL A50", "no DVL"):
        for outcome in ("collision", "timeout"):
            met = episodes[episodes["condition"] == SENSORS[title]]
            shares = [
                (met[met["run"].isin(row["runs"].split())]["outcome"] == outcome).mean() for row in rows
            ]
            columns.append([f"{_per_cent(share)}{NO_BREAK}%" for share in shares])
            heads.append(f"{title}: {outcome}s")
    return _table(("agent", *heads), agents, columns)


def sensors_worth() -> str:
    """Return the declared contrasts on trajectories and at docks."""
    tasks = {"trajectory_tracking": ("trajectories", "cm"), "docking": ("docks", "s")}
    return contrasts(NAVIGATION_TASKS, tasks, DOCKING_LIMIT)


def transit_worth() -> str:
    """Return the declared contrasts in transit."""
    return contrasts(NAVIGATION_TRANSIT, {"transit": ("transit", "s")}, TRANSIT_LIMIT)


def contrasts(study: Path, tasks: dict[str, tuple[str, str]], limit: float) -> str:
    """Return what a DVL in place of the truth changes, and training on estimates, with 95 % intervals.

    Args:
        study: folder of a study whose conditions include dvl-a50 and truth.
        tasks: title and unit of each task: cm of RMS position error, or s to the goal.
        limit: what a failure counts, s.
    """
    episodes = _timed(study, limit)
    measures = {"s": episodes["time"]}
    if "position_error_rms_m" in episodes:
        measures["cm"] = 100.0 * episodes["position_error_rms_m"]
    (only,) = tasks if len(tasks) == 1 else ("",)
    sections = [(row, row.get("vehicle", only)) for row in _rows(study, "table.csv")]
    found = {
        (row["agent"], section.rpartition(" ")[2]): row["runs"].split()
        for row, section in sections
        if only or ", task " in section
    }
    agents = sorted({agent for agent, _ in found})

    def tested(agent: str, task: str, condition: str) -> Any:
        """Return the measure of a task (trainings, episodes)."""
        own = episodes["run"].isin(found[agent, task]) & (episodes["condition"] == condition)
        values = episodes[["run", "episode"]].assign(value=measures[tasks[task][1]])[own]
        return values.pivot_table(index="run", columns="episode", values="value").to_numpy()

    def shown(first: Any, second: Any, task: str) -> str:
        contrast = typical.difference(typical.sample(first), typical.sample(second))
        low, high = contrast.ends()
        return f"{contrast.value:+.1f}{NO_BREAK}{tasks[task][1]} [{low:.1f}, {high:.1f}]"

    def dvl(agent: str, task: str) -> str:
        if (agent, task) not in found:
            return ""
        change = tested(agent, task, "dvl-a50") - tested(agent, task, "truth")
        return shown(change, np.zeros((1, change.shape[1])), task)

    def training(condition: str) -> Callable[[str, str], str]:
        def text(agent: str, task: str) -> str:
            other = f"{agent}, trained on estimates"
            if (other, task) not in found:
                return ""
            return shown(tested(other, task, condition), tested(agent, task, condition), task)

        return text

    texts = (dvl, training("dvl-a50"), training("truth"))
    columns = [[text(agent, task) for agent in agents] for task in tasks for text in texts]
    heads = [
        head
        for title, _ in tasks.values()
        for head in (f"{title}: DVL A50 less truth", "trained on estimates", "the same, tested on the truth")
    ]
    return _table(("agent", *heads), agents, columns)


def transfer() -> str:
    """Return what agents with several sheets reach on the true vehicle, in still water and in a current."""
    rows = [row for row in _rows(TRANSFER, "table.csv") if row["vehicle"] == "several sheets"]
    agents = [row["agent"] for row in rows]
    waters = ("hidden", "hidden-current")
    columns = [[_reached(*found, best=False) for found in times] for times in _times(TRANSFER, rows, waters)]
    for task in ("station_keeping", "trajectory_tracking"):
        for values in _errors(TRANSFER, agents, waters, task):
            columns.append([f"{value:.1f}{NO_BREAK}cm" for value in values])
    current = "in 0.25 m/s"
    heads = (
        "waypoints: mean time",
        current,
        "stations: RMS error",
        current,
        "trajectories: RMS error",
        current,
    )
    return _table(("agent", *heads), agents, columns)


def formation() -> str:
    """Return the mean error of a team's relative positions with messages that are rare or get lost."""
    agents = sorted({row["agent"] for row in _rows(FORMATION, "conditions.csv")})
    errors = _errors(FORMATION, agents, tuple(MESSAGES.values()), "formation", "mean_formation_error_rms_m")
    columns = [[f"{value:.1f}{NO_BREAK}cm" for value in values] for values in errors]
    return _table(("formation error", *MESSAGES), agents, columns)


def transit() -> str:
    """Return how soon agents pass fields of obstacles by what they observe, and the share that they pass."""
    rows = _rows(TRANSIT, "table.csv")
    columns = [
        [_reached(*found, best=False) for found in times]
        for times in _times(TRANSIT, rows, tuple(FIELDS.values()), TRANSIT_LIMIT)
    ]
    agents = [row["agent"].replace("observed=range.", "").replace("observed=", "") for row in rows]
    return _table(("mean time", *FIELDS), agents, columns)


def suite() -> str:
    """Return what the typical training of each agent reaches on each task, with a sign of its verdict against PID."""
    rows = _rows(SUITE, "table.csv")
    agents = list(dict.fromkeys(row["agent"] for row in rows if row["agent"] not in ("ALOS", "random")))
    columns = []
    for task, (_, measure, unit, scale) in TASKS.items():
        section = "bluerov2_heavy" + (f", task {task}" if task else "")
        found = {row["agent"]: row for row in rows if row["vehicle"] == section}
        columns.append([_typical(found[a], found["PID"], measure, unit, scale) for a in agents])
    return _table(("agent", *(title for title, *_ in TASKS.values())), agents, columns)


def _under_disturbances() -> dict[tuple[str, str, str], dict[str, str]]:
    rows = _rows(SUITE, "conditions.csv")
    return {(r["task"], r["agent"], r["condition"]): r for r in rows if r["protocol"] == "suite"}


def cases() -> str:
    """Return per task how many disturbances leave PPO fewer goals than PID, or more: intervals that do not overlap."""
    found = _under_disturbances()
    columns: list[list[str]] = [[], [], []]
    for task in TASK_WORDS:
        words = []
        for (here, agent, condition), row in found.items():
            if (here, agent) == (task, "PPO 1M steps") and condition != "nominal":
                pid = found[task, "PID", condition]
                fewer = float(row["success_rate_high"]) < float(pid["success_rate_low"])
                more = float(row["success_rate_low"]) > float(pid["success_rate_high"])
                words.append("fewer" if fewer else "more" if more else "")
        for column, word in zip(columns, ("fewer", "more", ""), strict=True):
            column.append(str(words.count(word)))
    for column in columns:
        column.append(str(sum(map(int, column))))
    heads = ("task", "PPO reaches fewer goals", "PPO reaches more", "intervals overlap")
    return _table(heads, [*TASK_WORDS.values(), "all"], columns)


def currents() -> str:
    """Return how many docks and stations PID and PPO reach in each current, in per cent."""
    found = _under_disturbances()
    pairs = [(task, agent) for task in ("docking", "station_keeping") for agent in IN_CURRENTS]
    columns = [
        [_per_cent(float(found[task, agent, condition]["success_rate"])) for task, agent in pairs]
        for condition in CURRENTS.values()
    ]
    return _table(("agent", *CURRENTS), [f"{TASK_WORDS[task]}: {agent}" for task, agent in pairs], columns)


def elsewhere() -> str:
    """Return what untuned and tuned controllers reach on other vehicles, as the search's tests have it."""
    found = {
        (row["vehicle"], row["algo"]): row
        for row in _rows(TUNING, "tests.csv")
        if row["test"] == "elsewhere" and float(row["frequency_hz"]) == 10.0
    }
    on = sorted({vehicle for vehicle, _ in found})
    pairs = [(v, a) for v in on for a in SEARCHED if (v, a) in found and (v, f"{a}_tuned") in found]
    columns = [[SEARCHED[agent] for _, agent in pairs]]
    for suffix in ("", "_tuned"):
        here = [found[vehicle, agent + suffix] for vehicle, agent in pairs]
        columns.append([f"{row['successes']} of {row['episodes']}" for row in here])
        columns.append([f"{float(row['par1_steps']):.0f}" for row in here])
    heads = ("vehicle", "agent", "untuned: reached", "PAR-1 steps", "tuned: reached", "PAR-1 steps")
    return _table(heads, [f"`{vehicle}`" for vehicle, _ in pairs], columns)


def _typical(row: dict[str, str], pid: dict[str, str], measure: str, unit: str, scale: float) -> str:
    """Return the typical training and its verdict; in brackets the mean where it is more than a tenth, or a point, away."""
    mean = float(row[measure])
    value = float(pid[measure]) + float(row["difference"] or 0.0)  # a controller's typical value is its mean

    def shown(one: float) -> str:
        return _per_cent(one) if measure == "success_rate" else f"{scale * one:#.3g}"

    cell = f"{shown(value)} {unit} {SIGNS[row['verdict']]}".strip()
    apart = abs(mean - value) > (0.01 if measure == "success_rate" else 0.1 * value)
    return f"{cell} (mean {shown(mean)})" if apart else cell


def log_columns() -> str:
    """Return the columns of a log."""
    from auvbench.identification.columns import DESCRIBED

    names = [", ".join(f"`{name}`" for name in group) for group, _ in DESCRIBED]
    return _table(("columns", "what"), names, [[text for _, text in DESCRIBED]])


TABLES: dict[str, Callable[[], str]] = {
    "leaderboard": leaderboard,
    "waters": waters,
    "first_answers": first_answers,
    "vehicles": vehicles,
    "robust": robust,
    "sensors": sensors,
    "sensors_waypoints": sensors_waypoints,
    "sensors_trajectories": sensors_trajectories,
    "sensors_docks": sensors_docks,
    "sensors_worth": sensors_worth,
    "sensors_transit": sensors_transit,
    "transit_ends": transit_ends,
    "transit_worth": transit_worth,
    "transfer": transfer,
    "formation": formation,
    "transit": transit,
    "station": station,
    "suite": suite,
    "cases": cases,
    "currents": currents,
    "elsewhere": elsewhere,
    "log_columns": log_columns,
}
LANGUAGES = {".py": "python", ".toml": "toml", ".yaml": "yaml"}
EXAMPLE = "examples/auvbench-example"
PACKAGE = f"{EXAMPLE}/auvbench_example"
PAGES = {
    "README.md": ("first_answers",),
    "docs/index.md": ("first_answers",),
    "docs/results.md": ("leaderboard", "suite"),
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
    "docs/adding-a-disturbance.md": ("examples/auvbench-example/auvbench_example/surge.py",),
    "docs/adding-a-package.md": (f"{EXAMPLE}/auvbench_example/doppler.py", "examples/still.py"),
    "docs/adding-a-vehicle.md": ("examples/polyu.yaml",),
    "docs/identification.md": ("log_columns",),
    "results/leaderboard/README.md": ("vehicles",),
    "results/robust/README.md": ("robust",),
    "results/navigation/README.md": ("sensors", "sensors_waypoints"),
    "results/navigation-tasks/README.md": ("sensors_worth", "sensors_trajectories", "sensors_docks"),
    "results/navigation-transit/README.md": ("transit_worth", "sensors_transit", "transit_ends"),
    "results/transfer/README.md": ("transfer",),
    "results/formation/README.md": ("formation",),
    "results/transit/README.md": ("transit",),
    "results/station/README.md": ("station",),
    "results/suite/README.md": ("suite", "cases", "currents"),
    "results/tuning/README.md": ("elsewhere",),
    "results/waypoint-2026/README.md": ("waters",),
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


def _per_cent(share: float) -> str:
    """Return a share in per cent: one decimal that is not 0; just below 100 two."""
    value = 100.0 * share
    return f"{value:.{2 if 99.9 < value < 100.0 else 1}f}".removesuffix(".0")


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
    cells = [f"{_per_cent(value)}{NO_BREAK}%" for value in values]
    return [f"**{cell}**" if v == max(values) else cell for v, cell in zip(values, cells, strict=True)]


def _table(heads: Sequence[str], agents: Sequence[str], columns: list[list[str]]) -> str:
    rows = [heads, *zip(agents, *columns, strict=True)]
    first, *rest = ("| " + " | ".join(row) + " |" for row in rows)
    return "\n".join([first, "|---" * len(heads) + "|", *rest])


if __name__ == "__main__":
    for page_name in PAGES:
        (ROOT / page_name).write_text(page(page_name), encoding="utf-8")
        print(f"wrote {page_name}")
