"""Agents beside the limit: time over best known, who was quicker than what was computed, and where there is no limit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from auvbench import statistics as st
from auvbench.analysis import optional_columns
from auvbench.analysis.optional_columns import with_columns
from auvbench.analysis.ranking import rank
from auvbench.analysis.records import Agent, Ranking, RunRecord
from auvbench.analysis.sources import RunFolder
from auvbench.evaluation.bounds import files
from auvbench.reporting import tables
from auvbench.statistics import crossed
from tests.unit.analysis.agents import agent

EPISODES = 30
FREQUENCY = 10.0


def timed(name: str, root: Path, factor: float, seeds: int = 2) -> Agent:
    """An agent that takes `factor` times the limit wherever it succeeds, and some more in its second seed."""
    found = agent(name, seeds=seeds, episodes=EPISODES)
    runs = tuple(
        RunRecord(
            run.id,
            RunFolder(root / "outputs" / "experiment" / run.id),
            run.state,
            run.seed,
            {**run.config, "vehicle.name": "bluerov2"},
            run.manifest,
        )
        for run in found.runs
    )
    steps = np.tile(best() * factor, (seeds, 1))
    steps[1:] += 2
    time = np.where(found.success > 0, steps / FREQUENCY, np.nan)
    return replace(found, runs=runs, metrics={**found.metrics, "steps": steps, "time_to_goal_s": time})


def best() -> np.ndarray:
    return np.arange(EPISODES) * 10.0 + 50.0


def write(root: Path, fingerprint: str = "0123456789abcdef", protocol: str = "test") -> None:
    bounds = tuple(
        files.Bound(
            "nominal",
            FREQUENCY,
            episode,
            steps,
            steps // 2,
            "pid",
            files.packed(np.zeros((steps, 6), dtype=np.int8)),
        )
        for episode, steps in enumerate(best().astype(int).tolist())
    )
    limits = files.Limits(
        files.Summary(protocol, "bluerov2", fingerprint, {"scenarios": "a", "outcomes": "b"}, []), bounds
    )
    files.write(root / "outputs" / "bounds" / f"{protocol}-bluerov2", limits)


def ranked(agents: list[Agent], protocol: str = "test") -> Ranking:
    return optional_columns.add_optimality(rank(agents, protocol=protocol), agents)


def test_the_ratio_is_a_geometric_mean_over_successes(tmp_path: Path) -> None:
    write(tmp_path)
    agents = [timed("sac", tmp_path, 1.5), timed("ppo", tmp_path, 2.0)]
    ranking = ranked(agents)
    assert ranking.limit is not None
    assert ranking.limit.seconds == pytest.approx(best().mean() / FREQUENCY)
    assert ranking.limit.gap == pytest.approx(2.0)
    for one in agents:
        ratios = one.metrics["time_to_goal_s"] * FREQUENCY / best()
        expected = np.exp(np.nanmean(np.log(ratios)))
        row = next(row for row in ranking.rows if row.label == one.label)
        found = row.estimates[optional_columns.OVER_BEST_KNOWN]
        assert found.value == pytest.approx(expected)
        assert 1.0 <= found.low <= found.value <= found.high


def test_the_interval_does_not_reach_below_the_limit(tmp_path: Path) -> None:
    """Two seeds that differ: by Student's t alone it would reach far below 1, where no agent of the table can be."""
    write(tmp_path)
    quick, slow = timed("sac", tmp_path, 1.0), timed("ppo", tmp_path, 1.01)
    slow.metrics["time_to_goal_s"][1] *= 1.3
    ranking = ranked([quick, slow])
    row = next(row for row in ranking.rows if row.label == slow.label)
    found = row.estimates[optional_columns.OVER_BEST_KNOWN]
    logs = np.log(slow.metrics["time_to_goal_s"] * FREQUENCY / best())
    free = st.means(crossed([logs], paired=False), 0.95)[0]
    assert np.exp(free.low) < 0.9, "otherwise this shows nothing"
    assert found.low == 1.0
    assert found.high == pytest.approx(np.exp(free.high))


def test_a_table_has_the_column_where_it_is_asked_for_and_the_csv_always(tmp_path: Path) -> None:
    write(tmp_path)
    agents = [timed("sac", tmp_path, 1.5)]
    ranking = ranked(agents)
    assert "time over best known" not in tables.markdown(ranking)
    assert "time_over_best_known,time_over_best_known_low" in tables.csv(ranking)
    text = tables.markdown(with_columns(ranking, agents, [optional_columns.OVER_BEST_KNOWN]))
    assert "time over best known" in text
    assert "Best known: " in text
    assert [row.label for row in ranking.rows] == [agents[0].label], "the limit has no row"


def test_an_agent_that_was_quicker_than_what_was_computed_sets_the_limit(tmp_path: Path) -> None:
    write(tmp_path)
    agents = [timed("sac", tmp_path, 0.9), timed("ppo", tmp_path, 2.0)]
    ranking = ranked(agents)
    assert ranking.limit is not None
    assert ranking.limit.seconds < best().mean() / FREQUENCY
    assert all(row.estimates[optional_columns.OVER_BEST_KNOWN].value >= 1.0 for row in ranking.rows)


def test_limits_of_other_scenarios_are_not_used_and_the_command_is_named(tmp_path: Path) -> None:
    write(tmp_path, fingerprint="f" * 16)
    agents = [timed("sac", tmp_path, 1.5)]
    ranking = ranked(agents)
    assert ranking.limit is None
    assert "auvbench bound protocol=test vehicle=bluerov2 computes it" in ranking.no_limit
    assert "of other scenarios" in ranking.no_limit
    assert optional_columns.OVER_BEST_KNOWN not in ranking.rows[0].estimates
    assert ranking.no_limit in tables.markdown(
        with_columns(ranking, agents, [optional_columns.OVER_BEST_KNOWN])
    ).replace("\\", "")


def test_names_that_lead_elsewhere_find_nothing(tmp_path: Path) -> None:
    assert ranked([timed("sac", tmp_path, 1.5)], protocol="../test").limit is None


def test_an_agent_without_success_has_no_ratio(tmp_path: Path) -> None:
    write(tmp_path)
    never = timed("ppo", tmp_path, 1.5)
    never = replace(
        never,
        outcome=np.full_like(never.outcome, 2),
        metrics={**never.metrics, "time_to_goal_s": np.full(never.outcome.shape, np.nan)},
    )
    ranking = ranked([never, timed("sac", tmp_path, 1.5)])
    row = next(row for row in ranking.rows if row.label == never.label)
    assert optional_columns.OVER_BEST_KNOWN not in row.estimates
