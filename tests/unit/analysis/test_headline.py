"""The answer in one sentence: the furthest ahead, and how many agents have which verdict."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from auvbench.analysis.primary import headline
from auvbench.analysis.ranking import rank
from auvbench.analysis.records import Against, Primary, Ranking
from auvbench.statistics import Estimate
from auvbench.statistics.reliability import Reliability
from tests.unit.analysis.agents import agent


def ranking_with(rank_by: str, *verdicts: tuple[str, float], margin: float = 11.0) -> Ranking:
    """A ranking whose comparisons have these verdicts and differences."""
    ranking = rank([agent("sac"), agent("pid", seeds=1)], rank_by=rank_by)
    found = tuple(
        Against(f"A{i}", Estimate(value, value - 1, value + 1), verdict)
        for i, (verdict, value) in enumerate(verdicts)
    )
    return replace(ranking, primary=Primary(rank_by, "PID", margin, 0.95, found))


def test_who_is_ahead_and_how_many_are_not() -> None:
    verdicts = [
        ("ahead", -10.0),
        ("ahead", -28.0),
        ("equivalent", 1.0),
        *[("behind", 50.0)] * 3,
        ("open", 4.0),
    ]
    assert headline(ranking_with("par1_steps", *verdicts)) == (
        "A1 reaches waypoints 28.0 steps sooner than PID [27.0, 29.0]; 1 agent is also ahead, 1 is equivalent to PID "
        "within 11 steps, 3 are behind, 1 is open."
    )


def test_a_controller_ahead_of_a_learner() -> None:
    ranking = rank([agent("sac"), agent("pid", seeds=1)], rank_by="par1_steps")
    sac, pid = (
        next(row.label for row in ranking.rows if row.trained is trained) for trained in (True, False)
    )
    none = Reliability(0, 8, 0.0, 0.31, 0.9, None)
    against = Against(
        pid, Estimate(-28.0, -29.0, -27.0), "ahead", trainings=8, enough=6, reliability=none, of_baseline=True
    )
    primary = Primary("par1_steps", sac, 11.0, 0.95, (against,))
    assert headline(replace(ranking, primary=primary)) == (
        f"{pid} reaches waypoints 28.0 steps sooner than the typical training of {sac} [27.0, 29.0], and 8 of 8 trainings "
        f"of {sac} are behind."
    )


def test_nobody_ahead() -> None:
    text = headline(ranking_with("success_rate", ("behind", -0.5), ("behind", -0.2), margin=0.02))
    assert text == "No agent is ahead of PID in success rate; 2 agents are behind."


@pytest.mark.parametrize(
    ("rank_by", "value", "words"),
    [
        ("success_rate", 0.1, "A0 reaches 10 points more of the waypoints than PID [-90, 110]."),
        ("par1_time_s", -2.0, "A0 reaches waypoints 2.0 s sooner than PID [1.0, 3.0]."),
        ("mean_deviation_mean_m", -2.0, "A0 is ahead of PID by 2.0 m in deviation [1.0, 3.0]."),
    ],
)
def test_words_follow_the_measure(rank_by: str, value: float, words: str) -> None:
    known = "par1_steps" if rank_by == "par1_time_s" else rank_by  # these agents have no times
    ranking = replace(ranking_with(known, ("ahead", value)), rank_by=rank_by)
    assert headline(ranking) == words


def test_other_tasks_have_no_waypoints() -> None:
    ranking = replace(ranking_with("par1_steps", ("ahead", -2.0)), task="docking")
    assert headline(ranking) == "A0 is ahead of PID by 2.0 steps in PAR-1 steps [1.0, 3.0]."


def test_a_table_of_one_agent() -> None:
    assert headline(rank([agent("sac")])).startswith("SAC K=1 25 Hz is the only agent: success rate ")


def test_trainings_that_are_not_compared() -> None:
    text = headline(rank([agent("sac", seeds=1), agent("ppo", seeds=1)]))
    assert text == "None of 2 agents is compared: each has one training seed."


def test_too_few_trainings_for_any_comparison() -> None:
    ranking = ranking_with("success_rate", ("open", -0.1))
    assert ranking.primary is not None
    (only,) = ranking.primary.comparisons
    nothing = replace(only, difference=replace(only.difference, low=math.nan, high=math.nan))
    text = headline(replace(ranking, primary=replace(ranking.primary, comparisons=(nothing,))))
    assert text == "No agent can be compared with PID: a verdict needs at least 5 trainings of each learner."


def test_the_headline_counts_verdicts_from_few_trainings() -> None:
    ranking = ranking_with("success_rate", ("behind", -0.5), margin=0.02)
    assert ranking.primary is not None
    few = tuple(replace(c, trainings=5, enough=8) for c in ranking.primary.comparisons)
    text = headline(replace(ranking, primary=replace(ranking.primary, comparisons=few)))
    assert text.endswith("1 agent is behind (1 from few trainings, marked *).")
