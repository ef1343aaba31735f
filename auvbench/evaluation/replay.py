"""One episode of a test once more: its row is the same, and its whole path is kept."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from auvbench.config import schema
from auvbench.errors import RunError, UserError, closest
from auvbench.evaluation.evaluate import make_agent
from auvbench.evaluation.protocol import circumstances
from auvbench.evaluation.rollout import roll_out
from auvbench.record import Record
from auvbench.runs.directory import RunDirectory

Floats = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class Replay:
    """An episode with its path; T steps."""

    run: str
    protocol: str
    condition: str
    config: schema.TrainConfig
    actuators: tuple[str, ...]
    record: Record
    time: Floats  # (T + 1,) s
    position: Floats  # (T + 1, 3) m
    yaw: Floats  # (T + 1,) rad
    command: Floats  # (T, n_u) N
    waypoint: Floats  # (3,) m

    @property
    def distance(self) -> Floats:
        """(T + 1,) m to the waypoint."""
        return np.asarray(np.linalg.norm(self.position - self.waypoint, axis=1), dtype=np.float32)


def replay(run: RunDirectory, protocol: schema.Protocol, condition: str, episode: int) -> Replay:
    """Runs one episode of a protocol with a fresh agent.

    Raises:
        RunError: the run is not complete.
        UserError: the protocol has no such condition or episode.
    """
    state = run.manifest()["state"]
    if state != "complete":
        raise RunError(f"{run.path}: {state}, not complete; auvbench train finishes it")
    if not 0 <= episode < protocol.episodes:
        raise UserError(
            f"--episode {episode}: protocol {protocol.name} has episodes 0 to {protocol.episodes - 1}"
        )
    found = {c.name: c.config for c in circumstances(protocol, run.check())}
    if condition not in found:
        raise UserError(
            f"--condition {condition}: not in protocol {protocol.name}; {closest(condition, found)}"
        )
    config = found[condition]
    agent = make_agent(run, config.step.frequency)
    result = roll_out(
        config,
        agent,
        episodes=np.array([episode]),
        seed=protocol.seed,
        batch=1,
        trajectories=1,
        scenarios=protocol.scenarios,
    )
    arrays = result.trajectories[episode].arrays(result.duration)
    return Replay(
        run=run.id,
        protocol=protocol.name,
        condition=condition,
        config=config,
        actuators=result.actuators,
        record=result.records[0],
        time=arrays["time"],
        position=arrays["position"],
        yaw=arrays["yaw"],
        command=arrays["command"],
        waypoint=arrays["waypoint"],
    )
