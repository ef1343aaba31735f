"""The table of `auvbench runs`: at any width, ids, states, steps, success and times are whole."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.text import Text

    from auvbench.scheduling.listing import Row

STYLES = {"running": "cyan", "interrupted": "yellow", "failed": "red", "complete": "green", "pending": "dim"}
NUMBERS = ("steps", "progress", "seed", "success", "wall time")
ALWAYS = ("run", "state", "steps", "success", "wall time")
WANTED = ("experiment", "progress", "seed")
"""shown where there is room, in this order; then the configuration, then remarks"""

GAP = 2  # characters between columns
SHORTEST_ID = 24  # characters of an id that is cut: its beginning and its hash
REMARK = 24  # characters, without which a remark says nothing


def show(rows: Sequence[Row], *, of: int, columns: Sequence[str] = ()) -> None:
    """Prints the table and a line of counts.

    Args:
        rows: the runs.
        of: how many there are without filters.
        columns: configuration keys that are shown at any width.
    """
    from rich.console import Console

    console = Console()
    # A file or a pipe has no width: nothing is to be cut there.
    width = console.width if console.is_terminal else 1000
    if rows:
        for line in lines(rows, columns, width):
            console.print(line, soft_wrap=True)
    counts: dict[str, int] = {}
    for row in rows:
        counts[row.state] = counts.get(row.state, 0) + 1
    shown = f"{of} run{'s' if of != 1 else ''}" if len(rows) == of else f"{len(rows)} of {of} runs"
    print(f"{shown}: " + (", ".join(f"{number} {state}" for state, number in counts.items()) or "none"))


def lines(rows: Sequence[Row], columns: Sequence[str], width: int) -> list[Text]:
    """The table's lines, none longer than `width` unless what must be shown is."""
    from rich.text import Text

    cells = _cells(rows, columns)
    sizes = {name: max(len(name), *(text.cell_len for text in column)) for name, column in cells.items()}
    shown = _fitting(cells, sizes, [_heading(key) for key in columns], width)
    room = width - sum(sizes[name] + GAP for name in shown if name != "run")
    if sizes["run"] > room:
        sizes["run"] = max(SHORTEST_ID, room)
        cells["run"] = [_cut(text, sizes["run"]) for text in cells["run"]]
    result = [Text((" " * GAP).join(_justified(name, name, sizes[name]) for name in shown), "bold")]
    for number in range(len(rows)):
        line = Text()
        for name in shown:
            text = cells[name][number]
            pad = " " * (sizes[name] - text.cell_len)
            line.append_text(Text(pad) + text if _right(name) else text + Text(pad))
            line.append(" " * GAP)
        line.rstrip()
        result.append(line)
    if "remark" in cells and "remark" not in shown:
        _append_remarks(result, cells["remark"], width)
    return result


def _cells(rows: Sequence[Row], columns: Sequence[str]) -> dict[str, list[Text]]:
    """Every column that could be shown."""
    from rich.text import Text

    from auvbench.runs.progress import telling
    from auvbench.runs.run_filter import text
    from auvbench.scheduling.estimate import duration
    from auvbench.scheduling.listing import varying

    def success(row: Row) -> str:
        rate = telling(row.success_rate, row.episodes)
        return "" if rate is None else f"{rate:.0%}"

    cells: dict[str, list[Text]] = {
        "experiment": [Text(row.name) for row in rows],
        "run": [Text(row.id) for row in rows],
        "state": [Text(row.state, STYLES[row.state]) for row in rows],
        "steps": [Text(f"{row.steps:,}" if row.steps else "") for row in rows],
        "progress": [Text(f"{row.progress:.0%}") for row in rows],
        "seed": [Text(str(row.seed)) for row in rows],
        "success": [Text(success(row)) for row in rows],
        "wall time": [Text(duration(row.wall_time_s) if row.wall_time_s else "") for row in rows],
    }
    for key in dict.fromkeys([*columns, *varying(rows)]):
        cells[_heading(key)] = [Text(text(row.config[key]) if key in row.config else "") for row in rows]
    remarks = [Text(row.error or (f"held by {row.holder}" if row.holder else "")) for row in rows]
    if any(remarks):
        cells["remark"] = remarks
    if len({row.name for row in rows}) == 1:
        del cells["experiment"]  # it would say the same in each line, and ids are long
    return cells


def _heading(key: str) -> str:
    return key.removesuffix(".name")


def _fitting(
    cells: dict[str, list[Text]], sizes: dict[str, int], asked: Sequence[str], width: int
) -> list[str]:
    """The columns there is room for, in the order of `cells`."""
    shown = {*ALWAYS, *asked}
    used = sum(sizes[name] + GAP for name in shown) - GAP
    rest = [name for name in cells if name not in (*ALWAYS, *WANTED, *asked, "remark")]
    for name in (*WANTED[:2], *rest, *WANTED[2:], "remark"):
        if name in cells and name not in shown and used + GAP + sizes[name] <= width:
            shown.add(name)
            used += GAP + sizes[name]
    return [name for name in cells if name in shown]


def _append_remarks(lines: list[Text], remarks: Sequence[Text], width: int) -> None:
    """As much of each as fits behind its line, or else below it."""
    from rich.text import Text

    widest = max(line.cell_len for line in lines)
    if width - widest - GAP >= REMARK:
        lines[0].append(" " * (widest + GAP - lines[0].cell_len) + "remark")
        for line, remark in zip(lines[1:], remarks, strict=True):
            if remark:
                line.append(" " * (widest + GAP - line.cell_len))
                line.append_text(_short(remark, width - widest - GAP))
        return
    for number in reversed(range(len(remarks))):
        if remarks[number]:
            below = Text("  ", "dim")
            below.append_text(_short(remarks[number], width - 2))
            lines.insert(number + 2, below)


def _short(text: Text, width: int) -> Text:
    short = text.copy()
    short.truncate(width, overflow="ellipsis")
    return short


def _cut(text: Text, width: int) -> Text:
    """In the middle: the beginning says what it is, the hash at the end which."""
    from rich.text import Text as Made

    whole = text.plain
    if len(whole) <= width:
        return text
    return Made(f"{whole[: width - 10]}…{whole[-9:]}", text.style)


def _right(name: str) -> bool:
    return name in NUMBERS


def _justified(text: str, name: str, width: int) -> str:
    return text.rjust(width) if _right(name) else text.ljust(width)
