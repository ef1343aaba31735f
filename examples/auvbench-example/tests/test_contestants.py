"""What auvbench asks of everybody's contestants."""

import pytest

from auvbench.testing import check_agent


@pytest.mark.parametrize("typed", ["algo=pursuit", "algo=search algo.n_envs=4 algo.horizon=20"])
def test_it_keeps_its_contract(typed):
    check_agent(*typed.split())
