"""What auvbench asks of agents, tasks, blocks and disturbances."""

import pytest

from auvbench.testing import check_agent, check_block, check_disturbance, check_task


@pytest.mark.parametrize("typed", ["algo=pursuit", "algo=search algo.n_envs=4 algo.horizon=20"])
def test_it_keeps_its_contract(typed):
    check_agent(*typed.split())


@pytest.mark.parametrize("typed", ["task=circling", "task=station_keeping reward=view"])
def test_the_task_keeps_its_contract(typed):
    check_task(*typed.split(), "vehicle=bluerov2_heavy")


def test_the_block_keeps_its_contract():
    check_block("task.observation=[position_error,doppler]")


def test_the_disturbance_keeps_its_contract():
    check_disturbance("disturbance=surge", "noise=none")
