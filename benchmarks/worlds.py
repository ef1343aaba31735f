"""Measure rays and distances among solids, and the filter of commands (`make bench ARGS=worlds`)."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from auvbench.envs.batch import Batch
from auvbench.envs.settings import configuration
from auvbench.worlds import solids
from auvbench.worlds.casting import cast, clearance
from benchmarks.timing import best, loop_rate

RAYS, SOLIDS = 64, 20
GOAL = 8.0
"""µs of a scan on a machine with GOAL_RATE turns of the plain loop per second"""
FILTER_GOAL = 20.0
"""µs of a filtered command on this machine"""
GOAL_RATE = 12e6


def worlds() -> Iterator[tuple[str, str, str, str]]:
    """Measure a scan of 64 rays among 20 solids, and the clearance of one point."""
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(RAYS, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    origins, ranges, hits = np.zeros((RAYS, 3)), np.empty(RAYS), np.empty(RAYS, np.int64)
    centres, axes = rng.uniform(-15.0, 15.0, (SOLIDS, 3)), rng.normal(size=(SOLIDS, 3))
    scenes = {
        "capsules": [solids.capsule(c, a, 4.0, 1.0) for c, a in zip(centres, axes, strict=True)],
        "boxes": [solids.box(c, [2.0, 2.0, 4.0]) for c in centres],
    }
    for name, parts in scenes.items():
        scene = np.concatenate(parts)
        scan = scene, solids.NO_HEIGHTS, 0.0, origins, directions, 50.0, ranges, hits
        seconds, rate = best(lambda scan=scan: cast(*scan), clock=time.thread_time), loop_rate()  # type: ignore[misc]
        there = 1e6 * seconds * rate / GOAL_RATE
        yield (
            f"scan of {RAYS} rays among {SOLIDS} {name}",
            f"{1e6 * seconds:.1f}",
            "µs",
            f"{there:.1f} µs at {GOAL_RATE / 1e6:g} million turns/s; goal: {GOAL:g}",
        )
        one = origins[:1], 50.0, ranges[:1], hits[:1], np.empty((1, 3))
        seconds = best(lambda one=one, scene=scene: clearance(scene, solids.NO_HEIGHTS, 0.0, *one))  # type: ignore[misc]
        yield f"clearance of a point among {SOLIDS} {name}", f"{1e6 * seconds:.2f}", "µs", ""
    yield from filtered()


def filtered() -> Iterator[tuple[str, str, str, str]]:
    """Measure the filter `cbf` of one vehicle's command: where it changes nothing, and where it solves a programme."""
    words = ["task=transit", "world=tank", "world.length=90", "world.width=90", "algo=pid", "filter=cbf"]
    batch = Batch(configuration(overrides=words), 1)
    batch.reset()
    task, simulator = batch.task, batch.simulator
    for name, wall in (("far from solids", 40.0), ("in a corner", 0.5)):
        task.world.solids[0, 1:]["position"] = -wall * task.world.solids[0, 1:]["along_z"]  # type: ignore[union-attr]
        task.world.solids[0, :1]["position"] = [0.0, 0.0, simulator.pose[0, 2] - wall]  # type: ignore[union-attr]
        action = np.ones((1, len(batch.vehicle.units)))

        def act(action: Any = action) -> None:
            action[:] = 1.0
            task.protect(simulator.pose, simulator.velocity, action)

        seconds, rate = best(act, clock=time.thread_time), loop_rate()
        there = 1e6 * seconds * rate / GOAL_RATE
        yield (
            f"filter of a command, {name}",
            f"{1e6 * seconds:.1f}",
            "µs",
            f"{there:.1f} µs at {GOAL_RATE / 1e6:g} million turns/s; goal: {FILTER_GOAL:g}",
        )
