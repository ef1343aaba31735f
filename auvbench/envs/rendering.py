"""What an environment shows of an episode: a picture, or a line of text."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from auvbench.dynamics import frames
from auvbench.envs.batch import Batch, Transition
from auvbench.errors import ConfigError, closest

if TYPE_CHECKING:
    from auvbench.envs.scene import Scene, Trail

MODES = ("rgb_array", "ansi")
"""of rendering, in addition to None"""


def check_mode(mode: str | None) -> None:
    """Raise ConfigError for an unknown render mode."""
    if mode is not None and mode not in MODES:
        raise ConfigError(f"render_mode={mode}: unknown; {closest(str(mode), [*MODES, 'None'])}")


def speed(frequency: float) -> float | int:
    """Pictures per second of a film in real time: one per agent step. Whole numbers as such, for writers of films."""
    return int(frequency) if float(frequency).is_integer() else frequency


class Renderer:
    """Follow the episodes of a batch and show them in a mode."""

    def __init__(self, mode: str | None, batch: Batch) -> None:
        check_mode(mode)
        self.mode = mode
        self._batch = batch
        self._steps = np.zeros(batch.n, dtype=np.int64)
        self._outcome: list[str | None] = [None] * batch.n
        self._trails: list[Trail | None] = [None] * batch.n
        self._scenes: list[Scene | None] = [None] * batch.n

    def begin(self, indices: NDArray[np.int64]) -> None:
        """Note that episodes have begun."""
        if self.mode is None:
            return
        self._steps[indices] = 0
        for i in indices.tolist():
            self._outcome[i] = None
        if self.mode != "rgb_array":
            return
        from auvbench.envs.scene import Trail

        state = self._batch.state
        for i in indices.tolist():
            self._scenes[i] = None
            task = self._batch.task
            trail = self._trails[i] = Trail(task.goal(i), task.dock_yaw(i))
            trail.add(state.pose[i], state.distance[i])

    def follow(self, i: int, pose: Any, distance: float, force: Any, outcome: str | None = None) -> None:
        """Note where environment `i` is after a step, and how its episode ended if it did."""
        self._steps[i] += 1
        self._outcome[i] = outcome
        trail = self._trails[i]
        if trail is not None:
            trail.add(pose, distance, force)

    def follow_step(self, result: Transition, begun: NDArray[np.int64]) -> None:
        """Follow a step of the batch, except in environments `begun` (k,), whose episodes began with it."""
        state, last = self._batch.state, result.final_state
        at = {i: k for k, i in enumerate(result.ended.tolist())}
        for i in np.setdiff1d(np.arange(self._batch.n), begun).tolist():
            k = at.get(i)
            shown, row = (state, i) if k is None else (last, k)
            outcome = None if k is None else str(result.records[k]["outcome"])
            self.follow(i, shown.pose[row], shown.distance[row], shown.force[row], outcome)
        self.begin(begun)

    def show(self, i: int) -> Any:
        """Return a picture (352, 832, 3) of uint8, or a line of text, of environment `i`; None without a mode."""
        if self.mode is None:
            return None
        return self._line(i) if self.mode == "ansi" else self._picture(i)

    def _picture(self, i: int) -> NDArray[np.uint8]:
        trail = self._trails[i]
        assert trail is not None
        scene = self._scenes[i]
        if scene is None:
            from auvbench.envs.scene import Scene

            force = float(np.abs(self._batch.vehicle.force_limits).max(initial=0.0))
            scene = self._scenes[i] = Scene(self._batch.config, force, trail)
        time = self._steps[i] / self._batch.config.step.frequency
        return scene.frame(f"{time:6.1f} s   {trail.distance[-1]:6.2f} m to go   {self._outcome[i] or ''}")

    def _line(self, i: int) -> str:
        state = self._batch.state
        (x, y, z), (a, b, c) = state.pose[i, :3], state.reference[i]
        yaw = np.degrees(frames.yaw(state.pose[i, 3:]))
        time = self._steps[i] / self._batch.config.step.frequency
        return (
            f"step {self._steps[i]} ({time:.1f} s): at ({x:.2f}, {y:.2f}, {z:.2f}) m, yaw {yaw:.0f} deg; "
            f"{state.key} ({a:.2f}, {b:.2f}, {c:.2f}) m, {state.distance[i]:.2f} m away; "
            f"{self._outcome[i] or 'under way'}"
        )
