"""A study that is killed at any event goes on as if it had not been."""

import math

import pytest

from auvbench.commands.tune import plan_of, split
from auvbench.config.compose import compose
from auvbench.tuning.journal import Journal
from auvbench.tuning.search import Search

SMALL = ["algo=ppo", "tune.trials=9", "tune.startup=4", "tune.rungs=[10,30,90]", "tune.reduction=2"]


class Killed(BaseException):
    pass


def plan(*arguments, tmp="/nowhere"):
    words, ranges, fixed = split([*SMALL, *arguments, f"output={tmp}"])
    return plan_of(compose("tune", words), ranges, fixed)[0]


def shown(search, step):
    """What a trial shows: a function of its settings and of the budget; some fail."""
    params = search.journal.params[step.trial]
    return (
        -abs(math.log(params["algo.learning_rate"] / 1e-3))
        - abs(params["algo.gamma"] - 0.98) * 20
        + step.rung / 9
    )


def carry_out(study, path, kill_after=None):
    """Runs the study with one worker; dies right after so many events of the journal were written."""
    journal = Journal(path, study.dimensions, study.budgets)
    backend, left = journal._storage._backend, [math.inf if kill_after is None else kill_after]
    append = backend.append_logs

    def counting(logs):
        append(logs)
        left[0] -= 1
        if left[0] <= 0:
            raise Killed

    backend.append_logs = counting
    search = Search(study, journal)
    while (step := search.next()) is not None:
        if step.trial == 5:
            search.fail(step.trial, "the weights became nan")
            continue
        worth = shown(search, step)
        search.report(
            step.trial,
            {"score": worth, "objective": worth, "low": 0.0, "high": 1.0, "then": 1.0, "runs": ["a"]},
        )
    journal.close()
    return search


def outcome(path, study):
    journal = Journal(path, study.dimensions, study.budgets, write=False)
    states = [trial.state.name for trial in journal.trials()]
    return journal.params, [p.scores for p in journal.progress], journal.errors, states


@pytest.mark.parametrize("pruner", ["halving", "hyperband", "median", "none"])
def test_a_kill_after_any_event_changes_no_trial(pruner, tmp_path):
    study = plan(f"tune.pruner={pruner}")
    search = carry_out(study, tmp_path / "whole.log")
    expected = outcome(tmp_path / "whole.log", study)
    assert "RUNNING" not in expected[3]
    assert "WAITING" not in expected[3]
    assert search.best is not None
    events = (tmp_path / "whole.log").read_text().count("\n")
    for event in range(1, events, 3 if pruner == "halving" else 11):
        path = tmp_path / f"{event}.log"
        with pytest.raises(Killed):
            carry_out(study, path, kill_after=event)
        carry_out(study, path)
        assert outcome(path, study) == expected, f"killed after event {event}"


def test_more_trials_go_on_from_those_there_are(tmp_path):
    path = tmp_path / "journal.log"
    first = carry_out(plan(), path)
    before = list(first.journal.params)
    more = carry_out(plan("tune.trials=14"), path)
    assert more.journal.params[:9] == before
    assert len(more.journal.params) == 14


def test_impossible_settings_are_a_failed_trial_and_not_the_end(tmp_path):
    from omegaconf import OmegaConf

    from auvbench.config.compose import typed

    study = plan("algo.batch_size=choice(512,1024)", "algo.n_steps=choice(32,64,128,256)")
    base = typed(OmegaConf.create({**study.base, "name": "a", "output": "b", "seed": 0}))
    journal = Journal(tmp_path / "journal.log", study.dimensions, study.budgets)
    search = Search(study, journal, base)
    search.plan.base["algo"]["n_envs"] = 1  # then no rollout is large enough for a batch
    assert search.next() is None
    assert all("algo.batch_size" in error for error in journal.errors)
    assert len(journal.errors) == 9
    assert search.best is None
