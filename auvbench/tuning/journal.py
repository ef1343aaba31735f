"""What a study has decided and seen: Optuna's journal, a file that grows by a line per event.

A trial begins with one line that holds all its parameters, and each decision and each result is one line more. So
after a kill at any moment the study stands between two events. A line that a kill cut short is taken out and kept
beside; damage anywhere else is reported and nothing is touched.

Optuna guards its file with a lock of its own, which a killed process leaves behind for half a minute; here the
study's lock (`folder.hold`) keeps others out, so the file needs none.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from auvbench.errors import RunError
from auvbench.runs import lock
from auvbench.runs.atomic_io import storage
from auvbench.tuning import journal_lines, samplers
from auvbench.tuning.rungs import FAILED, Progress
from auvbench.tuning.space import Dimension, Value

if TYPE_CHECKING:
    from optuna.storages import BaseStorage
    from optuna.trial import FrozenTrial

CONTROLLER = "controller"
"""The folder beside the journal whose lock the study's controller holds"""

TARGET, FIRST, RESULT, ERROR = "rung", "first_rung", "result", "error"
"""Attributes of a trial: where it is to go, where it began, what it showed (`result 50000`), why it failed."""


class Journal:
    """The journal of one study, open for whoever holds the study.

    Args:
        path: of the file; it is made where it is not there.
        dimensions: what is searched.
        budgets: of the rungs.
        write: False reads what is there and leaves a line that was cut short where it is.

    Raises:
        RunError: it is damaged, or not this study's.
        TrainingError: the disk is full or failing.
    """

    def __init__(
        self, path: Path, dimensions: Sequence[Dimension], budgets: Sequence[int], *, write: bool = True
    ) -> None:
        self.path = path
        self.dimensions = tuple(dimensions)
        self.budgets = tuple(budgets)
        lines, torn = journal_lines.read(path)
        self.repaired = ""
        if torn and write:
            self.repaired = journal_lines.take_out(path, torn)
        self._storage = _open(path, None if write else lines)
        self._study = self._find_study(write, lines)
        self._ids: list[int] = [trial._trial_id for trial in self.trials()]
        self.params: list[dict[str, Value]] = []
        self.progress: list[Progress] = []
        self.results: list[dict[int, dict[str, Any]]] = []
        """by trial and rung: what `report` was handed"""
        self.errors: list[str] = []
        for trial in self.trials():
            self._take_in(trial)

    def _find_study(self, write: bool, lines: int) -> int | None:
        from optuna.study import StudyDirection

        studies = self._storage.get_all_studies()
        if len(studies) > 1:
            raise RunError(
                f"{self.path}: holds {len(studies)} studies, and a study here has a journal of its own"
            )
        if studies:
            return studies[0]._study_id
        if lines:
            raise RunError(
                f"{self.path}: damaged: the event that began the study is missing; restore the file"
            )
        if not write:
            return None
        with self._writing():
            return self._storage.create_new_study([StudyDirection.MAXIMIZE], "study")

    def trials(self) -> list[FrozenTrial]:
        """As Optuna has them."""
        return [] if self._study is None else self._storage.get_all_trials(self._study, deepcopy=False)

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        """Write into the study, unless another process has taken it over."""
        lock.verify(self.path.parent / CONTROLLER)
        with storage(f"cannot write {self.path}"):
            yield

    def _take_in(self, trial: FrozenTrial) -> None:
        """Raises RunError where a trial is none of this study's."""
        from optuna.trial import TrialState

        attributes = trial.user_attrs
        keys = [dimension.key for dimension in self.dimensions]
        target, first = attributes.get(TARGET), attributes.get(FIRST)
        rungs = range(len(self.budgets))
        if (
            list(trial.params) != keys
            or type(target) is not int
            or type(first) is not int
            or not {target, first} <= set(rungs)
        ):
            raise RunError(
                f"{self.path}: trial {trial.number} is not of this study's space and rungs; restore the file, or "
                "give the study another name"
            )
        found = {
            rung: attributes[f"{RESULT} {budget}"]
            for rung, budget in enumerate(self.budgets)
            if f"{RESULT} {budget}" in attributes
        }
        scores = {}
        for rung, result in found.items():
            score = result.get("score") if isinstance(result, Mapping) else None
            if not isinstance(score, int | float) or not math.isfinite(score):
                raise RunError(
                    f"{self.path}: trial {trial.number} has no score after {self.budgets[rung]} steps; restore the file"
                )
            scores[rung] = float(score)
        error = attributes.get(ERROR, "")
        if error:
            scores[target] = FAILED
        closed = trial.state.is_finished()
        self.params.append(dict(trial.params))
        self.progress.append(Progress(trial.number, first, target, scores, bool(error) or closed))
        self.results.append(found)
        self.errors.append(str(error))
        if trial.state is TrialState.FAIL and not error:
            raise RunError(
                f"{self.path}: trial {trial.number} was ended by another program; restore the file"
            )

    def start(self, params: Mapping[str, Value], first: int) -> Progress:
        """A new trial, which begins at rung `first`."""
        from optuna.trial import TrialState, create_trial

        number = len(self.progress)
        template = create_trial(
            state=TrialState.RUNNING,
            params=dict(params),
            distributions=samplers.distributions_of(self.dimensions),
            user_attrs={TARGET: first, FIRST: first},
        )
        with self._writing():
            assert self._study is not None
            self._ids.append(self._storage.create_new_trial(self._study, template))
        self.params.append(dict(params))
        self.progress.append(Progress(number, first, first))
        self.results.append({})
        self.errors.append("")
        return self.progress[-1]

    def promote(self, number: int) -> Progress:
        """The trial goes on to the next rung."""
        from optuna.trial import TrialState

        trial = self.progress[number]
        with self._writing():
            # This line is the decision; the state is for those who read the journal with Optuna.
            self._storage.set_trial_user_attr(self._ids[number], TARGET, trial.target + 1)
            self._storage.set_trial_state_values(self._ids[number], TrialState.RUNNING)
        trial.target += 1
        return trial

    def report(self, number: int, result: Mapping[str, Any]) -> None:
        """What the trial showed at the rung that it has reached; `score` decides, higher is better."""
        from optuna.trial import TrialState

        trial = self.progress[number]
        budget, score = self.budgets[trial.target], float(result["score"])
        top = trial.target == len(self.budgets) - 1
        with self._writing():
            self._storage.set_trial_intermediate_value(self._ids[number], budget, score)
            self._storage.set_trial_user_attr(self._ids[number], f"{RESULT} {budget}", dict(result))
            if top:
                self._storage.set_trial_state_values(self._ids[number], TrialState.COMPLETE, [score])
            else:
                self._storage.set_trial_state_values(self._ids[number], TrialState.WAITING)
        trial.scores[trial.target] = score
        trial.closed = top
        self.results[number][trial.target] = dict(result)

    def fail(self, number: int, why: str) -> None:
        """The trial's training came to nothing, through its own settings."""
        from optuna.trial import TrialState

        with self._writing():
            self._storage.set_trial_user_attr(self._ids[number], ERROR, why)
            self._storage.set_trial_state_values(self._ids[number], TrialState.FAIL)
        trial = self.progress[number]
        trial.scores[trial.target] = FAILED
        trial.closed = True
        self.errors[number] = why

    def close(self) -> None:
        """The search is over: who waits was pruned. No trial is left running."""
        from optuna.trial import TrialState

        for trial in self.trials():
            progress = self.progress[trial.number]
            if trial.state.is_finished() or progress.target not in progress.scores:
                continue
            with self._writing():
                # A kill between a result and the state that follows it leaves the state behind.
                if self.errors[trial.number]:
                    self._storage.set_trial_state_values(trial._trial_id, TrialState.FAIL)
                elif progress.target == len(self.budgets) - 1:
                    value = progress.scores[progress.target]
                    self._storage.set_trial_state_values(trial._trial_id, TrialState.COMPLETE, [value])
                else:
                    self._storage.set_trial_state_values(trial._trial_id, TrialState.PRUNED)
            progress.closed = True


def _open(path: Path, lines: int | None) -> BaseStorage:
    """Optuna's storage of a journal that was looked at; of its first `lines` lines, only to be read.

    Raises:
        RunError: they make no study.
    """
    samplers.quiet()
    from optuna.storages import JournalStorage
    from optuna.storages.journal import BaseJournalBackend, JournalFileBackend
    from optuna.storages.journal._file import BaseJournalFileLock

    class Held(BaseJournalFileLock):
        """Whoever writes holds the study."""

        def acquire(self) -> bool:
            return True

        def release(self) -> None:
            return None

    class Read(BaseJournalBackend):
        """The whole lines of a journal, which somebody else may be writing."""

        def read_logs(self, log_number_from: int) -> Any:
            if not lines:
                return
            with open(path, "rb") as file:
                for line in itertools.islice(file, log_number_from, lines):
                    yield json.loads(line)

        def append_logs(self, logs: list[dict[str, Any]]) -> None:
            raise RunError(f"{path}: is only read here")

    try:
        if lines is not None:
            return JournalStorage(Read())
        return JournalStorage(JournalFileBackend(str(path), lock_obj=Held()))
    except OSError as error:
        raise RunError(f"{path}: {error.strerror or error}") from error
    except Exception as error:  # its events contradict each other: whatever Optuna stumbles over
        raise RunError(
            f"{path}: damaged: its events make no study ({type(error).__name__}: {error}); restore the file from a "
            "copy, or give the study another name"
        ) from error
