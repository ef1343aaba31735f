"""Writes docs/verification.md: every case with what was expected, what the simulator gives, and the tolerance.

`python -m tests.verification.page` in the root of the repository.
"""

from __future__ import annotations

import sys
from pathlib import Path

from . import cases_motion, cases_reference, cases_unit, cases_waves
from .case import Case

PAGE = Path(__file__).parents[2] / "docs" / "verification.md"

INTRODUCTION = """\
# Verification

Does the simulator compute what a marine engineer would expect? Each line below takes a number that others
published, or that another program prints, puts the same question to auvbench's compiled simulator (the one
that trains and tests agents) and compares. Nothing here was tuned to fit.

{summary}

How to read it: *expected* is the source's number or a closed form, *got* is the simulator's, *tolerance* is the
largest difference that passes. Where a source gives three digits, the tolerance is half of the last one; closed forms
are met within 1e-6, trajectories within 1e-6 of their extent, and the same equations in plain NumPy within 1e-12.
`>` and `<` are bounds, as the source's own test states them.

`make verification` computes this page anew; the test suite checks every line on each run.

What the equations are, and what they leave out: [physics.md](physics.md).
"""

SECTIONS = {
    cases_motion.SECTION_PATHS: """\
Whole trajectories that two other programs computed in six degrees of freedom, with a wrench on the body's origin and no
thrusters, in north-east-down. `auvbench simulate` writes files with the same header. Deviations are the largest over all
samples, divided by the largest value of the same kind in the file. The surge run bifurcates after 12.6 s (it is open-loop
unstable in pitch, so that any two integrators part there) and is compared until 12 s.""",
    cases_motion.SECTION_LRAUV: """\
The system tests of the LRAUV's own simulation, at their time step of .02 s and with the Coriolis terms of the added mass
switched off, as theirs. Closed form: u = u_inf tanh(t / tau), u_inf = sqrt(F / d), tau = m / sqrt(F d). Three-digit
values are those of a plain integration of the same parameters. The turn meets the test only with the rudder beyond its joint
limit, which that simulation does not enforce; with the limit the vehicle turns more slowly (last line of the turn).""",
    cases_unit.SECTION_GZ: """\
Values in the unit tests of gz-sim 8 (Gazebo Harmonic), and motions of a running one. Its Hydrodynamics plugin has had a
wrong sign in the added-mass Coriolis term since 2021 (up to 8.14.0 its yaw moment while swaying is the opposite of these values, and
under 4 x 10 N ahead its BlueROV2 pitches by -.235 rad and climbs at .294 m/s), so the motions are those with added mass by SDF's
`fluid_added_mass`, which has the right sign.""",
    cases_unit.SECTION_UUV: "Values in the unit tests of the UUV Simulator.",
    cases_unit.SECTION_DOCKAUV: """\
Matrix entries in the unit tests of gym_dockauv with Wu's parameters (`bluerov2_wu2018`), in its axes (z down). D and the
restoring vector are read from the accelerations of the simulated vehicle.""",
    cases_unit.SECTION_THRUSTERS: "Points of the published thrust curves.",
    cases_motion.SECTION_SPEEDS: """\
Speeds in level flight by the sources' coefficients. The vehicle is held level: free, under surge thrust, a correct model of
a BlueROV2 turns away (Munk moment), which `auvbench vehicles` warns of.""",
    cases_motion.SECTION_MAKER: """\
What the maker states for the real vehicle. These are no tests of the equations but of the parameters; the tolerances are
as wide as the statements differ.""",
    cases_reference.SECTION: """\
The compiled simulator against a readable NumPy transcription of Fossen's equations, which shares no code with it, and
whose vehicle parameters were transcribed from the sources a second time. Relative deviation of position, attitude, velocity
and rates, the worst of them.""",
    cases_waves.SECTION: """\
Variances are means over 512 episodes, as they are drawn, and 256 moments of each; velocities are read from the linear drag on a
body at rest, forces from the acceleration of a body held in place. The path and the drifting sphere need small waves: the
sphere differs from a particle of water in terms of second order in the steepness.""",
}

INVARIANTS = """\
## Invariants

In addition to these numbers, the test suite searches for counterexamples (`tests/verification/test_invariants.py`), over all
vehicles and random states: C(nu) is skew-symmetric and takes no power; energy never grows without input in still water and
is conserved without damping; quaternions keep length 1; NED and ENU tell the same motion to the last bit; a neutral,
balanced vehicle stays put in any attitude; vehicles that are symmetric move in mirror images; terminal speeds and the time
to reach them meet their closed forms; a vehicle that drifts with a constant current feels nothing, also while it turns; a
current equal to the velocity means no drag; halving the step over 60 s changes the trajectory as fourth order predicts; the
same vehicle gives the same bits in a batch of any size.
"""


def all_cases() -> list[Case]:
    order = list(SECTIONS)
    cases = [*cases_motion.cases(), *cases_unit.cases(), *cases_reference.cases(), *cases_waves.cases()]
    return sorted(cases, key=lambda case: order.index(case.section))


def number(value: float) -> str:
    """Six digits; deviations that are mere rounding as one digit, since they differ between machines."""
    if value == 0.0:
        return "0"
    return f"{value:.0e}" if abs(value) < 1e-6 else f"{value:.6g}"


def cell(case: Case) -> tuple[str, str, str]:
    """What a line says apart from what the simulator gave: name, expected, tolerance."""
    unit = f" {case.unit}" if case.unit else ""
    relation = "" if case.relation == "=" else f"{case.relation} "
    tolerance = (
        "" if case.relation != "=" else "exact" if case.tolerance == 0.0 else f"{case.tolerance:g}{unit}"
    )
    return case.name, f"{relation}{number(case.expected)}{unit}", tolerance


def line(case: Case) -> str:
    got = case.got()
    unit = f" {case.unit}" if case.unit else ""
    name, expected, tolerance = cell(case)
    verdict = "pass" if case.passes(got) else "**FAIL**"
    return f"| {name} | {expected} | {number(got)}{unit} | {tolerance} | {verdict} |"


def page() -> str:
    cases = all_cases()
    lines = {case.key: line(case) for case in cases}
    passed = sum(text.endswith("| pass |") for text in lines.values())
    parts = [INTRODUCTION.format(summary=f"**{passed} of {len(cases)} cases pass.**")]
    for section, text in SECTIONS.items():
        own = [case for case in cases if case.section == section]
        sources = "; ".join(dict.fromkeys(case.source for case in own))
        parts.append(f"## {section}\n\n{text}\n\nSource: {sources}.\n")
        parts.append("| case | expected | got | tolerance | |\n|---|---|---|---|---|")
        parts[-1] += "".join("\n" + lines[case.key] for case in own) + "\n"
    return "\n".join([*parts, INVARIANTS])


def main() -> int:
    text = page()
    PAGE.parent.mkdir(exist_ok=True)
    PAGE.write_text(text, encoding="utf-8")
    failed = text.count("**FAIL**")
    print(f"{len(all_cases())} cases, {failed} failed: {PAGE}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
