"""Prepare trajectories for the 3-D view: read them from the runs, thin them, and pack them for a page.

A run's `evaluations/<protocol>/trajectories.npz` has these arrays for each of its first few episodes:

    position_<condition>_<episode>   (T + 1, 3) m
    time_<condition>_<episode>       (T + 1,) s
    yaw_...                          (T + 1,) rad
    command_...                      (T, n_u) N
    waypoint_...                     (3,) m
    reference_...                    (T + 1, 3) m, if the reference moves
    others_...                       (T + 1, V - 1, 3) m, for a team of V vehicles
    dock_yaw_...                     (1,) rad, for a dock

The page has at most `POINTS` positions of each path, equally spaced in steps. A coordinate is stored as an integer
count of a length, `unit` metres: little-endian int16, in base64. The unit is 1 cm if all coordinates of the path are
within 327 m, otherwise the smallest unit with which the counts fit into int16.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.analysis.damage import Damage
from auvbench.analysis.recorded import paths
from auvbench.analysis.records import Agent, Problem, RunRecord
from auvbench.analysis.sources import StoredPath
from auvbench.record import OUTCOMES

POINTS = 320
"""largest number of packed positions of one path"""
RUNS = 200
"""largest number of runs with paths in a page"""
EPISODES = 10
"""largest number of episodes of a run in a page"""
BUDGET = 3_500_000
"""largest number of characters of all packed paths of a page; longer paths get fewer points to stay below this limit"""
UNIT = 0.01
"""smallest unit of a packed coordinate, m"""


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """Path of one run in one episode."""

    agent: int
    """index of the agent in the page's list of agents"""
    run: RunRecord
    outcome: str
    """one of `record.OUTCOMES`; '' if the outcome is unknown"""
    path: StoredPath


def read(
    agents: Sequence[Agent], *, protocol: str, condition: str, runs: int = RUNS
) -> tuple[list[Track], list[Problem], int]:
    """Read the paths of the agents' runs.

    If there are too many runs, the first seeds of all agents are read before any second seed.

    Args:
        agents: agents in the order of the ranking.
        protocol: name of the protocol, as in `RunRecord.evaluations`.
        condition: test condition of the protocol.
        runs: largest number of runs to read.

    Returns:
        Tracks, sorted by episode, then agent, then seed; a problem for each unreadable file; number of runs left out.
    """
    candidates = [
        (row, index, run)
        for index, agent in enumerate(agents)
        for row, run in enumerate(agent.runs)
        if protocol in run.evaluations and run.source.has_paths(protocol)
    ]
    candidates.sort(key=lambda candidate: candidate[:2])
    problems: list[Problem] = []
    tracks: list[Track] = []
    for row, index, run in candidates[:runs]:
        try:
            for path in paths(run, protocol, condition, EPISODES):
                tracks.append(Track(index, run, _outcome(agents[index], row, path.episode), path))
        except Damage as damage:
            problems.append(Problem(where=run.id, kind=damage.kind, message=str(damage)))
    tracks.sort(key=lambda track: (track.path.episode, track.agent, track.run.seed))
    return tracks, problems, max(0, len(candidates) - runs)


def pack(tracks: Sequence[Track], *, budget: int = BUDGET) -> list[dict[str, Any]]:
    """Return the episodes as plain data for JSON, with at most about `budget` characters of positions.

    A track becomes `{agent, seed, run, outcome, dt, end, unit, points}` with

    * `points`: base64 of int16 (n, 3) counts of `unit` metres; point i is at min(i dt, end) seconds after the start;
    * `reference`: n points of the reference in the same form, if the reference moves;
    * `others`: for a team, n points of each other vehicle in the same form;
    * `signals`: base64 of int16 (n,) counts by the signal's name; `units` has the size of one count by the same name.
      The signals are `speed` in m/s and, if stored, `yaw` in degrees and `command`, the norm of the actuators' forces
      in N.
    """
    worlds = _worlds(tracks)
    budget -= sum(len(packed["outlines"]) for packed in worlds.values())
    # Count the three signals of a track as one more line, because they take as much space as the three coordinates.
    count = sum(1 + len(_lines(track.path)) for track in tracks)
    # A point takes 6 bytes, and base64 has 4 characters for 3 bytes: 8 characters per point.
    points = max(24, min(POINTS, budget // max(1, count) // 8))
    episodes: dict[int, dict[str, Any]] = {}
    for track in tracks:
        path = track.path
        if path.episode not in episodes:
            dock = {} if path.dock_yaw is None else {"dock_yaw": round(path.dock_yaw, 4)}
            waypoint = [round(value, 3) for value in path.waypoint]
            episodes[path.episode] = {"episode": path.episode, "waypoint": waypoint, "tracks": [], **dock}
            episodes[path.episode].update(worlds.get(path.episode, {}))
        episodes[path.episode]["tracks"].append(_pack_track(track, points))
    return list(episodes.values())


def _worlds(tracks: Sequence[Track]) -> dict[int, dict[str, Any]]:
    """Return the outlines of solids by episode, for episodes in a world with solids.

    If an episode has several paths, the outlines come from the path with the most segments. `outlines` is base64
    of int16 (k, 2, 3) counts of `outlines_unit` metres: the two ends of k segments.
    """
    outlines: dict[int, NDArray[np.float64]] = {}
    for track in tracks:
        lines = track.path.outlines
        if lines is not None and len(lines) > len(outlines.get(track.path.episode, ())):
            outlines[track.path.episode] = lines
    packed = {}
    for episode, lines in outlines.items():
        unit = max(UNIT, float(np.abs(lines).max()) / 32767.0)
        packed[episode] = {"outlines": _counts(lines, unit), "outlines_unit": unit}
    return packed


def _pack_track(track: Track, points: int) -> dict[str, Any]:
    path = track.path
    steps = len(path.position) - 1
    stride = max(1, math.ceil(steps / (points - 1)))
    indices = np.minimum(np.arange(0, math.ceil(steps / stride) + 1) * stride, steps)
    duration = float(path.time[-1] - path.time[0])
    lines = [line[indices] for line in _lines(path)]
    unit = max(UNIT, max(float(np.abs(line).max(initial=0.0)) for line in lines) / 32767.0)
    first, *more = (_counts(line, unit) for line in lines)
    reference = {} if path.reference is None else {"reference": more.pop(0)}
    return {
        "agent": track.agent,
        "seed": track.run.seed,
        "run": track.run.id,
        "outcome": track.outcome,
        "dt": round(duration / max(1, steps) * stride, 9),
        "end": round(duration, 6),
        "unit": unit,
        "points": first,
        **reference,
        **({"others": more} if more else {}),
        **_pack_signals(path, indices, duration / max(1, steps)),
    }


def _lines(path: StoredPath) -> list[NDArray[np.float64]]:
    """Return the lines (T + 1, 3) in m of a path: the vehicle, the moving reference if any, the other vehicles of the team."""
    reference = [] if path.reference is None else [path.reference]
    others = [] if path.others is None else list(path.others.swapaxes(0, 1))
    return [path.position, *reference, *others]


def _pack_signals(path: StoredPath, indices: NDArray[np.int64], dt: float) -> dict[str, dict[str, Any]]:
    """Return the packed signals of a path at the steps `indices`; one step takes `dt` s."""
    signals: dict[str, NDArray[np.float64]] = {}
    if len(path.position) > 1 and dt > 0.0:
        signals["speed"] = np.linalg.norm(np.gradient(path.position, dt, axis=0), axis=1)[indices]
    if path.yaw is not None:
        signals["yaw"] = np.degrees(np.unwrap(path.yaw))[indices]
    if path.command is not None and len(path.command):
        forces = np.linalg.norm(path.command, axis=1)
        signals["command"] = forces[np.minimum(indices, len(forces) - 1)]
    units = {
        name: max(1e-3, float(np.abs(values).max(initial=0.0)) / 32767.0) for name, values in signals.items()
    }
    packed = {name: _counts(values, units[name]) for name, values in signals.items()}
    return {"signals": packed, "units": units}


def _counts(points: NDArray[np.float64], unit: float) -> str:
    return base64.b64encode(np.rint(points / unit).astype("<i2").tobytes()).decode("ascii")


def _outcome(agent: Agent, row: int, episode: int) -> str:
    if row < agent.outcome.shape[0] and episode < agent.outcome.shape[1]:
        code = int(agent.outcome[row, episode])
        return OUTCOMES[code] if 0 <= code < len(OUTCOMES) else ""
    return ""
