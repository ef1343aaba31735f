"""Trajectories for the 3-D view: read from the runs, thinned, and packed small enough for a page.

A run's `evaluations/<protocol>/trajectories.npz` holds `position_<condition>_<episode>` (T+1, 3) m,
`time_...` (T+1,) s and `waypoint_...` (3,) m for its first few episodes, `reference_...` (T+1, 3) m where the
reference moves, and `dock_yaw_...` (1,) rad where there is a dock. Here each path becomes at most
`POINTS` positions, equally spaced in steps, as little-endian int16 counts of `unit` metres in base64: 1 cm
where the path stays within 327 m, and the smallest unit that holds it otherwise.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.analysis.evaluations import Damage
from auvbench.analysis.recorded import StoredPath, has_paths, paths
from auvbench.analysis.records import Agent, Problem, RunRecord
from auvbench.record import OUTCOMES

POINTS = 320
"""most positions kept of one path"""
RUNS = 200
"""most runs whose paths go into a page, best-ranked agents first"""
EPISODES = 10
"""most episodes of a run that go into a page"""
BUDGET = 3_500_000
"""characters that all packed paths of a page may take; paths are thinned further to keep to it"""
UNIT = 0.01
"""m per count"""


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """The path of one run through one episode."""

    agent: int
    """index into the agents the page was given"""
    run: RunRecord
    outcome: str
    """one of `record.OUTCOMES`, or '' where the table of episodes does not say"""
    path: StoredPath


def read(
    agents: Sequence[Agent], *, protocol: str, condition: str, runs: int = RUNS
) -> tuple[list[Track], list[Problem], int]:
    """Read the paths of the agents' runs; every agent's first seed comes before any agent's second.

    Args:
        agents: in the order of the ranking.
        protocol: the protocol's name, as in `RunRecord.evaluations`.
        condition: the test condition within the protocol.
        runs: most runs to read.

    Returns:
        The tracks by episode, agent and seed; the files that cannot be read; the number of runs that are left out.
    """
    candidates = [
        (row, index, run, evaluation)
        for index, agent in enumerate(agents)
        for row, run in enumerate(agent.runs)
        if (evaluation := run.evaluations.get(protocol)) is not None and has_paths(evaluation)
    ]
    candidates.sort(key=lambda candidate: candidate[:2])
    problems: list[Problem] = []
    tracks: list[Track] = []
    for row, index, run, evaluation in candidates[:runs]:
        try:
            for path in paths(run.id, evaluation, condition, EPISODES):
                tracks.append(Track(index, run, _outcome(agents[index], row, path.episode), path))
        except Damage as damage:
            problems.append(Problem(where=run.id, kind=damage.kind, message=str(damage)))
    tracks.sort(key=lambda track: (track.path.episode, track.agent, track.run.seed))
    return tracks, problems, max(0, len(candidates) - runs)


def pack(tracks: Sequence[Track], *, budget: int = BUDGET) -> list[dict[str, Any]]:
    """Return the episodes as plain data for JSON, `budget` characters of positions at most (about).

    A track becomes `{agent, seed, run, outcome, dt, end, unit, points}`: `points` is base64 of int16 (n, 3) counts of `unit`
    metres; point i lies at min(i dt, end) seconds after the start. `reference` holds as many points of a reference that
    moves.
    """
    count = sum(1 + (track.path.reference is not None) for track in tracks)
    # 6 bytes a point, 4 characters for 3 bytes
    points = max(24, min(POINTS, budget // max(1, count) // 8))
    episodes: dict[int, dict[str, Any]] = {}
    for track in tracks:
        path = track.path
        if path.episode not in episodes:
            dock = {} if path.dock_yaw is None else {"dock_yaw": round(path.dock_yaw, 4)}
            waypoint = [round(value, 3) for value in path.waypoint]
            episodes[path.episode] = {"episode": path.episode, "waypoint": waypoint, "tracks": [], **dock}
        episodes[path.episode]["tracks"].append(_pack_track(track, points))
    return list(episodes.values())


def _pack_track(track: Track, points: int) -> dict[str, Any]:
    path = track.path
    steps = len(path.position) - 1
    stride = max(1, math.ceil(steps / (points - 1)))
    kept = np.minimum(np.arange(0, math.ceil(steps / stride) + 1) * stride, steps)
    duration = float(path.time[-1] - path.time[0])
    lines = {"points": path.position[kept]}
    if path.reference is not None:
        lines["reference"] = path.reference[kept]
    unit = max(UNIT, max(float(np.abs(line).max(initial=0.0)) for line in lines.values()) / 32767.0)
    return {
        "agent": track.agent,
        "seed": track.run.seed,
        "run": track.run.id,
        "outcome": track.outcome,
        "dt": round(duration / max(1, steps) * stride, 9),
        "end": round(duration, 6),
        "unit": unit,
        **{name: _counts(line, unit) for name, line in lines.items()},
    }


def _counts(points: NDArray[np.float64], unit: float) -> str:
    return base64.b64encode(np.rint(points / unit).astype("<i2").tobytes()).decode("ascii")


def _outcome(agent: Agent, row: int, episode: int) -> str:
    if row < agent.outcome.shape[0] and episode < agent.outcome.shape[1]:
        code = int(agent.outcome[row, episode])
        return OUTCOMES[code] if 0 <= code < len(OUTCOMES) else ""
    return ""
