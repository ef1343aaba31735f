"""Writes the measured tables into the pages of docs/: `python -m benchmarks.statistics [--replications N] [NAME...]`."""

from __future__ import annotations

import argparse
import re
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np

from benchmarks.statistics import aggregates, letters, reports, stopping
from benchmarks.statistics.alternatives import ALTERNATIVES
from benchmarks.statistics.claims import VERDICTS
from benchmarks.statistics.claims import WORLDS as STUDIES
from benchmarks.statistics.claims import shares as verdicts
from benchmarks.statistics.coverage import METHODS, WORLDS, coverage, of_pairs
from benchmarks.statistics.worlds import World

DOCS = Path(__file__).parents[2] / "docs"
SEEDS = {5: 1.0, 10: 0.5}
"""training seeds a cell of the simulated studies, and the share of the studies that such large ones get"""
WITH_TEN = ("1", "2")
"""the claims whose studies are simulated with ten seeds, too: their tests are exact, and say little with five"""


def _percent(value: float) -> str:
    return "" if np.isnan(value) else f"{100 * value:.1f}"


def _table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    lines = [head, ["---"] * len(head), *([str(cell) for cell in row] for row in rows)]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)


def false_letters(n: int) -> str:
    """By design and rate, the tables with a false letter (%)."""
    rows = []
    for rate in letters.RATES:
        for design in letters.equal(rate):
            found = letters.false_letters(design, n)
            shown = (_percent(found.get(x, np.nan)) for x in ALTERNATIVES)
            rows.append((design.name, design.seeds, f"{100 * rate:.0f} %", *shown))
    return _table(("agents, all equal", "seeds", "rate", *ALTERNATIVES), rows)


def power(n: int) -> str:
    """By design, the differences over 20 points that are found (%)."""
    rows = []
    for design in letters.spread():
        found = letters.power(design, n)
        rows.append((design.name, design.seeds, *(_percent(found.get(x, np.nan)) for x in ALTERNATIVES)))
    return _table(("rates 40 to 97 %", "seeds", *ALTERNATIVES), rows)


def steps(n: int) -> str:
    """False letters of PAR-1 of the steps (%), where all agents are of one world."""
    designs = [d for rate in letters.RATES for d in letters.equal(rate) if len(set(d.worlds)) == 1]
    found = [letters.false_letters_of_steps(design, n) for design in designs]
    rates = [
        f"{100 * rate:.0f} %" for rate in letters.RATES for _ in range(len(designs) // len(letters.RATES))
    ]
    rows = [
        (d.name, d.seeds, rate, *map(_percent, f.values()))
        for d, rate, f in zip(designs, rates, found, strict=True)
    ]
    return _table(("agents, all equal", "seeds", "rate", "own variances", "used"), rows)


def one_seed(n: int) -> str:
    """Tables of equal configurations with a false letter (%)."""
    rows = [(name, *map(_percent, shares)) for name, shares in reports.one_seed(n).items()]
    return _table(("8 equal configurations, sd 0.5, rate 90 %", "as policies (before)", "used"), rows)


def looks(n: int) -> str:
    """Experiments with two equal agents in which a difference is found at some look (%)."""
    found = stopping.found(n)
    return _table(("looks after", "found"), [(name, _percent(share)) for name, share in found.items()])


def best(n: int) -> str:
    """The bootstrap's probability of being best, and the rank interval."""
    head = ("sd", "seeds", '"> 99 %" is said', "and is right", "the best's rank interval begins at 1")
    return _table(head, [(sd, S, *map(_percent, shares)) for sd, S, *shares in reports.best(n)])


def equivalence(n: int) -> str:
    """Verdicts "equivalent" with a margin of 5 points (%)."""
    head = ("two agents", "seeds", "false: 5 points or more apart", "true: equal")
    return _table(head, [(name, S, *map(_percent, shares)) for name, S, *shares in reports.equivalence(n)])


def intervals(n: int) -> str:
    """Intervals that hold the truth (%)."""
    rows = []
    for name, world in WORLDS:
        # One seed: only where seeds do not differ is there something that its interval promises to hold.
        for S in (1, 2, 3, 5, 10) if world.seed_sd == 0 else (2, 3, 5, 10):
            used = coverage(world, S, 200, replications=2 * n, resamples=0)[METHODS[0]]
            rows.append((name, f"{100 * _rate(world):.0f} %", S, *map(_percent, used)))
    head = ("seeds differ by", "true rate", "seeds", "rate", "mean steps", "difference of rates", "of steps")
    return _table(head, rows)


def pair_intervals(n: int) -> str:
    """Intervals of differences of rates in tables of several agents: how many hold (%), and their width in points."""
    few = [(f"{100 * rate:.0f} %", d) for rate in letters.RATES for d in letters.equal(rate) if d.seeds < 10]
    apart = [("", d) for d in letters.spread() if d.seeds < 10 and len(d.worlds) < 12]
    rows = []
    for rate, design in (*few, *apart):
        found = of_pairs(design, n // 2).values()
        rows.append((design.name, design.seeds, rate, *(_percent(x) for both in found for x in both)))
    head = ("agents", "seeds", "rate", "own variances", "width", "used", "width")
    return _table(head, rows)


def bootstraps(n: int) -> str:
    """The same of the hierarchical bootstraps, for rate and mean steps."""
    rows = []
    for sd in (0.5, 1.0):
        for S in (3, 5, 10):
            found = coverage(World(0.5, sd), S, 200, replications=n, resamples=300)
            rows.append((sd, S, *(_percent(v) for method in METHODS for v in found[method][:2])))
    head = ("seeds differ by", "seeds", "used here: rate", "mean steps", "bootstrap: rate", "mean steps")
    return _table((*head, "rescaled bootstrap: rate", "mean steps"), rows)


def over_tasks(n: int) -> str:
    """Intervals of aggregates over conditions and vehicles that hold the truth (%)."""
    rows = []
    for name, (vehicles, conditions) in aggregates.DESIGNS.items():
        for S in (3, 5, 10):
            found = aggregates.coverage(vehicles, conditions, S, n).values()
            rows.append((name, S, *(_percent(x) for both in found for x in both)))
    head = ("tasks", "seeds", "IQM (used)", "IQM, score by score", "gap (used)", "gap, score by score")
    return _table(head, rows)


def claims(n: int) -> str:
    """By claim and world, the verdicts (%) of simulated studies."""
    rows: list[tuple[str, Sequence[object]]] = []
    for world in STUDIES:
        for S, share in SEEDS.items():
            if min(SEEDS) < S and not set(world.wrong) & set(WITH_TEN):
                continue
            for asked, found in verdicts(world, S, round(share * n)).items():
                wrong = world.wrong[asked]
                told = [f"{100 * found[v]:.1f}{' (wrong)' if v in wrong else ''}" for v in VERDICTS]
                rows.append((asked, (asked, world.truth, S, *told)))
    # A part before the whole claim; of each, world by world.
    ordered = sorted(rows, key=lambda row: (row[0][0], len(row[0]) == 1, row[0]))
    return _table(("claim", "what is true", "seeds a cell", *VERDICTS), [cells for _, cells in ordered])


def _rate(world: World) -> float:
    return world.truth()[0]


SECTIONS: dict[str, Callable[[int], str]] = {
    "false letters": false_letters,
    "power": power,
    "steps": steps,
    "one seed": one_seed,
    "best": best,
    "equivalence": equivalence,
    "intervals": intervals,
    "pair intervals": pair_intervals,
    "bootstraps": bootstraps,
    "aggregates": over_tasks,
    "looks": looks,
    "claims": claims,
}
PAGES = {"looks": "planning.md", "claims": "claims-measured.md"}
"""of docs/, where it is not statistics.md"""


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
    parser.add_argument("--studies", type=int, default=500, help="simulated studies per row of the claims")
    parser.add_argument("sections", nargs="*", metavar="NAME", help=", ".join(SECTIONS))
    options = parser.parse_args(argv)
    for name in options.sections:
        if name not in SECTIONS:
            parser.error(f"unknown section {name!r}; valid: {', '.join(SECTIONS)}")
    for name in options.sections or SECTIONS:
        began = time.perf_counter()
        table = SECTIONS[name](options.studies if name == "claims" else options.replications)
        page = DOCS / PAGES.get(name, "statistics.md")
        page.write_text(replaced(page.read_text(encoding="utf-8"), name, table), encoding="utf-8")
        print(f"{name}: {time.perf_counter() - began:.0f} s\n{table}\n", flush=True)


if __name__ == "__main__":
    main()
