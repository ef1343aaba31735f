from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from gymnasium import spaces
from stable_baselines3.common.buffers import ReplayBuffer

from auvbench.agents.base import Components
from auvbench.agents.learned.state import check_replay
from auvbench.errors import TrainingError
from auvbench.training.checkpoint.saver import FIELDS, ReplayStore
from auvbench.training.checkpoint.store import CheckpointStore
from tests.soak.killing import forked, kill_at_operation

OBSERVATIONS = spaces.Box(-np.inf, np.inf, (3,), np.float32)
ACTIONS = spaces.Box(-1.0, 1.0, (2,), np.float32)


def new(size: int, n: int, **options: bool) -> ReplayBuffer:
    return ReplayBuffer(size, OBSERVATIONS, ACTIONS, device="cpu", n_envs=n, **options)


def fill(buffer: ReplayBuffer, rows: int, rng: np.random.Generator) -> None:
    n = buffer.n_envs
    for _ in range(rows):
        infos = [{"TimeLimit.truncated": bool(x)} for x in rng.integers(2, size=n)]
        buffer.add(
            rng.normal(size=(n, 3)), rng.normal(size=(n, 3)), rng.normal(size=(n, 2)), rng.normal(size=n),
            rng.integers(2, size=n), infos,
        )  # fmt: skip


def assert_equal(a: ReplayBuffer, b: ReplayBuffer) -> None:
    assert (a.pos, a.full) == (b.pos, b.full)
    for field in FIELDS:
        assert getattr(a, field).tobytes() == getattr(b, field).tobytes(), field


@pytest.mark.parametrize("n", [1, 4])
@pytest.mark.parametrize("cadence", [3, 10, 64, 300])
def test_it_comes_back_bit_by_bit_at_every_checkpoint(tmp_path: Path, n: int, cadence: int) -> None:
    buffer, rng = new(100 * n, n), np.random.default_rng(0)
    checkpoints = CheckpointStore(tmp_path)
    replay = ReplayStore(checkpoints.replay_folder, transitions=16 * n)
    rows = 0
    for turn in range(12):
        fill(buffer, cadence + turn % 3, rng)
        rows += cadence + turn % 3
        check_replay(buffer, rows * n)
        checkpoints.save(rows * n, Components(), tuple(replay.save(buffer, rows)))
        found = checkpoints.latest_valid()
        assert found is not None
        again = new(100 * n, n)
        fresh = ReplayStore(checkpoints.replay_folder, transitions=16 * n)
        fresh.load(again, found.segments, rows)
        assert_equal(again, buffer)
        if turn % 2:  # a resumed process goes on from there
            buffer, replay = again, fresh
    wanted = {segment.name for step in checkpoints.steps() for segment in checkpoints.read(step).segments}
    assert {path.name for path in checkpoints.replay_folder.iterdir()} == wanted
    assert len(wanted) <= 2 * (100 // 16 + 2)


def test_a_checkpoint_writes_only_what_is_new(tmp_path: Path) -> None:
    buffer, rng = new(100_000, 4), np.random.default_rng(0)
    replay = ReplayStore(tmp_path, transitions=400)
    fill(buffer, 5_000, rng)
    replay.save(buffer, 5_000)
    before = {path.name for path in tmp_path.iterdir()}
    fill(buffer, 150, rng)
    replay.save(buffer, 5_150)
    assert len({path.name for path in tmp_path.iterdir()} - before) == 2


def test_a_damaged_segment_damages_only_the_checkpoints_that_hold_it(tmp_path: Path) -> None:
    buffer, rng = new(400, 4), np.random.default_rng(0)
    checkpoints = CheckpointStore(tmp_path)
    replay = ReplayStore(checkpoints.replay_folder, transitions=64)
    for rows in (40, 80):
        fill(buffer, 40, rng)
        checkpoints.save(rows * 4, Components(), tuple(replay.save(buffer, rows)))
    newest = checkpoints.replay_folder / checkpoints.read(320).segments[-1].name
    data = bytearray(newest.read_bytes())
    data[300] ^= 1
    newest.write_bytes(data)
    with pytest.warns(UserWarning, match="differs from its hash"):
        assert checkpoints.latest_valid().step == 160  # type: ignore[union-attr]


@pytest.mark.slow
def test_a_kill_while_segments_are_written_costs_nothing(tmp_path: Path) -> None:
    for count in range(1, 100):
        run = tmp_path / str(count)
        buffer, rng = new(100, 2), np.random.default_rng(0)
        checkpoints = CheckpointStore(run)
        replay = ReplayStore(checkpoints.replay_folder, transitions=20)
        fill(buffer, 33, rng)
        checkpoints.save(66, Components(), tuple(replay.save(buffer, 33)))
        old = new(100, 2)
        old.__dict__.update({field: getattr(buffer, field).copy() for field in FIELDS}, pos=33)
        fill(buffer, 60, rng)

        def work(run: Path = run, count: int = count, buffer: ReplayBuffer = buffer) -> None:
            kill_at_operation(run, count)
            checkpoints.save(186, Components(), tuple(replay.save(buffer, 93)))  # noqa: B023  the child runs at once

        status = forked(work)
        found = checkpoints.latest_valid()
        assert found is not None
        again = new(100, 2)
        ReplayStore(checkpoints.replay_folder, transitions=20).load(again, found.segments, found.step // 2)
        assert_equal(again, buffer if found.step == 186 else old)
        if status == 0:
            break
    assert found.step == 186
    assert count > 15


def test_a_buffer_that_something_else_filled_is_refused() -> None:
    buffer = new(10, 1)
    fill(buffer, 3, np.random.default_rng(0))
    with pytest.raises(TrainingError, match="other code has filled it"):
        check_replay(buffer, 5)
