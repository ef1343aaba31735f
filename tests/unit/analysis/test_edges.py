"""Small, empty and extreme tables: everything is said or marked as unknown, nothing breaks or warns."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from auvbench.analysis import claims as study
from auvbench.analysis.findings import find
from auvbench.analysis.measures import to_rank_by
from auvbench.analysis.primary import VERDICTS, headline
from auvbench.analysis.ranking import rank
from auvbench.errors import ReportError
from tests.unit.analysis.agents import agent


def made(algo, k, seeds, episodes, outcome, **metrics):
    one = agent(algo, k, 25, seeds=seeds, episodes=episodes)
    outcome = np.full((seeds, episodes), outcome, dtype=np.int8) if np.isscalar(outcome) else outcome
    changed = {**one.metrics, **{name: np.full((seeds, episodes), value) for name, value in metrics.items()}}
    time = np.where(outcome == 0, changed["steps"] / 10, np.nan)
    return replace(one, outcome=outcome, metrics={**changed, "time_to_goal_s": time})


def tables():
    rng = np.random.default_rng(0)
    for episodes in (1, 2, 30):
        for seeds in ((1, 1, 1), (3, 3, 3), (1, 2, 3)):
            for outcomes in ((0, 0, 0), (2, 2, 2), (0, 1, 2), None):
                given = outcomes or [rng.integers(0, 3, (s, episodes)).astype(np.int8) for s in seeds]
                yield [
                    made("sac", i + 1.0, s, episodes, o)
                    for i, (s, o) in enumerate(zip(seeds, given, strict=True))
                ]
    for value in (np.nan, 7.0):
        yield [made("sac", k, 2, 20, 0, **{"return": value}) for k in (1.0, 40.0)]
    mixed = [made("sac", k, 3, 20, 0) for k in (1.0, 40.0, 100.0, 7.0)]
    yield [*mixed, made("ppo", 1.0, 3, 20, 2, **{"return": np.nan})]


@pytest.mark.parametrize(
    "rank_by", ["success_rate", "collision_rate", "mean_steps", "mean_return", "mean_time_to_goal_s"]
)
def test_nothing_breaks(rank_by):
    for agents in tables():
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            options = {"rank_by": rank_by, "baseline": agents[0].label}
            if not any(np.isfinite(to_rank_by(rank_by).values(a)).any() for a in agents):
                with pytest.raises(ReportError, match="no agent has values"):
                    rank(agents, **options)
                continue
            ranking = rank(agents, **options)
            findings = find(ranking, agents)
            claims = study.judge([], agents)
        for row in ranking.rows:
            assert 1 <= row.rank_interval[0] <= row.rank <= row.rank_interval[1] <= len(agents)
            for name, e in row.estimates.items():
                if np.isfinite(e.value) and np.isfinite(e.low):
                    assert e.low - 1e-9 <= e.value <= e.high + 1e-9, (name, e)
                if name.endswith("_rate"):
                    # Several seeds on one episode: nobody knows how much episodes differ.
                    assert 0 <= e.low <= e.high <= 1 or (
                        row.episodes == 1 and np.isnan([e.low, e.high]).all()
                    )
        for c in ranking.comparisons:
            assert np.isnan(c.p_value) or 0 <= c.p_value <= c.p_adjusted <= 1
        for finding in findings:
            assert "nan" not in finding.text + finding.basis
        assert "nan" not in headline(ranking)
        for against in ranking.primary.comparisons if ranking.primary else ():
            assert against.verdict in VERDICTS
        assert len(claims) == 7


def test_scale_and_shift_do_not_matter():
    agents = [agent("sac", k, 25, level=1 - k / 100) for k in (1.0, 40.0, 100.0)]
    moved = [replace(a, metrics={**a.metrics, "return": 1e3 * a.metrics["return"] + 5e4}) for a in agents]
    one, other = rank(agents, rank_by="mean_return"), rank(moved, rank_by="mean_return")
    assert [row.label for row in one.rows] == [row.label for row in other.rows]
    for a, b in zip(one.comparisons, other.comparisons, strict=True):
        assert b.p_value == pytest.approx(a.p_value, rel=1e-5)
        assert b.difference.low == pytest.approx(1e3 * a.difference.low, rel=1e-6)
