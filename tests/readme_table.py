"""Write the tables of README.md, docs/index.md and docs/results.md from the published studies.

`python -m tests.readme_table` in the root of the repository. The best value of each column is bold.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Sequence
from pathlib import Path

NO_BREAK = "\u00a0"
"""a space at which narrow screens do not break a cell"""
ROOT = Path(__file__).parents[1]
LEADERBOARD, ROBUST, SUITE = (ROOT / "results" / name for name in ("leaderboard", "robust", "suite"))
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
    return _table(("500 waypoints", "mean time", "still water", *CONDITIONS), AGENTS, columns)


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


def suite() -> str:
    """Return the score of each agent across tasks with its interval, and on each task."""
    rows = [row for row in _rows(SUITE, "score.csv") if row["protocol"] == "test" and row["score"]]
    tasks = [name for name in rows[0] if name.startswith("score: ")]
    across = [
        f"{float(r['score']):.2f}"
        + (f" [{float(r['score_low']):.2f},{NO_BREAK}{float(r['score_high']):.2f}]" if r["score_low"] else "")
        for r in rows
    ]
    columns = [across, *([f"{float(r[name]):.2f}" for r in rows] for name in tasks)]
    heads = ("agent", "all tasks", *(name.removeprefix("score: ") for name in tasks))
    return _table(heads, [r["agent"] for r in rows], columns)


TABLES: dict[str, Callable[[], str]] = {
    "leaderboard": leaderboard,
    "vehicles": vehicles,
    "robust": robust,
    "suite": suite,
}
PAGES = {
    "README.md": ("leaderboard",),
    "docs/index.md": ("leaderboard",),
    "docs/results.md": ("vehicles", "robust", "suite"),
}


def page(name: str) -> str:
    """Return a page with its tables as they must be.

    Raises:
        ValueError: the page has not exactly one place for each.
    """
    text = (ROOT / name).read_text(encoding="utf-8")
    for table in PAGES[name]:
        begin, end = (f"<!-- {word}: {table} -->" for word in ("begin", "end"))
        made = f"{begin}\n{TABLES[table]()}\n{end}"
        text, places = re.subn(f"{begin}.*?{end}", lambda _, made=made: made, text, flags=re.DOTALL)
        if places != 1:
            raise ValueError(f"{name}: {places} places for the table, {begin} ... {end}")
    return text


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
    return [
        f"**{100 * v:.3g}{NO_BREAK}%**" if v == max(values) else f"{100 * v:.3g}{NO_BREAK}%" for v in values
    ]


def _table(heads: Sequence[str], agents: Sequence[str], columns: list[list[str]]) -> str:
    rows = [heads, *zip(agents, *columns, strict=True)]
    first, *rest = ("| " + " | ".join(row) + " |" for row in rows)
    return "\n".join([first, "|---" * len(heads) + "|", *rest])


if __name__ == "__main__":
    for page_name in PAGES:
        (ROOT / page_name).write_text(page(page_name), encoding="utf-8")
        print(f"wrote {page_name}")
