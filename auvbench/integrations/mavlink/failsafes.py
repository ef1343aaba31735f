"""Check ArduSub's own failsafes, which act when the pilot cannot: if the network or the computer's power is lost.

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
"""parameters with their valid ranges; an older ArduSub lacks FS_GCS_TIMEOUT"""
ACTS = 2.0
"""smallest value of FS_PILOT_INPUT and FS_GCS_ENABLE at which ArduSub stops the vehicle: 0 is off, 1 warns, 2 disarms"""
SLOW = 10.0
"""largest acceptable timeout in s; until the timeout, the vehicle may stay under thrust"""


def weak(parameters: Mapping[str, float]) -> str:
    """Return a warning about failsafes that are off, slow or unknown; '' if they are in order."""
    problems = []
    for name in ("FS_PILOT_INPUT", "FS_GCS_ENABLE"):
        value = parameters.get(name)
        if value is None:
            problems.append(f"{name} is unknown")
        elif value < ACTS:
            problems.append(
                f"{name} is {value:g} ({'only warns' if value == 1.0 else 'off'}), should be {ACTS:g} (disarm)"
            )
    for name in ("FS_PILOT_TIMEOUT", "FS_GCS_TIMEOUT"):
        if (value := parameters.get(name, 0.0)) > SLOW:
            problems.append(f"{name} is {value:g} s, should be at most {SLOW:g} s")
    if not problems:
        return ""
    return f"warning: a lost network may leave the vehicle under thrust: ArduSub's parameter {'; '.join(problems)}"
