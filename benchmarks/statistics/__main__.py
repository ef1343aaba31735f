"""Writes the measured tables into docs/statistics.md: `python -m benchmarks.statistics [--replications N] [NAME...]`."""

from __future__ import annotations

import argparse
import re
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np

from benchmarks.statistics import claims, letters
from benchmarks.statistics.alternatives import ALTERNATIVES
from benchmarks.statistics.coverage import METHODS, WORLDS, coverage
from benchmarks.statistics.worlds import World

PAGE = Path(__file__).parents[2] / "docs" / "statistics.md"


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
            rows.append((design.name, design.seeds, f"{100 * rate:.0f} %", *map(_percent, found.values())))
    return _table(("agents, all equal", "seeds", "rate", *ALTERNATIVES), rows)


def power(n: int) -> str:
    """By design, the differences over 20 points that are found (%)."""
    rows = []
    for design in letters.spread():
        names = tuple(x for x in ALTERNATIVES if x != "permutation" or design.seeds < 10)
        found = letters.power(design, n // 2, names)
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
    rows = [(name, *map(_percent, shares)) for name, shares in claims.one_seed(n).items()]
    return _table(("8 equal configurations, sd 0.5, rate 90 %", "as policies (before)", "used"), rows)


def best(n: int) -> str:
    """The bootstrap's probability of being best, and the rank interval."""
    head = ("sd", "seeds", '"> 99 %" is said', "and is right", "the best's rank interval begins at 1")
    return _table(head, [(sd, S, *map(_percent, shares)) for sd, S, *shares in claims.best(n)])


def equivalence(n: int) -> str:
    """Verdicts "equivalent" with a margin of 5 points (%)."""
    head = ("two agents", "seeds", "false: 5 points or more apart", "true: equal")
    return _table(head, [(name, S, *map(_percent, shares)) for name, S, *shares in claims.equivalence(n)])


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


def bootstraps(n: int) -> str:
    """The same of the hierarchical bootstraps, for rate and mean steps."""
    rows = []
    for sd in (0.5, 1.0):
        for S in (3, 5, 10):
            found = coverage(World(0.5, sd), S, 200, replications=n // 2, resamples=300)
            rows.append((sd, S, *(_percent(v) for method in METHODS for v in found[method][:2])))
    head = ("seeds differ by", "seeds", "used here: rate", "mean steps", "bootstrap: rate", "mean steps")
    return _table((*head, "rescaled bootstrap: rate", "mean steps"), rows)


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
    "bootstraps": bootstraps,
}


def replaced(page: str, name: str, table: str) -> str:
    """The page with the table between the markers of that name.

    Raises:
        ValueError: the page has no such markers.
    """
    start, end = f"<!-- measured: {name} -->", "<!-- end -->"
    pattern = re.compile(re.escape(start) + r".*?" + re.escape(end), flags=re.S)
    if not pattern.search(page):
        raise ValueError(f"docs/statistics.md has no {start}")
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
        PAGE.write_text(replaced(PAGE.read_text(encoding="utf-8"), name, table), encoding="utf-8")
        print(f"{name}: {time.perf_counter() - began:.0f} s\n{table}\n", flush=True)


if __name__ == "__main__":
    main()
