"""Measure how far Gazebo's motions are from the embedded simulator's, for the tables of docs/parity.md (`make parity`).

Run `python -m benchmarks.gazebo.parity` in the root of the repository; `--print` prints instead of changing the page.
`--plugin gz-sim-8.11` computes only that release's table; Gazebo must find its Hydrodynamics plugin.
"""

from __future__ import annotations

import platform
import sys
from collections.abc import Sequence
from pathlib import Path as File

import numpy as np

from auvbench.dynamics.rigid_body import GZ_SIM_8_11, GZ_SIM_8_12
from auvbench.integrations.gazebo import bindings
from auvbench.runs.provenance import versions
from benchmarks.gazebo.cases import (
    Case,
    Path,
    embedded,
    gazebo,
    mixed,
    verification,
    with_the_plugins_current,
)

PAGE = File(__file__).parents[2] / "docs" / "parity.md"
STEPS = (0.01, 0.005, 0.001, 0.0005)
DEFAULT = 0.001
"""s: Gazebo's default physics step"""


def apart(path: Path, reference: Path) -> float:
    """Return the largest distance between two motions in per cent of the distance travelled."""
    distance = np.linalg.norm(path.pose[:, :3] - reference.pose[:, :3], axis=1)
    return 100.0 * float(distance.max()) / max(float(reference.travelled[-1]), 1e-9)


def turned(path: Path, reference: Path) -> float:
    """Return the largest angle between the attitudes of two motions, in degrees."""
    dot = np.abs(np.sum(path.pose[:, 3:] * reference.pose[:, 3:], axis=1))
    return float(np.degrees(2.0 * np.arccos(np.clip(dot, 0.0, 1.0))).max())


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table in Markdown whose first column is text; the others are numbers."""
    lines = [f"| {' | '.join(head)} |", f"|---|{'---:|' * (len(head) - 1)}"]
    return "\n".join([*lines, *(f"| {' | '.join(row)} |" for row in rows)])


def figure(value: float) -> str:
    """Return a number with three significant digits; below a nanometre, 0."""
    return "0" if abs(value) < 1e-9 else f"{value:.3g}"


def share(path: Path, reference: Path) -> str:
    return f"{apart(path, reference):.3g} %"


def row_of(case: Case, reference: Path, *numbers: str) -> list[str]:
    print(f"{case.vehicle}: {case.name}", file=sys.stderr, flush=True)
    return [f"{case.vehicle}: {case.name}", figure(float(reference.travelled[-1])), *numbers]


def steps_table(cases: Sequence[Case]) -> str:
    """Return rows that compare the corrected hydrodynamics, for several physics steps."""
    rows = []
    for case in cases:
        reference = embedded(case)
        paths = {step: gazebo(case, "corrected", step) for step in STEPS}
        shares = [share(path, reference) for path in paths.values()]
        rows.append(row_of(case, reference, *shares, figure(turned(paths[DEFAULT], reference))))
    steps = [f"{1000 * step:g} ms" for step in STEPS]
    return table(("motion", "way, m", *steps, f"attitude at {1000 * DEFAULT:g} ms, deg"), rows)


def signs_table(cases: Sequence[Case], plugin: str = GZ_SIM_8_12) -> str:
    """Return rows that compare the published hydrodynamics with Fossen's equations and with the plugin's Coriolis term."""
    rows = []
    for case in cases:
        right, wrong = embedded(case), embedded(case, plugin=plugin)
        path = gazebo(case, "published", DEFAULT)
        rows.append(row_of(case, right, share(path, right), share(path, wrong)))
    term = "the sign turned" if plugin == GZ_SIM_8_12 else "the plugin's term"
    return table(("motion", "way, m", "from the equations", f"from them with {term}"), rows)


def current_table(cases: Sequence[Case]) -> str:
    """Return rows that compare a current of `simulator=gazebo` with the plugin's current, both with `<fluid_added_mass>`."""
    rows = []
    for case in cases:
        reference = embedded(case)
        paths = (gazebo(case, "corrected", DEFAULT), with_the_plugins_current(case, DEFAULT))
        rows.append(row_of(case, reference, *(share(path, reference) for path in paths)))
    return table(("motion", "way, m", "simulator=gazebo", "plugin alone"), rows)


def environment() -> str:
    found = bindings.used() | {name: versions()[name] for name in ("python", "numpy")}
    return ", ".join(f"{name} {found[name]}" for name in sorted(found)) + f"; {platform.machine()}"


def write(sections: dict[str, str]) -> None:
    """Return the page with each section between its markers."""
    text = PAGE.read_text(encoding="utf-8")
    for name, body in sections.items():
        begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
        if begin not in text or end not in text:
            raise SystemExit(f"{PAGE}: the marks of {name} are missing")
        before, rest = text.split(begin)
        text = f"{before}{begin}\n{body}\n{end}{rest.split(end)[1]}"
    PAGE.write_text(text, encoding="utf-8")


def main() -> int:
    absent = bindings.missing()
    if absent is not None:
        print(f"make parity: {absent}", file=sys.stderr)
        return 2
    checked, moving = verification(), mixed()
    if "--plugin" in sys.argv[1:]:
        if sys.argv[sys.argv.index("--plugin") + 1 :][:1] != [GZ_SIM_8_11]:
            print(f"make parity: --plugin must be {GZ_SIM_8_11}, the release that differs", file=sys.stderr)
            return 2
        return finish({"parity-8.11": signs_table(moving, GZ_SIM_8_11)})
    sections = {
        "parity-steps": steps_table([*checked, *moving[:7]]),
        "parity-published": signs_table(moving),
        "parity-current": current_table([case for case in moving if any(case.current)]),
    }
    sections["parity-versions"] = environment()
    return finish(sections)


def finish(sections: dict[str, str]) -> int:
    """Write the sections into the page, or print them."""
    if "--print" in sys.argv[1:]:
        print("\n\n".join(sections.values()))
    else:
        write(sections)
        print(f"written: {PAGE}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
