"""ArduSub's own failsafes, which catch what no program of the pilot can: a lost network, a computer without power.

Sources: ArduSub/Parameters.cpp, ArduSub/failsafe.cpp.
"""

from __future__ import annotations

from collections.abc import Mapping

FAILSAFES = {
    "FS_PILOT_INPUT": (0.0, 10.0),
    "FS_GCS_ENABLE": (0.0, 10.0),
    "FS_PILOT_TIMEOUT": (0.0, 1e6),
    "FS_GCS_TIMEOUT": (0.0, 1e6),
}
"""parameters, and the values that they may have; an older ArduSub lacks the last one"""
ACTS = 2.0
"""the first value of the first two parameters with which ArduSub acts: 0 is off, 1 warns, 2 disarms"""
SLOW = 10.0
"""s, a long time under thrust"""


def weak(parameters: Mapping[str, float]) -> str:
    """Return a warning about failsafes that are off, slow or unknown; an empty text if they are in order."""
    found = []
    for name in ("FS_PILOT_INPUT", "FS_GCS_ENABLE"):
        value = parameters.get(name)
        if value is None:
            found.append(f"{name} is unknown")
        elif value < ACTS:
            found.append(
                f"{name} is {value:g} ({'only warns' if value == 1.0 else 'off'}), should be {ACTS:g} (disarm)"
            )
    for name in ("FS_PILOT_TIMEOUT", "FS_GCS_TIMEOUT"):
        if (value := parameters.get(name, 0.0)) > SLOW:
            found.append(f"{name} is {value:g} s, should be at most {SLOW:g} s")
    if not found:
        return ""
    return (
        f"warning: a lost network may leave the vehicle under thrust: ArduSub's parameter {'; '.join(found)}"
    )
