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
from auvbench.analysis.score import Cell, OneTask, Scored, Scores, scores
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


def values_of(task: OneTask) -> dict[str, np.ndarray]:
    """By algorithm, the values (seeds, scenarios) of a task."""
    return {
        str(a.key["algo"]): (a.outcome == 0).astype(float)
        if task.title == "goal"
        else a.metrics["position_error_rms_m"]
        for a in task.conditions["nominal"]
    }


def strata(tasks: Sequence[OneTask], algo: str) -> list[list[list[float]]]:
    """By task, the scores of each seed as a list of one condition."""
    result = []
    for task in tasks:
        values = values_of(task)
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
    counts, picks, parts = [], [], []
    for task in tasks:
        counts.append(rng.multinomial(40, np.full(40, 1.0 / 40), size=st.RESAMPLES))
        picks.append(rng.integers(3, size=(st.RESAMPLES, 2)))
        values = values_of(task)
        parts.append((values["ppo"], values["random"][0], values["pid"][0]))
    ends = plain.bootstrap(parts, counts, picks, 0.05)
    assert (row.score.low, row.score.high) == pytest.approx(ends, abs=1e-12)
    assert row.score.low < row.score.value < row.score.high


def test_random_is_0_and_pid_is_1_and_worse_than_random_is_below() -> None:
    rows = by_label(scores(three(), "test", 0.95))
    assert rows["random"].score.value == 0.0
    assert rows["PID"].score.value == 1.0
    assert rows["SAC"].tasks[0] < 0.0 < rows["SAC"].tasks[2]
    assert rows["PID"].score.low == rows["PID"].score.high == 1.0, "the scale in every scenario"


def test_rows_are_in_the_order_of_the_score() -> None:
    found = scores(three(), "test", 0.95)
    assert found is not None
    values = [row.score.value for row in found.rows]
    assert values == sorted(values, reverse=True)
    assert [row.label for row in found.rows] != sorted(row.label for row in found.rows)


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


def one_cell(values: np.ndarray, seed: int = 0) -> Cell:
    """Values (S, C, E) of a learner between random at 0 and PID at 1."""
    S, C, E = values.shape
    learner = agent("ppo", 1.0, seeds=S)
    return Cell(learner, values, np.zeros((C, E)), np.ones((C, E)), np.zeros(S, dtype=bool))


def test_the_interval_draws_trainings_and_scenarios() -> None:
    """Its variance is that of trainings and that of scenarios, which more trainings do not remove."""
    rng = np.random.default_rng(0)
    hard = rng.normal(0, 1, 50)
    widths = []
    for S in (10, 200):
        x = rng.normal(0, 0.2, (S, 1, 1)) + hard + np.zeros((S, 1, 50))
        found = st.bootstrapped([one_cell(x)], 0.95, rng, 2000)
        # The middle half of normal values has about 1.09 times the error of their mean.
        error = np.sqrt(1.2 * 0.2**2 / S + hard.var() / 50)
        assert found.high - found.low == pytest.approx(2 * 1.96 * error, rel=0.15)
        widths.append(found.high - found.low)
    assert widths[1] > 0.8 * widths[0]


def test_one_training_has_no_interval() -> None:
    rng = np.random.default_rng(0)
    one, many = one_cell(rng.random((1, 2, 30))), one_cell(rng.random((5, 2, 30)))
    assert np.isnan(st.bootstrapped([one], 0.95, rng).low)
    assert np.isnan(st.bootstrapped([many, one], 0.95, rng).low)


def test_one_training_s_luck_under_all_conditions_is_one_draw() -> None:
    """Ten policies whose success differs, and is the same under twelve conditions: as uncertain as under one."""
    rng = np.random.default_rng(1)
    luck = rng.random((10, 1, 1)) + np.zeros((10, 1, 40))
    widths = []
    for conditions in (1, 12):
        found = st.bootstrapped([one_cell(np.repeat(luck, conditions, axis=1))], 0.95, rng, 2000)
        widths.append(found.high - found.low)
    assert widths[1] == pytest.approx(widths[0], rel=0.12)


def test_every_condition_without_a_scale_is_named() -> None:
    tasks = three()
    flat = [
        replace(a, metrics={"position_error_rms_m": np.full(a.outcome.shape, 10.0)})
        for a in tasks[0].conditions["nominal"]
    ]
    names = [f"current={i}" for i in range(9)]
    lost = replace(tasks[0], conditions={**tasks[0].conditions, **dict.fromkeys(names, flat)})
    found = scores([lost, *tasks[1:]], "suite", 0.95)
    assert found is not None
    assert all(name in " ".join(found.notes) for name in names)
