"""The controller: bad settings are bad trials, bad luck stops the study, one run serves equal trials."""

from __future__ import annotations

import io
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest
from omegaconf import OmegaConf
from optuna.trial import TrialState
from rich.console import Console

from auvbench.commands.tune import plan_of, split
from auvbench.config.compose import compose, typed
from auvbench.errors import TrainingError
from auvbench.runs import lock
from auvbench.runs.directory import RunDirectory, freeze
from auvbench.scheduling.loop import Phase, Status
from auvbench.tuning import controller, runs
from auvbench.tuning.controller import Controller
from auvbench.tuning.search import ERROR, Objective, Score, Search, open_study
from auvbench.tuning.search import objective as objective_of

WORDS = [
    "algo=ppo",
    "tune.trials=6",
    "tune.startup=6",
    "tune.rungs=[10,30]",
    "tune.reduction=2",
    "tune.fresh_seeds=[]",
]


class Job:
    mark = None

    def __init__(self, run: Path, code: int, lost: bool = False) -> None:
        self.run, self.status = run, Status(Phase.ENDED, code, lost=lost)

    def poll(self) -> Status:
        return self.status

    def cancel(self, *, force: bool = False) -> None: ...

    def __str__(self) -> str:
        return "job"


class Backend:
    """Carries out a run at once, as `behave` says: by the number of the submission."""

    def __init__(self, limit=1, behave=lambda number, run: None) -> None:
        self.limit, self.behave = limit, behave
        self.submitted: list[Path] = []

    def submit(self, run: Path) -> Job:
        self.submitted.append(run)
        error = self.behave(len(self.submitted), RunDirectory(run))
        if error is not None:
            kind, message, code = error
            if kind:
                RunDirectory(run).update_manifest(
                    state="failed", error={"type": kind, "message": message, "step": 1}
                )
            return Job(run, code)
        RunDirectory(run).update_manifest(state="complete", steps=0, files={})
        return Job(run, 0)

    def adopt(self, run: Path) -> None:
        return None

    def wait(self, seconds: float) -> None: ...

    def close(self) -> None: ...


def carry_out(
    folder: Path, backend: Backend, monkeypatch: pytest.MonkeyPatch, *more: str, of=None
) -> tuple[Search, str]:
    words, ranges, fixed = split([*WORDS, *more, f"output={folder}"])
    plan, study = plan_of(compose("tune", words), ranges, fixed)

    def prepare(plan, study, algo, rung):
        return [
            freeze(runs.configuration(plan, study, algo, seed, plan.budgets[rung]))
            for seed in plan.tune.seeds
        ]

    def by_rate(self, made, protocol):
        rate = made[0].config()["algo"]["learning_rate"]
        return Score(rate, rate, rate, rate, 1.0)

    monkeypatch.setattr(runs, "prepare", prepare)
    monkeypatch.setattr(runs, "test", lambda run, protocol: None)
    monkeypatch.setattr(Objective, "of", of or by_rate)
    study.path.mkdir(parents=True, exist_ok=True)
    base = typed(OmegaConf.create({**plan.base, "name": "a", "output": "b", "seed": 0}))
    search = Search(plan, open_study(plan, study.journal), base)
    objective = objective_of("success_rate", "par1_steps")
    text = io.StringIO()
    shown = controller.StudyView(search, objective, Console(file=text, width=200))
    try:
        Controller(study, search, backend, shown).carry_out()
    finally:
        search.text = text.getvalue()
    return search, text.getvalue()


def errors(search: Search) -> list[str]:
    return [trial.user_attrs[ERROR] for trial in search.trials if ERROR in trial.user_attrs]


@pytest.mark.slow
def test_every_trial_is_carried_out_and_the_best_reach_the_top(tmp_path, monkeypatch):
    search, text = carry_out(tmp_path, Backend(limit=3), monkeypatch, "tune.seeds=[0,1]")
    assert len(search.trials) == 6
    assert not search.running
    best = max(search.trials, key=lambda trial: trial.params["algo.learning_rate"])
    assert search.best.number == best.number
    assert "6 of 6 trials begun" in text


@pytest.mark.slow
def test_one_trial_is_counted_as_one(tmp_path, monkeypatch):
    _, text = carry_out(tmp_path, Backend(), monkeypatch, "tune.trials=1")
    assert "1 of 1 trial begun" in text


@pytest.mark.slow
def test_settings_that_ruin_a_training_are_a_failed_trial(tmp_path, monkeypatch):
    def behave(number, run):
        return ("TrainingError", "step 7: train/loss became nan", 1) if number == 2 else None

    search, text = carry_out(tmp_path, Backend(behave=behave), monkeypatch)
    assert len(errors(search)) == 1
    assert len(search.trials) == 6
    assert "became nan" in text


@pytest.mark.slow
def test_what_is_not_the_settings_fault_stops_the_study_and_it_goes_on_later(tmp_path, monkeypatch):
    def behave(number, run):
        return ("TrainingError", "cannot write: the disk is full", 1) if number == 3 else None

    with pytest.raises(TrainingError, match=r"disk is full.*run the same command to continue"):
        carry_out(tmp_path, Backend(behave=behave), monkeypatch)
    search, _ = carry_out(tmp_path, Backend(), monkeypatch)
    assert not errors(search)
    assert len(search.trials) == 6


@pytest.mark.slow
def test_a_worker_that_was_killed_is_started_again_a_few_times(tmp_path, monkeypatch):
    backend = Backend(behave=lambda number, run: ("", "", -9) if number == 2 else None)
    search, text = carry_out(tmp_path, backend, monkeypatch)
    assert "it is resumed" in text
    assert not errors(search)
    always = Backend(behave=lambda number, run: ("", "", -9))
    with pytest.raises(TrainingError, match="SIGKILL"):
        carry_out(tmp_path / "other", always, monkeypatch)
    assert len(always.submitted) == controller.TRIES


@pytest.mark.slow
def test_a_run_that_goes_on_after_its_trial_failed_is_not_begun_twice(tmp_path, monkeypatch):
    """Two trials of the same settings and two seeds; the first seed fails while the second is still being trained."""
    backend = Backend(limit=4, behave=lambda number, run: None)
    submit, late = backend.submit, []

    def submitted(run: Path) -> Job:
        job = submit(run)
        if "-s0-" in run.name:
            RunDirectory(run).update_manifest(
                state="failed", error={"type": "TrainingError", "message": "a loss became nan", "step": 1}
            )
            job.status = Status(Phase.ENDED, 1)
        else:  # ends at the fifth look
            late.append(job)
            RunDirectory(run).update_manifest(state="running")
            job.poll = partial(look, run, job.status, iter([Status(Phase.RUNNING)] * 4))
        return job

    def look(run: Path, ended: Status, looks: Iterator[Status]) -> Status:
        status = next(looks, ended)
        if status.ended:
            RunDirectory(run).update_manifest(state="complete")
        return status

    backend.submit = submitted
    fixed = [f"algo.{key}" for key in ("n_epochs=3", "gae_lambda=0.9", "clip_range=0.2", "ent_coef=0")]
    fixed += ["algo.log_std_init=0", "algo.net_arch=[8]", "algo.n_steps=64", "algo.batch_size=64"]
    fixed += ["algo.gamma=0.9", "algo.learning_rate=choice(0.001,0.002)", "tune.seeds=[0,1]"]
    search, _ = carry_out(tmp_path, backend, monkeypatch, *fixed)
    assert len(errors(search)) == len(search.trials)
    assert late
    seconds = [job.run for job in late]
    assert len(set(seconds)) == len(seconds)


@pytest.mark.slow
def test_a_complete_run_that_is_being_tested_is_waited_for(tmp_path, monkeypatch):
    """By a worker of an earlier controller, which was killed: its score is asked for when it has let go."""
    backend, held, tested, waits = Backend(), [], [], []

    def behave(number: int, run: RunDirectory) -> None:
        if number == 1:
            held.append(lock.acquire(run.path))

    def wait(seconds: float) -> None:
        waits.append(len(backend.submitted))
        if len(waits) == 4:
            held[0].release()

    backend.behave, backend.wait = behave, wait
    words = ["tune.trials=1", "tune.rungs=[10]"]

    def of(self, made, protocol):
        tested.append(lock.living_holder(made[0].path))
        return Score(1.0, 1.0, 1.0, 1.0, 1.0)

    search, _ = carry_out(tmp_path, backend, monkeypatch, *words, of=of)
    assert tested == [None]
    assert waits[3] == 1  # nothing is started while the run is held
    assert len(backend.submitted) == 2
    assert search.trials[0].state is TrialState.COMPLETE


@pytest.mark.slow
def test_equal_settings_share_a_run(tmp_path, monkeypatch):
    backend = Backend(limit=4)
    fixed = [
        f"algo.{key}" for key in ("n_epochs=3", "gamma=0.9", "gae_lambda=0.9", "clip_range=0.2", "ent_coef=0")
    ]
    fixed += ["algo.log_std_init=0", "algo.net_arch=[8]", "algo.n_steps=64", "algo.batch_size=64"]
    search, _ = carry_out(tmp_path, backend, monkeypatch, *fixed, "algo.learning_rate=choice(0.001,0.002)")
    assert len(search.trials) == 6
    assert len(set(backend.submitted)) == len(backend.submitted) <= 4
