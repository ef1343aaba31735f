"""A large batch on several threads, in compiled code throughout.

To wake a sleeping thread takes a quarter of a millisecond on a virtual machine, as long as it then works on 1000
environments, and between two kernels it would wait for the interpreter's lock. So a step is one compiled call, and
a worker stays in it: it looks at a counter until the next step is asked for. After `PATIENCE` looks without one it
leaves the processor to others and has to be woken.
"""

from __future__ import annotations

import os
import threading
import weakref
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.config import schema
from auvbench.dynamics.compiled import compiled
from auvbench.dynamics.kernel import advance as advance_vehicles
from auvbench.dynamics.layout import LANES
from auvbench.envs import atomics
from auvbench.envs.actions import admit
from auvbench.envs.atomics import sched_yield
from auvbench.envs.batch import Batch
from auvbench.simulators.fossen import FossenSimulator
from auvbench.tasks.kernels import add_command_noise, advance, observe

load: Any = atomics.load  # as compiled code calls it; its type describes the compiler's side
store: Any = atomics.store

PATIENCE = 20_000
"""looks (each a system call, some 5 to 10 ms together) after which a worker goes to sleep"""

# Words of the signals; the members' begin on cache lines of their own.
ASKED = 0  # steps asked for so far
STOP = 1
LINE = 8  # words of 64 bytes
DONE = 0  # of a member's line: steps done so far
ENDED = 1  # of a member's line: what the task's kernel `advance` returned last


@compiled("dynamics", "tasks")
def take_part(
    signals: NDArray[np.int64],
    member: int,
    members: int,
    patience: int,
    noise: tuple[Any, ...],
    physics: tuple[Any, ...],
    ends: tuple[Any, ...],
    reading: tuple[Any, ...],
) -> None:
    """Steps a range of environments: member 0 once, then it waits for the others; they whenever asked."""
    own = LINE * (1 + member)
    looks = 0
    while looks < patience:
        if load(signals, ASKED) == signals[own + DONE]:
            if load(signals, STOP) != 0:
                return
            looks += 1
            sched_yield()
            continue
        looks = 0
        add_command_noise(*noise)
        advance_vehicles(*physics)
        signals[own + ENDED] = advance(*ends)
        observe(*reading)
        store(signals, own + DONE, signals[own + DONE] + 1)
        if member == 0:
            for other in range(1, members):
                while load(signals, LINE * (1 + other) + DONE) != signals[ASKED]:
                    sched_yield()
            return


@compiled()
def ask(signals: NDArray[np.int64]) -> None:
    """Asks all members for one more step."""
    store(signals, ASKED, signals[ASKED] + 1)


class TeamBatch(Batch):
    """An undisturbed `Batch` on `config.simulator.threads` threads, the caller's among them: the same bits."""

    def __init__(
        self, config: schema.TrainConfig, n: int, *, seed: int | None = None, autoreset: bool = True
    ) -> None:
        super().__init__(config, n, seed=seed, autoreset=autoreset)
        self._team: Team | None = None

    def __getstate__(self) -> dict[str, Any]:
        # Threads do not travel; the copy makes its own when it is stepped.
        return self.__dict__ | {"_team": None}

    def load_state_dict(self, state: Mapping[str, NDArray[Any]]) -> None:
        """As `Batch.load_state_dict`."""
        self._team = None
        super().load_state_dict(state)

    def _compute(self, action: NDArray[np.floating]) -> int:
        admit(action, self._action)
        if self._team is None:
            self._team = Team([self._arguments(*bounds) for bounds in pairwise(self._bounds())])
        counts = self._team.step()
        failed = [count for count in counts if count < 0]
        return self.task.checked(max(failed) if failed else sum(counts))  # of several, the first environment

    def _bounds(self) -> list[int]:
        blocks = np.linspace(0, -(-self.n // LANES), self.config.simulator.threads + 1).astype(int)
        return [min(int(block) * LANES, self.n) for block in blocks]

    def _arguments(self, start: int, stop: int) -> tuple[Any, ...]:
        """What `take_part` takes for the environments start .. stop - 1."""
        task, simulator, action = self.task, self.simulator, self._action
        assert isinstance(simulator, FossenSimulator)
        physics = simulator.kernel_arguments(task.command, task.duration, start, stop)
        force, power = simulator.command_force, simulator.power
        return (
            task.noise_arguments(action, start, stop),
            physics,
            task.advance_arguments(simulator.pose, action, force, power, start, stop),
            task.observe_arguments(simulator.pose, start, stop),
        )


class Team:
    """Threads for all but the first of the ranges whose arguments are given; that one is the caller's."""

    def __init__(self, ranges: Sequence[tuple[Any, ...]]) -> None:
        members = len(ranges)
        self._signals = np.zeros(LINE * (1 + members), dtype=np.int64)
        calls = [
            (self._signals, member, members, PATIENCE, *arguments) for member, arguments in enumerate(ranges)
        ]
        self._own = calls[0]
        self._awake = [threading.Event() for _ in calls[1:]]
        self._process = os.getpid()
        for call, awake in zip(calls[1:], self._awake, strict=True):
            awake.set()
            threading.Thread(target=_serve, args=(call, awake), daemon=True).start()
        weakref.finalize(self, _stop, self._signals, self._awake)

    def step(self) -> list[int]:
        """Steps all ranges; what the task's kernel `advance` returned for each."""
        if os.getpid() != self._process:
            raise RuntimeError("threads do not survive a fork: make the batch in the process that steps it")
        ask(self._signals)
        for awake in self._awake:
            if not awake.is_set():
                awake.set()
        take_part(*self._own)
        counts: list[int] = self._signals[LINE + ENDED :: LINE].tolist()
        return counts


def _serve(call: tuple[Any, ...], awake: threading.Event) -> None:
    """The life of a worker's thread. Holds on to arrays, not to the team, which may go."""
    signals, done = call[0], LINE * (1 + call[1]) + DONE
    while not signals[STOP]:
        take_part(*call)
        # Whoever asks looks at `awake` after asking, so a step that was asked for since is seen by one of the two.
        awake.clear()
        if signals[ASKED] == signals[done] and not signals[STOP]:
            awake.wait()
        awake.set()


def _stop(signals: NDArray[np.int64], events: Sequence[threading.Event]) -> None:
    signals[STOP] = 1
    for awake in events:
        awake.set()
