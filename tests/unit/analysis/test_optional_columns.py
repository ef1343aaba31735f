"""Columns on request: interquartile mean, optimality gap, the next training, areas under validation curves."""

from __future__ import annotations

import doctest

import numpy as np
import pytest

from auvbench.statistics import aggregate as st


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
