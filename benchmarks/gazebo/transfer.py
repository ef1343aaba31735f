"""`make transfer`: what tests in the embedded simulator say of tests in Gazebo; the table of docs/gazebo.md.

`python -m benchmarks.gazebo.transfer FOLDER` reads what `auvbench evaluate FOLDER protocol=gazebo` wrote.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pandas as pd

from auvbench.statistics import mcnemar, quantile, wilson
from benchmarks.gazebo.parity import table, write

CONDITIONS = {
    "nominal": "embedded",
    "simulator=gazebo": "Gazebo, corrected",
    "simulator=gazebo-published": "Gazebo, as published",
}


def rows_of(file: Path) -> list[list[str]]:
    """A row for each simulator that one run was tested in."""
    episodes = pd.read_csv(file)
    name = file.parents[2].name
    by = {c: episodes[episodes.condition == c].set_index("episode").sort_index() for c in CONDITIONS}
    base = by["nominal"]
    won = (base.outcome == "success").to_numpy()
    rows = []
    for condition, label in CONDITIONS.items():
        there = by[condition]
        if not there.index.equals(base.index):
            raise SystemExit(f"{file}: {condition} has other scenarios than nominal")
        success = (there.outcome == "success").to_numpy()
        n, k = len(success), int(success.sum())
        low, high = (float(bound) for bound in wilson(k, n))
        row = [
            name if condition == "nominal" else "",
            label,
            f"{100 * k / n:.1f} % [{100 * low:.1f}, {100 * high:.1f}]",
        ]
        row.append(f"{there.steps[success].mean():.1f}" if k else "")
        if condition == "nominal":
            rows.append([*row, "", "", ""])
            continue
        lost, gained = int((won & ~success).sum()), int((~won & success).sum())
        p = float(mcnemar(lost, gained))
        both = won & success
        change = (there.steps.to_numpy() - base.steps.to_numpy())[both]
        rows.append([*row, f"{lost} / {gained}", f"{p:.2g}" if lost + gained else "", mean_interval(change)])
    return rows


def mean_interval(values: np.ndarray) -> str:
    """Mean and its 95 % interval by t."""
    n = len(values)
    if n < 2:
        return ""
    half = float(quantile(0.95, n - 1)) * float(values.std(ddof=1)) / np.sqrt(n)
    return f"{values.mean():+.2f} [{values.mean() - half:+.2f}, {values.mean() + half:+.2f}]"


def main() -> int:
    if len(sys.argv) != 2:
        print("usage: python -m benchmarks.gazebo.transfer FOLDER", file=sys.stderr)
        return 2
    files = sorted(Path(sys.argv[1]).glob("**/evaluations/gazebo/episodes.csv"))
    if not files:
        print(
            f"{sys.argv[1]}: no tests; auvbench evaluate {sys.argv[1]} protocol=gazebo makes them",
            file=sys.stderr,
        )
        return 2
    head = (
        "run",
        "tested in",
        "success",
        "steps of successes",
        "lost / gained",
        "McNemar mid-p",
        "steps, paired",
    )
    rows = [row for file in files for row in rows_of(file)]
    write({"transfer": table(head, rows, texts=2), "transfer-versions": versions(files)})
    return 0


def versions(files: list[Path]) -> str:
    """Of the programs with which the tests were made, as their summaries have them."""
    found: dict[str, set[str]] = {}
    for file in files:
        summary = json.loads(file.with_name("summary.json").read_text(encoding="utf-8"))
        for name, version in summary["versions"].items():
            found.setdefault(name, set()).add(version)
    return ", ".join(f"{name} {' and '.join(sorted(values))}" for name, values in sorted(found.items()))


if __name__ == "__main__":
    sys.exit(main())
