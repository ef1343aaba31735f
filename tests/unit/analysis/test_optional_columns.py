"""Columns on request: interquartile mean, optimality gap, the next training, areas under validation curves."""

from __future__ import annotations

import doctest
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from auvbench.analysis import optional_columns
from auvbench.analysis.optional_columns import with_columns
from auvbench.analysis.ranking import rank
from auvbench.analysis.records import Agent
from auvbench.analysis.validation_curve import read_validation_curve
from auvbench.errors import ReportError
from auvbench.reporting.tables import markdown
from auvbench.statistics import aggregate as st
from tests.unit.analysis.agents import agent

HEADER = "step,simulated_s,training_episodes,fingerprint,episodes,success_rate,wall_s\n"


def test_examples() -> None:
    assert doctest.testmod(st).failed == 0


def test_interquartile_mean_and_gap() -> None:
    scores = np.array([[0.0, 1.0], [0.5, 0.6], [0.7, 0.8], [1.0, 1.0]])
    assert st.interquartile(scores.ravel()) == pytest.approx(np.mean(sorted(scores.ravel())[2:6]))
    assert st.optimality_gap(scores.ravel()) == pytest.approx(1 - scores.mean())
    assert st.optimality_gap(scores.ravel(), 0.75) == pytest.approx(0.75 - np.minimum(scores, 0.75).mean())


def test_the_stratified_interval_draws_seeds_stratum_by_stratum() -> None:
    rng = np.random.default_rng(0)
    scores = rng.random((10, 3))
    vehicles = [scores[:, [i]] for i in range(3)]
    found = st.stratified(vehicles, lambda x: x.mean(axis=-1), rng=rng, resamples=4000)
    error = np.sqrt((scores.var(axis=0, ddof=1) / 10).sum()) / 3
    assert found.high - found.low == pytest.approx(2 * 1.96 * error, rel=0.1)
    assert np.isnan(st.stratified([scores[:1]], st.interquartile, rng=rng).low)
    assert np.isnan(st.stratified([scores, scores[:1]], st.interquartile, rng=rng).low)


def test_one_training_s_luck_under_all_conditions_is_one_draw() -> None:
    """Ten policies whose success differs, and is the same under twelve conditions: as uncertain as under one."""
    rng = np.random.default_rng(1)
    luck = rng.random((10, 1))
    twelve = st.stratified([np.repeat(luck, 12, axis=1)], lambda x: x.mean(axis=-1), rng=rng, resamples=4000)
    error = luck.std(ddof=1) / np.sqrt(10)
    assert twelve.high - twelve.low == pytest.approx(2 * 1.96 * error, rel=0.1)


@pytest.mark.parametrize("n", [3, 5, 10])
def test_nine_of_ten_trainings_lie_in_a_tolerance_interval_as_often_as_it_says(n: int) -> None:
    from scipy.stats import norm

    rng = np.random.default_rng(n)
    held = 0
    for _ in range(1500):
        e = st.tolerance(rng.normal(size=n))
        held += norm.cdf(e.high) - norm.cdf(e.low) >= 0.9
    assert held / 1500 == pytest.approx(0.95, abs=0.02)


def test_a_rate_s_tolerance_stays_within_0_and_1() -> None:
    e = st.tolerance(np.array([1.0, 0.99, 1.0]), episodes=200)
    assert 0 <= e.low < 0.99
    assert e.high <= 1
    assert np.isnan(st.tolerance(np.array([0.9]), episodes=200).low)


def with_curves(folder: Path, one: Agent, rows: list[list[float]]) -> Agent:
    runs = []
    for i, run in enumerate(one.runs):
        directory = folder / run.id
        (directory / "train").mkdir(parents=True)
        lines = [f"{step},{step / 10},{step // 100},abc,100,{rate},{step / 1000}" for step, rate in rows[i]]
        (directory / "train" / "validation.csv").write_text(HEADER + "\n".join(lines) + "\n")
        runs.append(replace(run, directory=directory))
    return replace(one, runs=tuple(runs))


def test_the_area_under_a_validation_curve(tmp_path: Path) -> None:
    one = with_curves(tmp_path, agent("sac", seeds=2), [[(100, 0.5), (200, 1.0)], [(100, 0.0), (200, 0.0)]])
    curve = read_validation_curve(one.runs[0])
    assert curve is not None
    assert curve.area() == pytest.approx((0.5 * 100 * 0.5 + 0.75 * 100) / 200)
    assert curve.area("wall_s") == pytest.approx(curve.area())
    ranking = with_columns(rank([one]), [one], ["auc_steps"])
    assert ranking.rows[0].estimates["auc_steps"].value == pytest.approx(0.25)
    assert "AUC over steps (%)" in markdown(ranking)
    assert "as a share of success throughout" in markdown(ranking)


def test_without_curves_there_is_no_area(tmp_path: Path) -> None:
    one = agent("sac")
    assert "auc_steps" not in with_columns(rank([one]), [one], ["auc_steps"]).rows[0].estimates
    bad = with_curves(tmp_path, agent("ppo", seeds=2), [[(200, 0.5), (100, 1.0)], [(100, 0.0)]])
    ranking = with_columns(rank([bad]), [bad], ["auc_steps"])
    assert any("rows that do not belong together" in p.message for p in ranking.problems)


def test_columns_that_there_are() -> None:
    one, pid = agent("sac"), agent("pid", seeds=1)
    ranking = with_columns(rank([one, pid]), [one, pid], ["next_training"])
    rows = {row.label: row for row in ranking.rows}
    assert rows[one.label].estimates["next_training"].covers == "the next training"
    assert "next_training" not in rows[pid.label].estimates, "there is nothing to train"
    assert "holds at least 90 % of all trainings" in markdown(ranking)
    with pytest.raises(
        ReportError, match="--columns 'iqm_succes' is not a column; did you mean 'iqm_success'"
    ):
        optional_columns.validate_columns(["iqm_succes"])
