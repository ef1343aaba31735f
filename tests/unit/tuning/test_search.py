"""A search that is killed at any operation loses no result and asks for none twice."""

from __future__ import annotations

import math
from pathlib import Path

import optuna
import pytest
from omegaconf import OmegaConf
from optuna.trial import FrozenTrial, TrialState, create_trial

from auvbench.commands.tune import plan_of, split
from auvbench.config import schema
from auvbench.config.compose import compose, typed
from auvbench.errors import RunError
from auvbench.tuning.folder import Journal, Plan
from auvbench.tuning.search import ERROR, Score, Search, Step, Trials, open_study

SMALL = ["algo=ppo", "tune.trials=9", "tune.startup=4", "tune.rungs=[10,30,90]", "tune.reduction=2"]
BROKEN = 5
"""the trial whose settings fail"""


class Killed(BaseException):
    pass


def plan(*arguments: str) -> Plan:
    words, ranges, fixed = split([*SMALL, *arguments, "output=/nowhere"])
    return plan_of(compose("tune", words), ranges, fixed)[0]


def base_of(study: Plan) -> schema.TrainConfig:
    return typed(OmegaConf.create({**study.base, "name": "a", "output": "b", "seed": 0}))


def shown(trial: FrozenTrial, rung: int) -> float:
    """What a trial shows: a function of its settings and of the budget."""
    rate = math.log(float(trial.params["algo.learning_rate"]) / 1e-3)
    return -abs(rate) - abs(float(trial.params["algo.gamma"]) - 0.98) * 20 + rung / 9


def carry_out(
    study: Plan, path: Path, monkeypatch: pytest.MonkeyPatch, kill_after: float = math.inf, at_once: int = 2
) -> tuple[Search, list[Step]]:
    """Run the search, and die after so many operations; return what was trained to the end."""
    left = [kill_after]
    append = Journal.append_logs

    def counting(self: Journal, logs: list[dict[str, object]]) -> None:
        append(self, logs)
        left[0] -= 1
        if left[0] <= 0:
            raise Killed

    reported: list[Step] = []
    with monkeypatch.context() as patch:
        patch.setattr(Journal, "append_logs", counting)
        try:
            search = Search(study, open_study(study, path), base_of(study))
            active: list[Step] = []
            while True:
                while len(active) < at_once and (step := search.next()) is not None:
                    active.append(step)
                if not active:
                    return search, reported
                step = active.pop(0)
                trial = search.trials[step.trial]
                if step.trial == BROKEN and step.rung == 0:
                    search.fail(step, "the weights became nan")
                    continue
                score = shown(trial, step.rung)
                search.report(step, Score(score, score, score, score, math.nan))
                reported.append(step)
        except Killed:
            raise Killed(reported) from None


def check(study: Plan, path: Path) -> list[FrozenTrial]:
    """Every trial is over, with its own results at consecutive rungs."""
    whole = open_study(study, path)
    trials = whole.get_trials()
    for trial in trials:
        assert trial.state in (TrialState.COMPLETE, TrialState.PRUNED)
        found = Trials(study, whole).results(trial)
        assert [score.score for score in found] == [shown(trial, rung) for rung in range(len(found))]
        assert (trial.state is TrialState.COMPLETE) == (len(found) == len(study.budgets))
    return trials


@pytest.mark.slow
@pytest.mark.parametrize("pruner", ["halving", "none"])
def test_a_kill_after_any_operation_loses_no_result_and_asks_for_none_twice(
    pruner: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = plan(f"tune.pruner={pruner}")
    whole, _ = carry_out(study, tmp_path / "whole.log", monkeypatch)
    assert len(check(study, tmp_path / "whole.log")) == 9
    assert whole.best is not None
    operations = (tmp_path / "whole.log").read_text().count("\n")
    for kill in range(1, operations, 13 if pruner == "halving" else 41):
        path = tmp_path / f"{kill}.log"
        with pytest.raises(Killed) as killed:
            carry_out(study, path, monkeypatch, kill_after=kill)
        first = killed.value.args[0]
        _, second = carry_out(study, path, monkeypatch)
        trials = check(study, path)
        assert len(trials) == 9
        assert not set(first) & set(second), f"killed after operation {kill}"
        kept = {Step(t.number, rung) for t in trials for rung in range(len(t.intermediate_values))}
        assert kept >= {*first, *second}
        assert len(kept - {*first, *second}) <= 1  # the kill was within a report, after its result
        assert [trial.number for trial in trials if ERROR in trial.user_attrs] == [BROKEN]


@pytest.mark.slow
def test_more_trials_go_on_from_those_there_are(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "journal.log"
    before = [trial.params for trial in carry_out(plan(), path, monkeypatch)[0].trials]
    more, _ = carry_out(plan("tune.trials=14"), path, monkeypatch)
    after = [trial.params for trial in more.trials]
    assert after[:9] == before
    assert len(after) == 14
    assert len({tuple(params.values()) for params in after}) == 14


@pytest.mark.slow
@pytest.mark.parametrize("kill", [1, 2, 3, 4])
def test_the_first_trial_may_have_the_settings_of_the_preset(
    kill: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = "tune.preset=true", "algo.gamma=interval(0.99,0.999)", "algo.clip_range=interval(0.3,0.4)"
    study, path = plan("tune.trials=2", *words), tmp_path / "journal.log"
    with pytest.raises(Killed):
        carry_out(study, path, monkeypatch, kill_after=kill)
    search, _ = carry_out(study, path, monkeypatch)
    first, second = (trial.params for trial in search.trials)
    assert first["algo.learning_rate"] == 0.001
    assert first["algo.gamma"] == 0.99
    assert first["algo.net_arch"] == "[64,64]"
    assert first["algo.batch_size"] == "1024"
    assert 0.3 <= first["algo.clip_range"] <= 0.4  # the preset's 0.2 is not in the range
    assert second["algo.learning_rate"] != 0.001


@pytest.mark.slow
def test_impossible_settings_are_a_failed_trial_and_not_the_end(tmp_path: Path) -> None:
    study = plan("algo.batch_size=choice(512,1024)", "algo.n_steps=choice(32,64,128,256)")
    search = Search(study, open_study(study, tmp_path / "journal.log"), base_of(study))
    search.plan.base["algo"]["n_envs"] = 1  # then no rollout is large enough for a batch
    assert search.next() is None
    assert len(search.trials) == 9
    assert all("algo.batch_size" in trial.user_attrs[ERROR] for trial in search.trials)
    assert search.best is None


def test_a_budget_at_which_all_trials_have_one_score_is_named() -> None:
    study = optuna.create_study()
    whole = Trials(plan(), study)
    for number in range(5):
        study.add_trial(create_trial(state=TrialState.PRUNED, intermediate_values={10: -60.0}))
        assert whole.uninformative == ((10,) if number > 1 else ())
    study.add_trial(create_trial(state=TrialState.PRUNED, intermediate_values={10: -60.0, 30: -50.0}))
    assert whole.uninformative == (10,)
    study.add_trial(create_trial(state=TrialState.PRUNED, intermediate_values={10: -59.0}))
    assert whole.uninformative == ()


@pytest.mark.slow
def test_the_best_has_the_largest_budget_before_the_best_score() -> None:
    def trial(number: int, *values: float) -> FrozenTrial:
        found = create_trial(state=TrialState.PRUNED)
        found.intermediate_values = {10 * (i + 1): value for i, value in enumerate(values)}
        return found

    failed = trial(4, 9.0, 9.0)
    failed.user_attrs = {ERROR: "became nan"}
    study = optuna.create_study(direction="maximize")
    study.add_trials([trial(0, 0.9), trial(1, 0.1, 0.2), trial(2), trial(3, 0.1, 0.2), failed])
    assert [t.number for t in Trials(plan(), study).ranked] == [1, 3, 0]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("other", "word"),
    [("algo.gamma=interval(0.9,0.99)", "parameters"), ("tune.rungs=[20,40,80]", "rungs")],
)
def test_the_journal_of_another_study_is_refused(
    other: str, word: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "journal.log"
    carry_out(plan(), path, monkeypatch)
    with pytest.raises(RunError, match=f"trial 0 has .*{word}.* of another study"):
        open_study(plan(other), path)


@pytest.mark.slow
@pytest.mark.parametrize(
    "log",
    [
        {"op_code": 99},
        {"op_code": 4},
        {"op_code": 6, "trial_id": 0, "state": 77, "worker_id": "x", "values": None},
        {"op_code": 8, "trial_id": 0, "user_attr": {"result 10": "good"}, "worker_id": "x"},
        {"op_code": "x"},
    ],
)
def test_operations_that_make_no_study_are_refused_in_one_line(
    log: dict[str, object], tmp_path: Path
) -> None:
    study, path = plan(), tmp_path / "journal.log"
    search = Search(study, open_study(study, path), base_of(study))
    step = search.next()
    assert step is not None
    search.report(step, Score(1.0, 1.0, 1.0, 1.0, 1.0))
    Journal(path).append_logs([log])
    with pytest.raises(RunError, match="do not form a study") as caught:
        open_study(study, path)
    assert "\n" not in str(caught.value)
