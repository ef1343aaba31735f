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
    position: NDArray[np.float64]
    """(T+1, 3) m, world ENU"""
    time: NDArray[np.float64]
    """(T+1,) s"""
    outcome: str
    """one of `record.OUTCOMES`, or '' where the table of episodes does not say"""
    reference: NDArray[np.float64] | None = None
    """(T+1, 3) m, where it moves"""


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """One test episode: where the waypoint or goal lay and how each run went there."""

    episode: int
    waypoint: tuple[float, float, float]
    """m, world ENU"""
    tracks: tuple[Track, ...]
    dock_yaw: float | None = None
    """rad, in which a dock is entered"""


@dataclass(frozen=True, slots=True, eq=False)
class Scenes:
    """All episodes that the 3-D view offers, and what could not be read."""

    scenes: tuple[Scene, ...] = ()
    problems: tuple[Problem, ...] = ()
    left_out: int = 0
    """runs whose paths were left out to keep the page small"""


def read(
    agents: Sequence[Agent], *, protocol: str, condition: str, runs: int = RUNS, episodes: int = EPISODES
) -> Scenes:
    """Read the paths of the agents' runs; every agent's first seed comes before any agent's second.

    Args:
        agents: in the order of the ranking.
        protocol: the protocol's name, as in `RunRecord.evaluations`.
        condition: the test condition within the protocol.
        runs: most runs to read.
        episodes: most episodes to read of a run.

    Returns:
        The episodes in ascending order; a file that cannot be read becomes a `Problem`.
    """
    candidates = [
        (row, index, run, evaluation)
        for index, agent in enumerate(agents)
        for row, run in enumerate(agent.runs)
        if (evaluation := run.evaluations.get(protocol)) is not None and has_paths(evaluation)
    ]
    candidates.sort(key=lambda candidate: candidate[:2])
    problems: list[Problem] = []
    first: dict[int, StoredPath] = {}
    tracks: dict[int, list[Track]] = {}
    for row, index, run, evaluation in candidates[:runs]:
        try:
            for path in paths(run.id, evaluation, condition, episodes):
                outcome = _outcome(agents[index], row, path.episode)
                first.setdefault(path.episode, path)
                track = Track(index, run, path.position, path.time, outcome, path.reference)
                tracks.setdefault(path.episode, []).append(track)
        except Damage as damage:
            problems.append(Problem(where=run.id, kind=damage.kind, message=str(damage)))
    scenes = tuple(
        Scene(
            episode,
            first[episode].waypoint,
            tuple(sorted(found, key=lambda t: (t.agent, t.run.seed))),
            first[episode].dock_yaw,
        )
        for episode, found in sorted(tracks.items())
    )
    return Scenes(scenes, tuple(problems), max(0, len(candidates) - runs))


def pack(scenes: Scenes, *, budget: int = BUDGET) -> list[dict[str, Any]]:
    """The episodes as plain data for JSON, `budget` characters of positions at most (about).

    A track becomes `{agent, seed, run, outcome, dt, end, unit, start, distance, points}`: `points` is base64
    of int16 (n, 3) counts of `unit` metres; point i lies at min(i dt, end) seconds after the start. `reference`
    holds as many points of a reference that moves.
    """
    count = sum(1 + (track.reference is not None) for scene in scenes.scenes for track in scene.tracks)
    # 6 bytes a point, 4 characters for 3 bytes
    points = max(24, min(POINTS, budget // max(1, count) // 8))
    return [
        {
            "episode": scene.episode,
            "waypoint": [round(value, 3) for value in scene.waypoint],
            "tracks": [_pack_track(track, points) for track in scene.tracks],
            **({} if scene.dock_yaw is None else {"dock_yaw": round(scene.dock_yaw, 4)}),
        }
        for scene in scenes.scenes
    ]


def _pack_track(track: Track, points: int) -> dict[str, Any]:
    steps = len(track.position) - 1
    stride = max(1, math.ceil(steps / (points - 1)))
    kept = np.minimum(np.arange(0, math.ceil(steps / stride) + 1) * stride, steps)
    elapsed = track.time - track.time[0]
    duration = float(elapsed[-1])
    position = track.position[kept]
    reference = None if track.reference is None else track.reference[kept]
    farthest = max(
        float(np.abs(found).max(initial=0.0)) for found in (position, reference) if found is not None
    )
    unit = max(UNIT, farthest / 32767.0)
    return {
        "agent": track.agent,
        "seed": track.run.seed,
        "run": track.run.id,
        "outcome": track.outcome,
        "dt": round(duration / max(1, steps) * stride, 9),
        "end": round(duration, 6),
        "unit": unit,
        "points": _counts(position, unit),
        **({} if reference is None else {"reference": _counts(reference, unit)}),
    }


def _counts(points: NDArray[np.float64], unit: float) -> str:
    return base64.b64encode(np.rint(points / unit).astype("<i2").tobytes()).decode("ascii")


def _outcome(agent: Agent, row: int, episode: int) -> str:
    if row < agent.outcome.shape[0] and episode < agent.outcome.shape[1]:
        code = int(agent.outcome[row, episode])
        return OUTCOMES[code] if 0 <= code < len(OUTCOMES) else ""
    return ""
