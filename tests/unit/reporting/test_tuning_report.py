"""The report of a study: its sentences, its table of trials and its figures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import optuna
import pytest
from optuna.study import Study
from optuna.trial import FrozenTrial, TrialState, create_trial

from auvbench.commands.tune import plan_of, split
from auvbench.config.compose import compose
from auvbench.reporting import tuning
from auvbench.statistics.intervals import Estimate
from auvbench.statistics.reliability import Reliability
from auvbench.tuning import search
from auvbench.tuning.folder import Plan, StudyFolder
from auvbench.tuning.outcome import Gain, Outcome
from auvbench.tuning.search import ERROR, Score


def result(objective: float, then: float) -> list[float]:
    return Score(objective, objective, objective - 0.05, 1.0, then).plain()


def trial_of(params: dict[str, object], plan: Plan, *results: list[float], error: str = "") -> FrozenTrial:
    done = len(results) == len(plan.budgets)
    return create_trial(
        state=TrialState.COMPLETE if done else TrialState.PRUNED,
        value=results[-1][0] if done else None,
        params=params,
        distributions={d.key: d.distribution for d in plan.dimensions},
        intermediate_values={plan.budgets[i]: values[0] for i, values in enumerate(results)},
        user_attrs={f"result {plan.budgets[i]}": values for i, values in enumerate(results)}
        | ({ERROR: error} if error else {}),
    )


def study_of(trials: Sequence[FrozenTrial]) -> Study:
    study = optuna.create_study(direction="maximize")
    study.add_trials(trials)
    return study


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    output = tmp_path_factory.mktemp("page")
    words = [
        "algo=ppo",
        "tune.objective=success_rate",
        "algo.n_epochs=interval(2,20)",
        "tune.rungs=[100,300]",
        f"output={output}",
    ]
    words, ranges, fixed = split(words)
    plan, study = plan_of(compose("tune", words), ranges, fixed, "auvbench tune <script>alert(1)</script>")
    trials = []
    for number in range(16):
        params = {d.key: d.ends()[number % len(d.ends())] for d in plan.dimensions}
        params["algo.n_epochs"] = 2 + number
        results = [result(0.5 + 0.01 * number, 900.0), result(0.95 - 0.01 * number, 300.0)]
        trials.append(trial_of(params, plan, *results[: 2 if number < 12 else 1]))
    trials.append(trial_of(params, plan, error="step 3: train/loss became nan"))
    objective = search.objective("success_rate", "par1_steps")
    gains = (
        Gain(
            objective.measure, Estimate(0.95, 0.9, 0.98), Estimate(0.8, 0.7, 0.9), Estimate(0.15, 0.02, 0.28)
        ),
        Gain(objective.then, Estimate(250, 200, 300), Estimate(400, 350, 450), Estimate(-150, -200, -100)),
    )
    return Outcome(plan, study_of(trials), study, gains)


@pytest.mark.slow
def test_the_gain_with_fresh_seeds_comes_before_the_winner_of_the_search(found: Outcome) -> None:
    said = tuning.summary(found)
    assert said[0].count(", better") == 2
    assert "[2, 28]" in said[0]
    assert "PAR-1 steps: 250 steps [200, 300] tuned, 400 steps [350, 450] untuned" in said[0]
    assert "[-200, -100]" in said[0]
    assert "trial 0" in said[1]
    assert "12 done, 1 failed, 4 pruned" in said[2]
    assert f"{12 * 300 + 4 * 100:,} environment steps" in said[2]
    assert said[3].startswith("Importance: algo.n_epochs 79 %, ")
    assert "algo.n_epochs (interval(2,20))" in said[4]


@pytest.mark.parametrize(
    ("low", "high", "verdict"), [(0.02, 0.28, "better"), (-0.28, -0.02, "worse"), (-0.1, 0.2, "not resolved")]
)
def test_a_gain_is_one_where_its_interval_leaves_out_zero(
    found: Outcome, low: float, high: float, verdict: str
) -> None:
    gain = replace(found.gains[0], difference=Estimate((low + high) / 2, low, high))
    assert tuning.verdict(gain) == verdict


def test_a_gain_of_few_fresh_seeds_says_what_it_lacks(found: Outcome) -> None:
    held = Reliability(4, 5, 0.28, 0.99, 0.66, None)
    five = replace(found.gains[0], trainings=5, reliability=held)
    assert tuning.verdict(five) == "better* (4 of 5 tuned trainings are not behind)"
    three = replace(five, trainings=3, difference=Estimate(0.1, math.nan, math.nan))
    assert tuning.verdict(three).startswith("no verdict below 5 fresh seeds")


def test_without_fresh_seeds_nothing_is_called_a_gain(found: Outcome) -> None:
    said = " ".join(tuning.summary(replace(found, gains=())))
    assert "better" not in said.replace("better settings", "")
    assert "Not compared with fresh seeds" in tuning.evidence(replace(found, gains=()))


@pytest.mark.slow
def test_the_report_holds_all_trials_and_their_figures(found: Outcome) -> None:
    path = tuning.report(found)
    rows = path.read_text().splitlines()
    assert len(rows) == 18
    assert "train/loss became nan" in rows[-1]
    assert {file.name for file in (path.parent / "figures").glob("*.png")} == {
        "history.png",
        "slices.png",
        "rungs.png",
    }


def test_a_study_without_a_result_has_a_report_too(found: Outcome, tmp_path: Path) -> None:
    empty = Outcome(found.plan, study_of([]), StudyFolder(tmp_path))
    assert tuning.report(empty).read_text().count("\n") == 1
    assert tuning.summary(empty) == ["0 trials: none."]
    assert not (tmp_path / "report" / "figures").exists()


def test_the_measure_that_tells_trials_apart_is_drawn(found: Outcome) -> None:
    assert tuning.in_units(found)[1] is found.objective.measure
    first = found.trials[0]
    tied = [trial_of(first.params, found.plan, result(0.9, 1.0), result(1.0, 300.0 + i)) for i in range(5)]
    tied.insert(0, trial_of(first.params, found.plan, result(0.4, 1.0), result(0.8, 900.0)))
    # The best among those with the largest budget decide, even where the others differ.
    others = [trial_of(first.params, found.plan, result(0.1 * i, 1.0)) for i in range(9)]
    study, measure = tuning.in_units(Outcome(found.plan, study_of([*tied, *others]), found.folder))
    assert measure is found.objective.then
    assert study.best_value == 300.0
    assert study.direction.name == "MINIMIZE"
