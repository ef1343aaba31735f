"""Names and versions of the scenarios of the protocol `test`, with their fingerprints.

A set contains one task's scenarios, e.g. `waypoint-2026a`. After a change of the scenarios or the physics, add a
new version here, with the reason. A unit test checks that the newest version of each set has the fingerprints of
the present code. Earlier versions stay, because published results name them.
"""

from __future__ import annotations

from dataclasses import dataclass

VEHICLES = ("bluerov2", "bluerov2_heavy", "bluerov2_realistic_inertia")
"""Vehicles of the published studies; each vehicle has its own fingerprint"""


@dataclass(frozen=True, slots=True)
class ScenarioSet:
    """One version of a task's scenarios in the protocol `test`."""

    task: str
    version: str
    """Version: year and letter"""
    fingerprints: tuple[str, ...]
    """One fingerprint for each of `VEHICLES`"""
    change: str
    """Reason for this version"""

    @property
    def name(self) -> str:
        """Return the name for citations, e.g. waypoint-2026a."""
        return f"{self.task}-{self.version}"


FIRST = "first version"
SETS: tuple[ScenarioSet, ...] = (
    ScenarioSet("waypoint", "2026a", ("cc8e88038a09e4a8", "29a4df74710034ad", "cfa964bbf0f12f5b"), FIRST),
    ScenarioSet(
        "station_keeping", "2026a", ("ac60a774b51aff74", "9056a02043239a5c", "f1d0b724378e8600"), FIRST
    ),
    ScenarioSet(
        "trajectory_tracking", "2026a", ("c981cab602c35cd2", "8c1e6d3e051f3c1e", "27077ec998ce0e9c"), FIRST
    ),
    ScenarioSet(
        "path_following", "2026a", ("d4c0239f2eea07ff", "726992aad6f64924", "65f420dbb29076e5"), FIRST
    ),
    ScenarioSet(
        "path_following",
        "2026b",
        ("f6b5d2f419530234", "bebd47bf3c5b9aa4", "ce1f35d723cace08"),
        "starts and paths keep a distance from the depth limits; progress begins at the point of the path nearest to the start",
    ),
    ScenarioSet("docking", "2026a", ("372a8e4102eeb023", "68ac90e484f69317", "e6b823ffe4dcd4b8"), FIRST),
    ScenarioSet("transit", "2026a", ("ffc51e23fd12d717", "e68b77e5e44edef4", "1bfa71499a41b02d"), FIRST),
    ScenarioSet("terrain", "2026a", ("40607b71e44a7a1e", "d03f391529746ce3", "891909e5ee3ff97e"), FIRST),
    ScenarioSet("formation", "2026a", ("e0bbc2ef54232a89", "61bf964fbb6825fe", "8b702d21262fd6c9"), FIRST),
    ScenarioSet("rendezvous", "2026a", ("97221e3f48ec18ab", "f5b65dc670751d80", "f3476a0bbba03b20"), FIRST),
    ScenarioSet("tracking", "2026a", ("66303e6990503993", "76ab7190bf3f6e02", "af22cd6f1830f112"), FIRST),
)
"""All versions of all tasks' scenarios; the versions of a task are in order, the newest last"""


def newest() -> dict[str, ScenarioSet]:
    """Return the newest version of each task's set."""
    return {entry.task: entry for entry in SETS}


def name_of(fingerprint: str) -> str:
    """Return the name of the scenario set to which `fingerprint` belongs; '' if it belongs to no set.

    >>> name_of("0123456789abcdef")
    ''
    """
    return next((entry.name for entry in SETS if fingerprint in entry.fingerprints), "")


def cited(fingerprint: str) -> str:
    """Return a fingerprint as reports print it, with the name of its set in front if a set has it."""
    name = name_of(fingerprint)
    return f"{name} ({fingerprint})" if name else fingerprint
