"""The rows of the live table of a sweep, at any width of the terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rich.text import Text

from auvbench.runs.progress import telling
from auvbench.scheduling import progress
from auvbench.scheduling.base import Phase
from auvbench.scheduling.estimate import duration
from auvbench.scheduling.loop import Outcome
from auvbench.scheduling.rows import Row

BAR = 20  # characters, the most of a bar
SHORTEST_BAR = 8
SHORTEST_NAME = 22  # characters of a run's id that is cut in the middle

STYLES = {
    "running": "cyan",
    "queued": "yellow",
    Outcome.COMPLETE: "green",
    Outcome.FAILED: "red",
    Outcome.INTERRUPTED: "yellow",
    Outcome.HELD: "magenta",
    Outcome.NOT_STARTED: "dim",
}

HEADINGS = ("run", "state", "progress", "steps", "steps/s", "success", "to go")
GAP = 2  # characters between columns


def lines(rows: Sequence[Row], left: Mapping[str, float | None], width: int) -> list[Text]:
    """The rows as lines of at most `width` characters: steps, success and time are whole, what else there is fits.

    Args:
        rows: in their order.
        left: seconds to go by the run's name.
        width: of the terminal.
    """
    cells = [_cells(row, left[row.name]) for row in rows]
    sizes = {
        name: max(len(name), *(len(line[name]) for line in cells)) if cells else len(name)
        for name in HEADINGS
    }
    sizes["run"] = max([len(row.name) for row in rows], default=3)
    shown = [name for name in HEADINGS if name not in ("progress", "steps/s")]
    room = width - sum(sizes[name] + GAP for name in shown) + GAP
    for name, least in (("steps/s", sizes["steps/s"]), ("progress", SHORTEST_BAR)):
        if room >= least + GAP or sizes["run"] + room - least - GAP >= SHORTEST_NAME:
            shown.append(name)
            sizes[name] = min(max(least, room - GAP), BAR) if name == "progress" else least
            room -= sizes[name] + GAP
    if room < 0:
        sizes["run"] = max(SHORTEST_NAME, sizes["run"] + room)
    shown.sort(key=HEADINGS.index)
    result = [Text(_joined({name: name for name in HEADINGS}, shown, sizes), "bold")]
    for row, line in zip(rows, cells, strict=True):
        name = row.name
        if len(name) > sizes["run"]:  # the beginning says what it is, the hash at its end which
            name = f"{name[: sizes['run'] - 10]}…{name[-9:]}"
        bar = _bar(row, sizes["progress"]) if row.progress is not None else ""
        text = Text(_joined({**line, "run": name, "progress": bar}, shown, sizes))
        start = sizes["run"] + GAP
        text.stylize(STYLES.get(row.state, "dim"), start, start + len(line["state"]))
        result.append(text)
    return result


def _joined(cells: Mapping[str, str], shown: Sequence[str], sizes: Mapping[str, int]) -> str:
    left = ("run", "state", "progress")
    words = [
        cells[name].ljust(sizes[name]) if name in left else cells[name].rjust(sizes[name]) for name in shown
    ]
    return (" " * GAP).join(words).rstrip()


def _bar(row: Row, size: int) -> str:
    full = 0 if row.progress is None else round(size * progress.fraction(row.progress))
    return "━" * full + "╌" * (size - full)


def _cells(row: Row, left: float | None) -> dict[str, str]:
    at = row.progress
    steps = row.steps if at is None else at.steps
    rate = None if at is None else telling(at.success_rate, at.episodes)
    return {
        "run": "",
        "state": str(row.state),
        "progress": "",
        "steps": f"{steps:,}" if steps or at is not None else "",
        "steps/s": f"{at.steps_per_s:,.0f}" if at is not None and at.steps_per_s else "",
        "success": "" if rate is None else f"{rate:.0%}",
        "to go": duration(left) if left and row.state == Phase.RUNNING else "",
    }
