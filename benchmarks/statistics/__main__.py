"""Writes the measured tables into the pages of docs/: `python -m benchmarks.statistics [--replications N] [NAME...]`."""

from __future__ import annotations

import argparse
import re
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np

from auvbench.analysis.measures import measure
from benchmarks.statistics import aggregates, letters, reports, stopping
from benchmarks.statistics.alternatives import ALTERNATIVES, USED
from benchmarks.statistics.coverage import WORLDS, coverage, of_pairs
from benchmarks.statistics.shipped import MEASURES, shipped, spread_of_trainings
from benchmarks.statistics.worlds import of_rate, shifted

DOCS = Path(__file__).parents[2] / "docs"
PAR1 = "par1_steps"
HARDEST = (1, 3, 4, 6, 8)
"""places in `letters.equal` of the designs by which the rules are compared"""
MAIN = "leaderboard, test, bluerov2"
"""the shipped table by which the rules are compared"""


def _percent(value: float) -> str:
    return "" if np.isnan(value) else f"{100 * value:.1f}"


def _table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    lines = [head, ["---"] * len(head), *([str(cell) for cell in row] for row in rows)]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)


def rules(n: int) -> str:
    """Compare the rules for the variance between seeds."""
    names = tuple(ALTERNATIVES)
    false = [
        (S, letters.false_letters(letters.equal(rate, S)[place], n // 2, names))
        for S in letters.SEEDS
        for rate in letters.RATES
        for place in HARDEST
    ]
    close = letters.power(letters.close(), 2 * n, names)
    far = [letters.power(design, n // 2, names) for design in letters.spread(12, 5)]
    table = next(table for table in shipped() if table.name == MAIN)
    rows = []
    for name, test in ALTERNATIVES.items():
        worst = [max(found[name] for S, found in false if (S > 3) == more) for more in (False, True)]
        shares = (*worst, close[name], float(np.mean([found[name] for found in far])))
        rows.append((name, *map(_percent, shares), *table.lost(measure(PAR1), test)))
    head = ("variance of a training", "false, 3 seeds", "false, 5 or 10", "90 against 95 %")
    return _table((*head, "20 points, 5 seeds", "leaderboard", "lost"), rows)


def false_letters(n: int) -> str:
    """By design, the tables with a false letter (%), the highest of the rates."""
    names = [design.name for design in letters.equal(0.9, 3)]
    rows = []
    for prefix, steps, places in (("", False, range(len(names))), ("PAR-1: ", True, (0, 1, len(names) - 1))):
        for place in places:
            shares = [
                max(
                    letters.false_letters(letters.equal(rate, S)[place], n, steps=steps)[USED]
                    for rate in letters.RATES
                )
                for S in letters.SEEDS
            ]
            rows.append((prefix + names[place], *map(_percent, shares)))
    return _table(("agents, all equal", "3 seeds", "5 seeds", "10 seeds"), rows)


def failing(n: int) -> str:
    """False letters (%) where a share of all trainings fails."""
    rows = []
    for share in (0.05, 0.1):
        columns = [
            [letters.false_letters(design, n)[USED] for design in letters.failing(0.98, share, S)]
            for S in letters.SEEDS
        ]
        for design, *shares in zip(letters.failing(0.98, share, 3), *columns, strict=True):
            rows.append((f"{100 * share:.0f} % fail, {design.name}", *map(_percent, shares)))
    return _table(("trainings", "3 seeds", "5 seeds", "10 seeds"), rows)


def power(n: int) -> str:
    """By design, the differences over 20 points that are found (%)."""
    rows = []
    for agents in (6, 12):
        columns = [
            [letters.power(design, n // 2)[USED] for design in letters.spread(agents, S)]
            for S in letters.SEEDS
        ]
        for design, *shares in zip(letters.spread(agents, 3), *columns, strict=True):
            rows.append((f"{agents} agents, {design.name}", *map(_percent, shares)))
    close = [letters.power(letters.close(S), 2 * n)[USED] for S in letters.SEEDS]
    return _table(
        ("agents", "3 seeds", "5 seeds", "10 seeds"), [*rows, ("90 against 95 %", *map(_percent, close))]
    )


def prior(n: int) -> str:
    """How trainings of one configuration differ, over all shipped studies."""
    del n  # nothing is simulated
    rows = []
    for name in MEASURES:
        ratio, df, agents = spread_of_trainings(name)
        rows.append((name, agents, f"{ratio:.2f}", f"{df:.1f}"))
    return _table(("measure", "agents", "ratio", "degrees of freedom"), rows)


def baseline(n: int) -> str:
    """Verdicts against a baseline (%), in tables of five learners and a controller."""
    rows = []
    for sd in (0.3, 1.0):
        same, fixed = of_rate(0.95, sd), of_rate(0.95, 0.0)
        for S in (5, 10):
            alike = reports.against_baseline([fixed, *[same] * 5], S, n // 2)
            apart = reports.against_baseline([fixed, *[shifted(same, 0.05)] * 5], S, n // 2)
            shares = alike["ahead"] + alike["behind"], apart["equivalent"], alike["equivalent"]
            rows.append((f"sd {sd:g}, {S} seeds", *map(_percent, shares)))
    return _table(("95 %, margin 5 points", "false ahead or behind", "false equivalent", "equivalent"), rows)


def looks(n: int) -> str:
    """Experiments with two equal agents in which a difference is found at some look (%)."""
    found = stopping.found(n)
    return _table(("looks after", "found"), [(name, _percent(share)) for name, share in found.items()])


def intervals(n: int) -> str:
    """Intervals of a rate, and of a difference of rates, that hold the truth (%)."""
    rows = []
    for name, world in WORLDS:
        found = [coverage(world, S, 200, replications=2 * n) for S in letters.SEEDS]
        rate = f"{100 * world.rate():.0f} %"
        rows.append((name, rate, *(_percent(x[0]) for x in found), *(_percent(x[2]) for x in found)))
    head = ("seeds differ by", "rate", "3 seeds", "5", "10", "difference: 3", "5", "10")
    return _table(head, rows)


def pair_intervals(n: int) -> str:
    """Intervals of differences of rates in tables of several agents that hold (%), the lowest of the rates."""
    rows = []
    for place in (0, 3, 5):
        shares = [
            min(of_pairs(letters.equal(rate, S)[place], n // 5) for rate in letters.RATES)
            for S in letters.SEEDS
        ]
        rows.append((letters.equal(0.9, 3)[place].name, *map(_percent, shares)))
    return _table(("agents", "3 seeds", "5 seeds", "10 seeds"), rows)


def over_tasks(n: int) -> str:
    """Intervals of interquartile means over conditions and vehicles that hold the truth (%)."""
    rows = []
    for name, (vehicles, conditions) in aggregates.DESIGNS.items():
        found = [aggregates.coverage(vehicles, conditions, S, n) for S in letters.SEEDS]
        rows.append((name, *map(_percent, found)))
    return _table(("tasks", "3 seeds", "5 seeds", "10 seeds"), rows)


SECTIONS: dict[str, Callable[[int], str]] = {
    "rules": rules,
    "false letters": false_letters,
    "failing": failing,
    "power": power,
    "prior": prior,
    "baseline": baseline,
    "intervals": intervals,
    "pair intervals": pair_intervals,
    "aggregates": over_tasks,
    "looks": looks,
}
PAGES = {"looks": "planning.md"}
"""of docs/, where it is not statistics-appendix.md"""


def replaced(page: str, name: str, table: str) -> str:
    """The page with the table between the markers of that name.

    Raises:
        ValueError: the page has no such markers.
    """
    start, end = f"<!-- measured: {name} -->", "<!-- end -->"
    pattern = re.compile(re.escape(start) + r".*?" + re.escape(end), flags=re.S)
    if not pattern.search(page):
        raise ValueError(f"no {start}")
    return pattern.sub(lambda _: f"{start}\n{table}\n{end}", page, count=1)


def main(argv: Sequence[str] | None = None) -> None:
    """Measure and write, section by section."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.statistics", description=__doc__)
    parser.add_argument("--replications", type=int, default=500, help="tables or experiments per row")
    parser.add_argument("sections", nargs="*", metavar="NAME", help=", ".join(SECTIONS))
    options = parser.parse_args(argv)
    for name in options.sections:
        if name not in SECTIONS:
            parser.error(f"unknown section {name!r}; valid: {', '.join(SECTIONS)}")
    for name in options.sections or SECTIONS:
        began = time.perf_counter()
        table = SECTIONS[name](options.replications)
        page = DOCS / PAGES.get(name, "statistics-appendix.md")
        page.write_text(replaced(page.read_text(encoding="utf-8"), name, table), encoding="utf-8")
        print(f"{name}: {time.perf_counter() - began:.0f} s\n{table}\n", flush=True)


if __name__ == "__main__":
    main()
