"""The page of a study: says what the data say, in the order that matters, whatever stands in the files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from auvbench.commands.tune import plan_of, split
from auvbench.config.compose import compose
from auvbench.reporting.tuning import looks, sentences, write
from auvbench.statistics.estimate import Estimate
from auvbench.tuning import scores
from auvbench.tuning.folder import StudyFolder
from auvbench.tuning.outcome import Cost, Fresh, Outcome, Trial


def result(objective: float, then: float) -> dict[str, object]:
    return {
        "score": objective,
        "objective": objective,
        "low": objective - 0.05,
        "high": 1.0,
        "then": then,
        "runs": ["x"],
    }


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    output = tmp_path_factory.mktemp("page")
    words = ["algo=ppo", "algo.n_epochs=interval(2,20)", "tune.rungs=[100,300]", f"output={output}"]
    words, ranges, fixed = split(words)
    plan, study = plan_of(compose("tune", words), ranges, fixed, "auvbench tune <script>alert(1)</script>")
    trials = []
    for number in range(12):
        params = {d.key: d.ends()[number % len(d.ends())] for d in plan.dimensions}
        params["algo.n_epochs"] = 2 + number
        results = {
            0: result(0.5 + 0.01 * number, 900.0),
            **({1: result(0.95 - 0.01 * number, 300.0)} if number < 3 else {}),
        }
        trials.append(Trial(number, params, max(results), results, "done" if number < 3 else "pruned"))
    trials.append(Trial(12, trials[0].params, -1, {}, "failed", "step 3: train/loss became nan"))
    estimate = Estimate(0.95, 0.9, 0.98)
    fresh = Fresh(
        estimate,
        Estimate(0.8, 0.7, 0.9),
        Estimate(0.15, 0.02, 0.28),
        0.02,
        (250.0, 400.0),
        Estimate(-150.0, -200.0, -100.0),
        (1000, 1001),
    )
    return Outcome(
        plan,
        StudyFolder(Path(study.path)),
        scores.objective("success_rate", "par1_steps"),
        (100, 300),
        tuple(trials),
        {d.key: 1 / len(plan.dimensions) for d in plan.dimensions},
        Cost(2000, 2300, 60.0, 6.0),
        fresh,
    )


def test_the_fresh_seeds_come_first_and_the_winner_is_called_lucky(found: Outcome) -> None:
    said = sentences.summary(found)
    assert said[0].startswith("On 2 fresh training seeds and fresh validation scenarios")
    assert "15.0 points" in said[0] or "15 points" in said[0]
    assert "better" in said[0]
    assert "lucky" in said[1]
    assert "3 brought to the end, 9 pruned, 1 failed" in " ".join(said)
    assert "13 %" in " ".join(said)  # 300 of 2300 steps
    assert "lie at an end of the range" in said[-1]


@pytest.mark.parametrize(
    ("low", "high", "verdict"), [(0.02, 0.28, "better"), (-0.28, -0.02, "worse"), (-0.1, 0.2, "not resolved")]
)
def test_a_gain_is_one_where_its_interval_leaves_out_zero(
    found: Outcome, low: float, high: float, verdict: str
) -> None:
    difference = Estimate((low + high) / 2, low, high)
    assert sentences.verdict(difference, found.objective.measure) == verdict


def test_without_fresh_seeds_nothing_is_called_a_gain(found: Outcome) -> None:
    said = " ".join(sentences.summary(replace(found, fresh=None)))
    assert "better" not in said.replace("better settings", "")
    assert "Not yet trained with fresh seeds" in sentences.evidence(replace(found, fresh=None))


def test_the_page_holds_everything_and_nothing_that_runs(found: Outcome) -> None:
    path = write.report(found)
    html = path.read_text()
    assert "<script>alert(1)" not in html
    assert html.count("<figure ") == 5
    assert "train/loss became nan" in html
    assert html.count("<tr>") >= 13
    assert (path.parent / "trials.csv").read_text().count("\n") == 14
    for word in ("http://", "https://"):
        assert word not in html.replace("http://www.w3.org", "")


def test_a_study_without_a_result_has_a_page_too(found: Outcome, tmp_path: Path) -> None:
    empty = replace(found, trials=(), fresh=None, importances={}, folder=StudyFolder(tmp_path))
    html = write.report(empty).read_text()
    assert "0 trials: none." in html
    assert "<figure " not in html


def test_the_measure_that_tells_trials_apart_is_drawn(found: Outcome) -> None:
    assert looks.telling(found)[1] == "objective"
    tied = tuple(
        replace(t, results={r: {**v, "objective": 1.0} for r, v in t.results.items()}) for t in found.trials
    )
    assert looks.telling(replace(found, trials=tied))[1] == "then"
    # The best of those that came as far as the best decide, however the others fared.
    top = tuple(
        replace(t, results={r: {**v, "objective": 1.0} if r else v for r, v in t.results.items()})
        for t in found.trials
    )
    assert looks.telling(replace(found, trials=top))[1] == "then"
