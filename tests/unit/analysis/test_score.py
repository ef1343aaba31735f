"""The score across tasks against a computation by hand, and what it does where something is missing."""

from __future__ import annotations

import math
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest

from auvbench.analysis import score as st
from auvbench.analysis.measures import measure
from auvbench.analysis.records import NO_POLICY, Agent
from auvbench.analysis.score import OneTask, Scored, Scores, scores
from tests import plain_statistics as plain
from tests.unit.analysis.agents import record

ERROR = "mean_position_error_rms_m"
ADD = {"random": "add random.", "pid": "add PID."}


def agent(algo: str, level: float, *, seeds: int = 1, task: str = "", higher: bool = False) -> Agent:
    """Errors around a level, or success at this rate, in 40 episodes; runs are of the task."""
    rng = np.random.default_rng([zlib.crc32(f"{algo}{task}".encode()), seeds])
    of_seed = rng.normal(0, 0.1, (seeds, 1)) if seeds > 1 else np.zeros((1, 1))
    if higher:
        outcome = np.where(rng.random((seeds, 40)) < level + of_seed, 0, 2).astype(np.int8)
        errors = np.ones((seeds, 40))
    else:
        outcome = np.zeros((seeds, 40), dtype=np.int8)
        errors = np.abs(level + of_seed + rng.normal(0, 0.2, (seeds, 40)))
    runs = tuple(replace(record(algo, 1.0, 10.0, s), id=f"{algo}-{task}-{s}") for s in range(seeds))
    metrics = {"position_error_rms_m": errors}
    key = {"algo": algo, "reward.k": 1.0}
    return Agent(algo.upper(), key, runs, "0" * 16, outcome, metrics, step_limit=1000.0)


def of_task(title: str, *agents: Agent, by: str = ERROR) -> OneTask:
    return OneTask(title, measure(by), {"nominal": agents}, ADD)


def three(*, without: str = "") -> list[OneTask]:
    """Two tasks of errors and one of success, with a good and a bad learner."""
    found = []
    for title, scale in (("station", 1.0), ("curve", 3.0)):
        agents = [agent("pid", 0.2 * scale, task=title), agent("random", 4.0 * scale, task=title)]
        agents += [
            agent("ppo", 0.6 * scale, seeds=3, task=title),
            agent("sac", 5.0 * scale, seeds=3, task=title),
        ]
        found.append(of_task(title, *agents))
    goal = [agent("pid", 0.95, task="goal", higher=True), agent("random", 0.05, task="goal", higher=True)]
    goal += [
        agent("ppo", 0.8, seeds=3, task="goal", higher=True),
        agent("sac", 0.5, seeds=3, task="goal", higher=True),
    ]
    found.append(of_task("goal", *goal, by="success_rate"))
    return [
        replace(
            t, conditions={c: [a for a in of if a.key["algo"] != without] for c, of in t.conditions.items()}
        )
        for t in found
    ]


def by_label(found: Scores | None) -> Mapping[str, Scored]:
    assert found is not None
    return {row.label: row for row in found.rows}


def strata(tasks: Sequence[OneTask], algo: str) -> list[list[list[float]]]:
    """By task, the scores of each seed as a list of one condition."""
    result = []
    for task in tasks:
        values = {
            str(a.key["algo"]): (a.outcome == 0).astype(float)
            if task.title == "goal"
            else a.metrics["position_error_rms_m"]
            for a in task.conditions["nominal"]
        }
        zero, one = float(values["random"].mean()), float(values["pid"].mean())
        result.append([[x] for x in plain.score(values[algo], zero, one)])
    return result


def test_scores_and_intervals_agree_with_a_computation_by_hand() -> None:
    tasks = three()
    row = by_label(scores(tasks, "test", 0.9, seed=7))["PPO"]
    mine = strata(tasks, "ppo")
    assert row.tasks == pytest.approx([np.mean(part) for part in mine], abs=1e-12)
    flat = [value for part in mine for seed in part for value in seed]
    assert row.score.value == pytest.approx(plain.interquartile_mean(flat), abs=1e-12)
    rng = np.random.default_rng([7, zlib.crc32(" ".join(row.run_ids).encode())])
    picks = [rng.integers(3, size=(2000, 2)) for _ in tasks]
    ends = plain.bootstrap(mine, picks, 0.05)
    assert (row.score.low, row.score.high) == pytest.approx(ends, abs=1e-12)
    assert row.score.low < row.score.value < row.score.high


def test_random_is_0_and_pid_is_1_and_worse_than_random_is_below() -> None:
    rows = by_label(scores(three(), "test", 0.95))
    assert rows["random"].score.value == 0.0
    assert rows["PID"].score.value == 1.0
    assert rows["SAC"].tasks[0] < 0.0 < rows["SAC"].tasks[2]
    assert math.isnan(rows["PID"].score.low), "nothing is trained"


def test_no_other_row_changes_a_score() -> None:
    whole, fewer = scores(three(), "test", 0.95), scores(three(without="sac"), "test", 0.95)
    assert "SAC" not in by_label(fewer)
    for label, row in by_label(fewer).items():
        assert by_label(whole)[label].score == row.score or label in ("PID", "random")
        assert by_label(whole)[label].tasks == row.tasks


def test_one_task_has_no_score_across_tasks() -> None:
    assert scores(three()[:1], "test", 0.95) is None


@pytest.mark.parametrize("lost", ["pid", "random"])
def test_without_pid_or_random_a_line_says_what_to_add(lost: str) -> None:
    tasks = three()
    tasks[1] = three(without=lost)[1]
    found = scores(tasks, "test", 0.95)
    assert found is not None
    assert found.rows == ()
    (line,) = found.notes
    assert "curve" in line
    assert line.endswith(ADD[lost])


def test_an_agent_that_is_missing_on_a_task_has_no_score_across_tasks() -> None:
    tasks = three()
    tasks[2] = three(without="sac")[2]
    found = scores(tasks, "test", 0.95)
    row = by_label(found)["SAC"]
    assert math.isnan(row.score.value)
    assert row.trainings == (3, 3, 0)
    assert row.tasks[0] == by_label(scores(three(), "test", 0.95))["SAC"].tasks[0]
    assert found is not None
    assert found.rows[-1] is row
    assert any("SAC" in note for note in found.notes)
    assert by_label(found)["PPO"].score == by_label(scores(three(), "test", 0.95))["PPO"].score


def test_a_training_that_failed_scores_as_random() -> None:
    tasks = three()
    ppo = tasks[0].conditions["nominal"][2]
    outcome, errors = ppo.outcome.copy(), ppo.metrics["position_error_rms_m"].copy()
    outcome[1], errors[1] = NO_POLICY, np.nan
    failed = replace(ppo, outcome=outcome, metrics={"position_error_rms_m": errors})
    agents = [*tasks[0].conditions["nominal"][:2], failed]
    before = strata(tasks, "ppo")[0]
    rows = by_label(scores([of_task("station", *agents), tasks[1]], "test", 0.95))
    assert rows["PPO"].tasks[0] == pytest.approx((before[0][0] + before[2][0]) / 3, abs=1e-12)


def test_a_condition_under_which_pid_is_no_better_than_random_is_left_out() -> None:
    tasks = three()
    lost = [
        replace(a, metrics={"position_error_rms_m": np.full(a.outcome.shape, 10.0)})
        for a in tasks[0].conditions["nominal"]
    ]
    with_lost = replace(tasks[0], conditions={**tasks[0].conditions, "storm": lost})
    found, usual = scores([with_lost, *tasks[1:]], "suite", 0.95), scores(tasks, "suite", 0.95)
    assert found is not None
    assert found.cells == 3
    assert by_label(found)["PPO"].score == by_label(usual)["PPO"].score
    assert any("storm" in note for note in found.notes)


def test_conditions_weigh_alike() -> None:
    tasks = three()
    rough = [
        replace(a, metrics={"position_error_rms_m": a.metrics["position_error_rms_m"] * 2})
        for a in tasks[0].conditions["nominal"]
    ]
    rough[2] = replace(
        rough[2],
        metrics={"position_error_rms_m": rough[1].metrics["position_error_rms_m"].mean() * np.ones((3, 40))},
    )
    both = replace(tasks[0], conditions={**tasks[0].conditions, "rough": rough})
    row = by_label(scores([both, tasks[1]], "suite", 0.95))["PPO"]
    alone = by_label(scores(tasks, "suite", 0.95))["PPO"]
    assert row.tasks[0] == pytest.approx(alone.tasks[0] / 2, abs=1e-12)


def test_the_interquartile_mean_cuts_a_quarter_at_either_end() -> None:
    values = np.array([0.0, 1.0, 0.5, 0.6, 0.7, 0.8, 1.0, 1.0])
    assert st.interquartile(values) == pytest.approx(np.mean(sorted(values)[2:6]))


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
