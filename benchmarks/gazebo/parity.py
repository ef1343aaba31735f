"""`make parity`: how far Gazebo's vehicle parts from the embedded simulator's, and why; the tables of docs/gazebo.md.

`python -m benchmarks.gazebo.parity` in the root of the repository; `--print` leaves the page alone. `--plugin gz-sim-8.11` says that
the Hydrodynamics plugin which Gazebo finds is that of an earlier release, and makes the table of that release alone.
"""

from __future__ import annotations

import platform
import sys
from collections.abc import Callable, Sequence
from pathlib import Path as File

import numpy as np

from auvbench.dynamics.plugin import GZ_SIM_8_11, GZ_SIM_8_12
from auvbench.runs.provenance import versions
from auvbench.simulators.gazebo import bindings
from benchmarks.gazebo.cases import (
    Case,
    Path,
    embedded,
    gazebo,
    mixed,
    verification,
    with_the_plugins_current,
)

PAGE = File(__file__).parents[2] / "docs" / "gazebo.md"
STEPS = (0.01, 0.005, 0.002, 0.001, 0.0005)
DEFAULT = 0.001
"""s: Gazebo's default physics step"""


def apart(path: Path, reference: Path) -> tuple[float, float, float]:
    """Largest distance (m), the same in per cent of the way travelled, largest difference of speed (m/s)."""
    distance = np.linalg.norm(path.pose[:, :3] - reference.pose[:, :3], axis=1)
    speed = np.linalg.norm(path.velocity[:, :3] - reference.velocity[:, :3], axis=1)
    way = max(float(reference.travelled[-1]), 1e-9)
    return float(distance.max()), 100.0 * float(distance.max()) / way, float(speed.max())


def turned(path: Path, reference: Path) -> float:
    """Largest angle in degrees between the two attitudes."""
    dot = np.abs(np.sum(path.pose[:, 3:] * reference.pose[:, 3:], axis=1))
    return float(np.degrees(2.0 * np.arccos(np.clip(dot, 0.0, 1.0))).max())


def at(path: Path, reference: Path, time: float) -> float:
    """Distance in m at a time in s."""
    k = int(np.argmin(np.abs(reference.time - time)))
    return float(np.linalg.norm(path.pose[k, :3] - reference.pose[k, :3]))


def table(head: Sequence[str], rows: Sequence[Sequence[str]], texts: int = 1) -> str:
    """A table in Markdown whose first `texts` columns are words and the others numbers."""
    lines = [f"| {' | '.join(head)} |", f"|{'---|' * texts}{'---:|' * (len(head) - texts)}"]
    return "\n".join([*lines, *(f"| {' | '.join(row)} |" for row in rows)])


def figure(value: float) -> str:
    """Three significant digits, and no more places than a nanometre has."""
    return "0" if abs(value) < 1e-9 else f"{value:.3g}"


def cases_table(cases: Sequence[Case], hydrodynamics: str, compute: Callable[[str], None]) -> str:
    rows = []
    for case in cases:
        compute(f"{case.vehicle}: {case.name}, {hydrodynamics}")
        reference = embedded(case)
        path = gazebo(case, hydrodynamics, DEFAULT)
        metres, share, speed = apart(path, reference)
        rows.append(
            [
                f"{case.vehicle}: {case.name}",
                f"{case.duration:g}",
                figure(reference.travelled[-1]),
                figure(at(path, reference, 5.0)),
                figure(at(path, reference, 10.0)),
                figure(metres),
                f"{share:.3g} %",
                figure(speed),
                figure(turned(path, reference)),
            ]
        )
    head = (
        "motion",
        "s",
        "way, m",
        "at 5 s, m",
        "at 10 s, m",
        "largest, m",
        "of the way",
        "speed, m/s",
        "attitude, deg",
    )
    return table(head, rows)


def steps_table(cases: Sequence[Case], compute: Callable[[str], None]) -> str:
    """Largest distance over the way travelled, in per cent, by physics step."""
    rows = []
    for case in cases:
        reference = embedded(case)
        row = [f"{case.vehicle}: {case.name}"]
        for step in STEPS:
            compute(f"{case.vehicle}: {case.name}, step {step:g} s")
            row.append(f"{apart(gazebo(case, 'corrected', step), reference)[1]:.3g} %")
        rows.append(row)
    return table(("motion", *(f"{1000 * step:g} ms" for step in STEPS)), rows)


def signs_table(cases: Sequence[Case], compute: Callable[[str], None], plugin: str = GZ_SIM_8_12) -> str:
    """The published hydrodynamics against the embedded equations, and against them with the plugin's Coriolis term."""
    rows = []
    for case in cases:
        compute(f"{case.vehicle}: {case.name}, published and the term of {plugin}")
        right, wrong = embedded(case), embedded(case, plugin=plugin)
        path = gazebo(case, "published", DEFAULT)
        rows.append(
            [
                f"{case.vehicle}: {case.name}",
                figure(right.travelled[-1]),
                figure(apart(path, right)[0]),
                f"{apart(path, right)[1]:.3g} %",
                figure(apart(path, wrong)[0]),
                f"{apart(path, wrong)[1]:.3g} %",
            ]
        )
    term = "the sign turned" if plugin == GZ_SIM_8_12 else "the plugin's term"
    head = (
        "motion",
        "way, m",
        "from the equations, m",
        "of the way",
        f"from them with {term}, m",
        "of the way",
    )
    return table(head, rows)


def current_table(cases: Sequence[Case], compute: Callable[[str], None]) -> str:
    """A current by `simulator=gazebo` and by the plugin alone, both with `<fluid_added_mass>`."""
    rows = []
    for case in cases:
        compute(f"{case.vehicle}: {case.name}, the plugin's current")
        reference = embedded(case)
        row = [f"{case.vehicle}: {case.name}", figure(reference.travelled[-1])]
        for path in (gazebo(case, "corrected", DEFAULT), with_the_plugins_current(case, DEFAULT)):
            metres, share, _ = apart(path, reference)
            row += [figure(metres), f"{share:.3g} %"]
        rows.append(row)
    head = ("motion", "way, m", "simulator=gazebo, m", "of the way", "plugin alone, m", "of the way")
    return table(head, rows)


def environment() -> str:
    found = bindings.versions() | {name: versions()[name] for name in ("python", "numpy")}
    return ", ".join(f"{name} {found[name]}" for name in sorted(found)) + f"; {platform.machine()}"


def write(sections: dict[str, str]) -> None:
    """Puts each section between its marks in the page."""
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

    def compute(what: str) -> None:
        print(what, file=sys.stderr, flush=True)

    checked, moving = verification(), mixed()
    if "--plugin" in sys.argv[1:]:
        if sys.argv[sys.argv.index("--plugin") + 1 :][:1] != [GZ_SIM_8_11]:
            print(f"make parity: --plugin: {GZ_SIM_8_11} is the one that differs", file=sys.stderr)
            return 2
        return finish({"parity-8.11": signs_table(moving, compute, GZ_SIM_8_11)})
    sections = {
        "parity-corrected": cases_table([*checked, *moving], "corrected", compute),
        "parity-steps": steps_table([*checked, *moving[:7]], compute),
        "parity-published": signs_table(moving, compute),
        "parity-current": current_table([case for case in moving if any(case.current)], compute),
    }
    sections["parity-versions"] = environment()
    return finish(sections)


def finish(sections: dict[str, str]) -> int:
    """Into the page, or onto the screen."""
    if "--print" in sys.argv[1:]:
        print("\n\n".join(sections.values()))
    else:
        write(sections)
        print(f"written: {PAGE}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
