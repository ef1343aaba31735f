"""Names that an analysis gives to agents."""

from __future__ import annotations

from dataclasses import replace

import pytest

from auvbench.analysis.names import name_agents, with_names
from auvbench.errors import ReportError
from tests.unit.analysis.agents import agent

NAMES = {"slow PPO": "algo=ppo reward.k=40", "PPO": "algo=ppo", "others": "algo!=ppo reward.k=null"}
PPO = agent("ppo", seeds=1).runs[0]


def run(**config: object) -> object:
    return replace(PPO, config={key.replace("_", "."): value for key, value in config.items()})


def test_the_first_name_that_fits_a_run_is_that_of_its_agent() -> None:
    runs = [run(algo_name="ppo", reward_k=40.0), run(algo_name="ppo", reward_k=1.0), run(algo_name="pid")]
    assert [named.name for named in name_agents(runs, NAMES)] == ["slow PPO", "PPO", "others"]  # type: ignore[arg-type]


def test_runs_without_a_name_keep_the_label() -> None:
    named, other = replace(PPO, name="mine"), PPO
    assert with_names(["A", "B", "C"], [[named, named], [named, other], [other]]) == ["mine", "B", "C"]


def test_a_name_that_fits_two_agents_is_refused() -> None:
    with pytest.raises(ReportError, match="names: mine fits A and B; add a term"):
        with_names(["A", "B"], [[replace(PPO, name="mine")]] * 2)


def test_a_malformed_term_is_refused() -> None:
    with pytest.raises(ReportError, match="names: mine: algo: must be KEY=VALUE"):
        name_agents([PPO], {"mine": "algo"})
