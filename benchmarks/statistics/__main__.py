"""Write the measured tables into the pages of docs/: `python -m benchmarks.statistics [--replications N] [NAME...]`."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np

from benchmarks.pages import replaced
from benchmarks.statistics import aggregates, letters, stopping, verdicts
from benchmarks.statistics import plans as planning
from benchmarks.statistics.coverage import WORLDS, coverage
from benchmarks.statistics.verdicts import Cell

DOCS = Path(__file__).parents[2] / "docs"


def _percent(value: float) -> str:
    return "" if np.isnan(value) else f"{100 * value:.1f}"


def _table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    lines = [head, ["---"] * len(head), *([str(cell) for cell in row] for row in rows)]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)


def _judged(rows: Iterable[tuple[str, Sequence[Cell], str]], head: Sequence[str]) -> str:
    """Return a table of measured shares (%); each line has its limit, and whether the share is within it."""
    lines = []
    for name, cells, limit in rows:
        within = ("yes" if all(cell.within for cell in cells) else "**no**") if limit else "–"
        lines.append((name, *(f"{cell.share:.1f}" for cell in cells), limit or "–", within))
    return _table((*head, "limit", "within"), lines)


def _by_rows(*rows: str) -> list[str]:
    """Return the columns' headings: the number of trainings, in tables of this many rows."""
    return [
        f"{name}{n}"
        for row in rows
        for name, n in zip((f"{row}: n = ", "", "", ""), verdicts.TRAININGS, strict=True)
    ]


def false_verdicts(n: int) -> str:
    """Tabulate the share of tables with any false ahead or behind (%), and of single rows' intervals that contain the true value."""
    rows = [
        (design.name, verdicts.false_verdicts(design, n, required), "5 (n = 5: 7)" if required else "")
        for designs, required in ((verdicts.DESIGNS, True), (verdicts.STRESS, False))
        for design in designs
    ]
    return _judged(rows, ("typical training = controller", *_by_rows("k = 5", "k = 12", "holds")))


def found(n: int) -> str:
    """Tabulate the share of better learners' rows whose verdict is right (%)."""
    rows = [
        (
            design.name,
            verdicts.power(design, n),
            "n = 10: 94 alone, 70 of 5" if design == verdicts.APART[0] else "",
        )
        for design in verdicts.APART
    ]
    return _judged(rows, ("learners", *_by_rows("alone", "k = 5", "k = 12")))


def equivalence(n: int) -> str:
    """Tabulate the share of tables with any false equivalent (%), and of equal learners' rows with the verdict equivalent."""
    rows = [(f"at the margin: {d.name}", verdicts.equivalent(d, n, 2.0), "2") for d in verdicts.AT_MARGIN]
    rows += [(f"equal: {d.name}", verdicts.equivalent(d, n), "") for d in verdicts.EQUAL]
    return _judged(rows, ("learners", *_by_rows("k = 5", "k = 12")))


def one_side(n: int) -> str:
    """Tabulate the share of open rows whose interval over trainings, without the scenarios' error, is on one side of the baseline (%)."""
    designs = (*verdicts.APART, verdicts.DESIGNS[1], verdicts.DESIGNS[-3])
    rows = [(design.name, verdicts.undecided(design, max(n // 5, 1)), "0") for design in designs]
    return _judged(rows, ("learners", *_by_rows("k = 5", "k = 12")))


def of_learners(n: int) -> str:
    """Tabulate the share of tables of five learners with any false difference from a baseline that learns (%)."""
    rows = []
    for first, second in verdicts.PAIRS:
        shares = verdicts.of_learners(first, second, n)
        cells = [Cell(share, 7.0 if 5 in pair else 5.0, trials=n) for pair, share in shares.items()]
        rows.append((f"{first.name} against {second.name}", cells, "5 (5 trainings: 7)"))
    return _judged(rows, ("learners", "5 v 5", "10 v 10", "20 v 20", "20 v 5"))


def false_letters(n: int) -> str:
    """Tabulate for each design the share of tables with any false difference among all pairs (%), the largest of the rates."""
    rows = []
    for place, design in enumerate(letters.equal(0.9, 5)):
        cells = []
        for S in letters.SEEDS:
            shares = [letters.false_letters(letters.equal(rate, S)[place], n) for rate in letters.RATES]
            cells.append(Cell(100 * max(shares), 7.0 if S == 5 else 5.0, trials=n))
        rows.append((design.name, cells, "5 (5 seeds: 7)"))
    return _judged(rows, ("agents, all equal", *(f"{S} seeds" for S in letters.SEEDS)))


def looks(n: int) -> str:
    """Tabulate the share of experiments in which some look finds a learner different from an equal controller (%)."""
    shares = stopping.found(n)
    return _table(("looks after", "found"), [(name, _percent(share)) for name, share in shares.items()])


def plans(n: int) -> str:
    """Tabulate the trainings that a plan names for 90 against 95 %, and their power in a comparison with a controller (%)."""
    rows = []
    for sd in planning.SDS:
        for (k, target), trainings in planning.planned(sd).items():
            if trainings is None:
                continue
            shares = [planning.power(sd, trainings, k, n, shape) for shape in ("normal", "skew")]
            cells = [Cell(shares[0], 100 * target - planning.SLACK, True, n), Cell(shares[1])]
            name = f"sd {sd:g}, {'alone' if k == 1 else f'table of {k + 1}'}, {100 * target:g} %: {trainings} trainings"
            rows.append((name, cells, f"{100 * target - planning.SLACK:g}"))
    return _judged(rows, ("promised", "measured", "skewed trainings"))


def intervals(n: int) -> str:
    """Tabulate the share of intervals of a mean rate that contain the true value (%)."""
    rows = []
    for name, world in WORLDS:
        held = [coverage(world, S, 200, replications=2 * n)[0] for S in (3, 5, 10)]
        rows.append((name, f"{100 * world.rate():.0f} %", *map(_percent, held)))
    return _table(("seeds differ by", "rate", "3 seeds", "5", "10"), rows)


def over_tasks(n: int) -> str:
    """Tabulate the share of intervals of interquartile means over conditions and vehicles that contain the true value (%)."""
    rows = []
    for name, (vehicles, conditions) in aggregates.DESIGNS.items():
        held = [aggregates.coverage(vehicles, conditions, S, n) for S in (3, 5, 10)]
        rows.append((name, *map(_percent, held)))
    return _table(("tasks", "3 seeds", "5 seeds", "10 seeds"), rows)


SECTIONS: dict[str, Callable[[int], str]] = {
    "false verdicts": false_verdicts,
    "power": found,
    "equivalence": equivalence,
    "one side": one_side,
    "learners": of_learners,
    "false letters": false_letters,
    "plans": plans,
    "intervals": intervals,
    "aggregates": over_tasks,
    "looks": looks,
}
PAGES = {"looks": "planning.md", "plans": "planning.md"}
"""pages of docs/ of sections that are not in statistics-appendix.md"""


def main(argv: Sequence[str] | None = None) -> int:
    """Measure and write each section; return 1 if a line is not within its limit."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.statistics", description=__doc__)
    parser.add_argument("--replications", type=int, default=500, help="tables or experiments per row")
    parser.add_argument("sections", nargs="*", metavar="NAME", help=", ".join(SECTIONS))
    options = parser.parse_args(argv)
    for name in options.sections:
        if name not in SECTIONS:
            parser.error(f"unknown section {name!r}; valid: {', '.join(SECTIONS)}")
    beyond: list[str] = []
    for name in options.sections or SECTIONS:
        began = time.perf_counter()
        table = SECTIONS[name](options.replications)
        page = DOCS / PAGES.get(name, "statistics-appendix.md")
        page.write_text(replaced(page.read_text(encoding="utf-8"), name, table), encoding="utf-8")
        print(f"{name}: {time.perf_counter() - began:.0f} s\n{table}\n", flush=True)
        beyond += [f"{name}: {line}" for line in table.splitlines() if line.endswith("| **no** |")]
    for line in beyond:
        print(f"not within its limit: {line}")
    return 1 if beyond else 0


if __name__ == "__main__":
    sys.exit(main())
