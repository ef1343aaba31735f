"""A batch on several threads. That they change no bits is in test_batch.py."""

from __future__ import annotations

import gc
import os
import threading

import numpy as np
import pytest

from auvbench.envs import sharded, team
from auvbench.envs.batch import Batch
from auvbench.envs.team import TeamBatch
from auvbench.errors import TrainingError
from tests import configs
from tests.waiting import until


def configuration(threads: int, *overrides: str):
    return configs.training(f"simulator.threads={threads}", *overrides)


def actions(n: int) -> np.ndarray:
    return np.random.default_rng(3).uniform(-2, 2, (n, 6))


def test_threads_serve_batches_for_which_they_pay():
    assert type(sharded.make_batch(configuration(1), 64)) is Batch
    assert type(sharded.make_batch(configuration(2), 63)) is Batch
    assert type(sharded.make_batch(configuration(2), 64)) is TeamBatch
    assert type(sharded.make_batch(configuration(2, "disturbance=calm"), 64)) is Batch
    assert type(sharded.make_batch(configuration(2, "disturbance=calm"), 1024)) is sharded.ShardedBatch


def test_a_worker_that_fell_asleep_is_woken(monkeypatch):
    monkeypatch.setattr(team, "PATIENCE", 1)
    one, three = Batch(configuration(1), 50), TeamBatch(configuration(3), 50)
    one.reset(), three.reset()
    for number in range(60):
        got, expected = three.step(actions(50)), one.step(actions(50))
        np.testing.assert_array_equal(got.observation, expected.observation)
        if number % 20 == 0:
            until(lambda: not any(awake.is_set() for awake in three._team._awake))


def test_the_threads_go_with_the_batch():
    before = set(threading.enumerate())

    def new():
        return set(threading.enumerate()) - before

    batch = TeamBatch(configuration(3), 50)
    batch.reset()
    batch.step(actions(50))
    assert len(new()) == 2
    batch.load_state_dict(batch.state_dict())  # the next step makes another team
    until(lambda: not new())
    batch.reset()
    batch.step(actions(50))
    del batch
    gc.collect()
    until(lambda: not new())


def test_another_seed_reaches_the_threads():
    one, two = Batch(configuration(1), 40, seed=1), TeamBatch(configuration(2), 40, seed=1)
    for batch in (one, two):
        batch.reset()
        batch.step(actions(40))
        batch.reseed(2)
        batch.reset()
    np.testing.assert_array_equal(one.step(actions(40)).observation, two.step(actions(40)).observation)


def test_of_several_broken_environments_the_first_is_named():
    batch = TeamBatch(configuration(2), 64)
    batch.reset()
    batch.simulator.pose[[5, 60], 0] = np.nan
    with pytest.raises(TrainingError, match="environment 5 is not finite"):
        batch.step(actions(64))


@pytest.mark.filterwarnings("ignore:This process .* is multi-threaded:DeprecationWarning")
def test_a_forked_process_says_that_its_threads_are_gone():
    batch = TeamBatch(configuration(2), 40)
    batch.reset()
    batch.step(actions(40))
    child = os.fork()
    if child == 0:
        try:
            batch.step(actions(40))
        except RuntimeError:
            os._exit(3)
        os._exit(0)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 3
