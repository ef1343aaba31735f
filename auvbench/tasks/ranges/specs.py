"""Describe the blocks of range sensors.

Importing this module imports no code of a sensor.
"""

from __future__ import annotations

from typing import Any

from auvbench.blocks import BlockSpec, Reading, Setting
from auvbench.config.ranges import PREFIX, oldest
from auvbench.observation import BODY, Block
from auvbench.worlds.kinds import KINDS

MOST, SIGHT = 8, 10.0
"""Largest number of solids that the block `solids` shows, and the distance in m within which it shows them"""
SOLID = (
    "kind", "x", "y", "z", "axis_x", "axis_y", "axis_z", "side_x", "side_y", "side_z", "radius", "half_x", "half_y", "half_z",
)  # fmt: skip
NUMBERS = len(SOLID)
"""Number of values that describe a solid"""
LONGEST = 1e5
"""Bound of the size of a solid and of the distance to its centre, m"""


def in_the_loop(m: Reading, e: Any, p: Any, out: Any) -> None:
    """Raise NotImplementedError: the observing loop calls a sensor to write this block, not this `write` function."""
    raise NotImplementedError


def _block(s: Setting, name: str, labels: list[str], more: dict[str, float], meaning: str) -> Block:
    """Return a block with a closeness for each of `labels`, then a value for each label of `more`, which gives the label's bound."""
    names = tuple(f"range_{name}_{label}" for label in (*labels, *more))
    text = f"{meaning}: 1 - distance / {s.sensor.high:g} m; 0: nothing"
    return Block(f"{PREFIX}{name}", names, "1", (1.0,) * len(labels) + tuple(more.values()), text)


def _ideal(s: Setting) -> Block:
    labels = [f"{row}_{column}" for row in range(s.sensor.rows) for column in range(s.sensor.columns)]
    return _block(s, "ideal", labels, {}, "closeness along rays, rows from the lowest, each from port")


def _ping1d(s: Setting) -> Block:
    names = ("range_ping1d_distance", "range_ping1d_confidence", "range_ping1d_age")
    bounds = (s.sensor.high, 1.0, oldest(s.sensor))
    return Block(f"{PREFIX}ping1d", names, "m, 1, s", bounds, "distance, its confidence and its age")


def _ping360(s: Setting) -> Block:
    labels = [str(sector) for sector in range(s.sensor.sectors)]
    meaning = "closeness in sectors, counter-clockwise, then cosine and sine of the head's direction"
    return _block(s, "ping360", labels, {"cos": 1.0, "sin": 1.0}, meaning)


def _multibeam(s: Setting) -> Block:
    labels = [str(beam) for beam in range(s.sensor.beams)]
    meaning = "closeness in beams from port, then their age in s"
    return _block(s, "multibeam", labels, {"age": oldest(s.sensor)}, meaning)


def _solids(s: Setting) -> Block:
    labels = tuple(f"solids_{k}_{name}" for k in range(1, MOST + 1) for name in SOLID)
    bounds = (float(len(KINDS)), *(LONGEST,) * 3, *(1.0,) * 6, *(LONGEST,) * 4)
    meaning = (
        f"the {MOST} nearest solids within {SIGHT:g} m: kind (0: none; {', '.join(f'{k}: {name}' for k, name in enumerate(KINDS[:-1], 1))}), "
        "centre less position, directions of its own z and x, sizes"
    )
    return Block("solids", labels, "1, m", bounds * MOST, meaning, BODY)


_CODE = "auvbench.tasks.ranges"
READS = ("pose", "solids")
ideal = BlockSpec("range.ideal", in_the_loop, _ideal, READS, f"{_CODE}.ideal:IdealFan")
ping1d = BlockSpec("range.ping1d", in_the_loop, _ping1d, READS, f"{_CODE}.ping1d:EchoSounder")
ping360 = BlockSpec("range.ping360", in_the_loop, _ping360, READS, f"{_CODE}.ping360:ScanningSonar")
multibeam = BlockSpec("range.multibeam", in_the_loop, _multibeam, READS, f"{_CODE}.multibeam:MultibeamSonar")
solids = BlockSpec("solids", in_the_loop, _solids, READS, f"{_CODE}.solids:NearestSolids")
