"""What auvbench asks of agents and tasks."""

import pytest

from auvbench.testing import check_agent, check_task


@pytest.mark.parametrize("typed", ["algo=pursuit", "algo=search algo.n_envs=4 algo.horizon=20"])
def test_it_keeps_its_contract(typed):
    check_agent(*typed.split())


@pytest.mark.parametrize("typed", ["task=circling", "task=station_keeping reward=view"])
def test_the_task_keeps_its_contract(typed):
    check_task(*typed.split(), "vehicle=bluerov2_heavy")
