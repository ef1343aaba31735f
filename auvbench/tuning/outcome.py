"""Compute a study's result: its trials, and the best settings' performance with fresh seeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property

import yaml
from optuna.importance import PedAnovaImportanceEvaluator, get_param_importances
from optuna.trial import FrozenTrial, TrialState

from auvbench import __version__
from auvbench.analysis.formatting import counted
from auvbench.analysis.measures import Measure
from auvbench.analysis.primary import reliability_of
from auvbench.analysis.typical import Typical
from auvbench.config.tuning import STREAM
from auvbench.errors import UserError
from auvbench.runs import provenance
from auvbench.runs.atomic_io import write_atomic
from auvbench.runs.directory import RunDirectory, find_runs, place
from auvbench.statistics.intervals import Estimate
from auvbench.statistics.reliability import Reliability
from auvbench.statistics.typical import ALPHA
from auvbench.tuning import runs, search
from auvbench.tuning.folder import Plan, StudyFolder
from auvbench.tuning.search import ERROR, Trials, open_study

FEWEST_TRIALS = 10
"""Smallest number of different scores of complete trials with which the importance of each key is computed"""

_STATES = {TrialState.COMPLETE: "done", TrialState.PRUNED: "pruned", TrialState.RUNNING: "running"}


@dataclass(frozen=True, slots=True)
class Gain:
    """Comparison of the best and the untuned settings in one measure, with seeds and scenarios that the search did not use."""

    measure: Measure
    tuned: Estimate
    untuned: Estimate
    difference: Estimate
    """tuned minus untuned. For learners, the difference between typical trainings; its limits are infinite below five trainings"""
    trainings: int = 0
    """number of trainings with tuned settings, and of trainings with untuned settings; 0 for a controller"""
    reliability: Reliability | None = None
    """how many tuned trainings are at least as good as the typical untuned training"""


@dataclass
class Outcome(Trials):
    """Result of a study."""

    folder: StudyFolder
    gains: tuple[Gain, ...] = ()
    """gains in the study's two measures; empty until all runs with fresh seeds are tested"""
    broken: tuple[str, ...] = ()
    """trainings with fresh seeds that failed"""

    @cached_property
    def objective(self) -> search.Objective:
        """Return the measures of the study."""
        return search.objective(self.plan.tune.objective, self.plan.tune.then)

    @cached_property
    def ordered(self) -> list[FrozenTrial]:
        """Return the trials with a result, best first, then the trials without a result."""
        numbers = {trial.number for trial in self.ranked}
        return [*self.ranked, *(trial for trial in self.trials if trial.number not in numbers)]

    @property
    def steps(self) -> int:
        """Return the total environment steps of the search's trainings. Each trial counts up to the last rung that it has completed."""
        seeds = len(self.plan.tune.seeds) if self.plan.learns else 0
        return seeds * sum(trial.last_step or 0 for trial in self.trials)

    @cached_property
    def cpu_s(self) -> float:
        """Return the processor time of the search in s, tests included; runs with fresh seeds are not part of it."""
        manifests = [run.manifest() for run in find_runs([self.folder.runs])]
        return round(sum(float(manifest["cpu_time_s"] or 0.0) for manifest in manifests), 1)

    @property
    def complete(self) -> int:
        """Return the number of trials that have completed the largest budget."""
        return sum(trial.state is TrialState.COMPLETE for trial in self.trials)

    @property
    def evaluator(self) -> PedAnovaImportanceEvaluator:
        """Return PED-ANOVA (Watanabe, Bansal & Hutter 2023). It measures how important each setting is for a trial to be
        among the best tenth of the complete trials, at least the best five.
        """
        return PedAnovaImportanceEvaluator(target_quantile=max(0.1, 5 / max(FEWEST_TRIALS, self.complete)))

    @cached_property
    def importances(self) -> Mapping[str, float]:
        """Return the importance of each key, with sum 1; empty with fewer than `FEWEST_TRIALS` different scores."""
        values = {trial.value for trial in self.trials if trial.state is TrialState.COMPLETE}
        if len(values) < FEWEST_TRIALS:
            return {}
        return get_param_importances(self.study, evaluator=self.evaluator)


def state_of(trial: FrozenTrial) -> str:
    """Return the state of a trial as a word: done, pruned, failed or running."""
    return "failed" if ERROR in trial.user_attrs else _STATES.get(trial.state, "failed")


def read(folder: StudyFolder) -> Outcome:
    """Return the present result of the study; write nothing.

    Raises:
        RunError: the study is missing or damaged.
    """
    plan = folder.read()
    result = Outcome(plan, open_study(plan, folder.journal), folder)
    if result.best is not None and plan.tune.fresh_seeds:
        algos = {"tuned": result.algo(result.best), "untuned": plan.base["algo"]}
        run_directories = {
            label: list(map(place, runs.fresh(plan, folder, algo))) for label, algo in algos.items()
        }
        result.gains, result.broken = _gains(result, run_directories), _broken(plan, run_directories)
    return result


def _broken(plan: Plan, run_directories: Mapping[str, Sequence[RunDirectory]]) -> tuple[str, ...]:
    lines = []
    for label, group in run_directories.items():
        for run, seed in zip(group, plan.tune.fresh_seeds, strict=False):
            manifest = run.manifest() if run.exists() else {}
            if manifest.get("state") == "failed":
                why = " ".join(str((manifest["error"] or {}).get("message", "no reason given")).split())
                lines.append(f"{label}, seed {seed}: {why}")
    return tuple(lines)


def _gains(outcome: Outcome, run_directories: Mapping[str, Sequence[RunDirectory]]) -> tuple[Gain, ...]:
    try:
        agents = [
            search.tested(group, outcome.plan.fresh_protocol.name) for group in run_directories.values()
        ]
    except UserError:
        return ()
    gains = []
    for m in dict.fromkeys((outcome.objective.measure, outcome.objective.then)):
        typical = Typical(agents, m)
        tuned, untuned = (search.interval(agent, m) for agent in agents)
        reliable = reliability_of(agents, typical, 0, 1, 0.0, 0.95)
        gains.append(
            Gain(m, tuned, untuned, typical.difference(0, 1, ALPHA), typical.fewest((0, 1)), reliable)
        )
    return tuple(gains)


def name_of(plan: Plan) -> str:
    """Return the name that the study's preset has in runs and tables."""
    name = str(plan.base["algo"]["name"])
    return f"{plan.name}_tuned" if plan.name == name else plan.name


def write(outcome: Outcome, best: FrozenTrial, evidence: str) -> None:
    """Write the values of the best settings as a preset; `evidence` is a sentence about the gain of these settings."""
    plan, path, algo, trials = outcome.plan, outcome.folder.best, outcome.algo(best), len(outcome.trials)
    today = datetime.now(UTC).date().isoformat()
    git = provenance.git()
    commit = f" (commit {git['commit'][:12]}{', modified' if git['dirty'] else ''})" if git["commit"] else ""
    name = name_of(plan)
    searched = [dimension.key.partition(".")[2] for dimension in plan.dimensions]
    head = [
        f"{name}: found by {plan.command or 'auvbench tune'}",
        f"on {today} with auvbench {__version__}{commit}: {counted(trials, 'trial')}, {outcome.steps:,} environment steps of training, "
        f"{outcome.cpu_s / 3600:.2g} core hours, scenarios of",
        f"protocol={plan.protocol.name} (seed {plan.protocol.seed}, {plan.protocol.episodes} episodes), none of a test.",
        evidence,
        f"Searched: {', '.join(searched)}.",
        f"To use it: cp {path} conf/algo/{name}.yaml, then algo={name}.",
    ]
    body = {
        "defaults": [f"/{algo['agent']}_schema@_here_", "_self_"],
        "name": name,
        "agent": algo["agent"],
        **{key: value for key, value in algo.items() if key not in ("name", "agent", "tuned")},
        "tuned": {
            "study": plan.name,
            "protocol": plan.protocol.name,
            "scenarios": STREAM,
            "seed": plan.protocol.seed,
            "trials": trials,
            "steps": outcome.steps,
            "cpu_s": outcome.cpu_s,
            "version": __version__,
            "date": today,
        },
    }
    text = "".join(f"# {' '.join(line.split())}\n" for line in head)
    write_atomic(
        path, (text + yaml.safe_dump(body, sort_keys=False, width=100, default_flow_style=None)).encode()
    )
