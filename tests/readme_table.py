"""Write the tables of README.md, docs/index.md and docs/results.md from the published leaderboard.

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
STUDY = ROOT / "results" / "leaderboard"
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


def leaderboard() -> str:
    """Return five rows: time to the waypoint with its interval, then success under each condition."""
    ranked = {row["agent"]: row for row in _rows("table.csv")}
    chosen = [ranked[agent] for agent in AGENTS]
    least = min(float(row["par1_time_s"]) for row in chosen)
    times = [_time(row, float(row["par1_time_s"]) == least) for row in chosen]
    still = _shares([float(row["success_rate"]) for row in chosen])
    columns = [times, still, *(_success(AGENTS, condition) for condition in CONDITIONS.values())]
    return _table(("500 waypoints", "mean time", "still water", *CONDITIONS), AGENTS, columns)


def vehicles() -> str:
    """Return the success of some agents on each vehicle of the transfer test."""
    columns = [_success(MORE_AGENTS, condition) for condition in VEHICLES.values()]
    return _table(("agent", *(f"`{name}`" for name in VEHICLES)), MORE_AGENTS, columns)


TABLES: dict[str, Callable[[], str]] = {"leaderboard": leaderboard, "vehicles": vehicles}
PAGES = {"README.md": "leaderboard", "docs/index.md": "leaderboard", "docs/results.md": "vehicles"}


def page(name: str) -> str:
    """Return a page with its table as it must be.

    Raises:
        ValueError: the page has not exactly one place for it.
    """
    table = PAGES[name]
    begin, end = (f"<!-- {word}: {table} -->" for word in ("begin", "end"))
    text, places = re.subn(
        f"{begin}.*?{end}",
        lambda match: f"{begin}\n{TABLES[table]()}\n{end}",
        (ROOT / name).read_text(encoding="utf-8"),
        flags=re.DOTALL,
    )
    if places != 1:
        raise ValueError(f"{name}: {places} places for the table, {begin} ... {end}")
    return text


def _rows(name: str) -> list[dict[str, str]]:
    with open(STUDY / name, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def _success(agents: Sequence[str], condition: str) -> list[str]:
    found = {
        r["agent"]: float(r["success_rate"]) for r in _rows("conditions.csv") if r["condition"] == condition
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
