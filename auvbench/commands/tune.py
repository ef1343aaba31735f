"""`auvbench tune`: search for settings of an algorithm on validation scenarios."""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from auvbench.errors import ConfigError, RunError, closest

if TYPE_CHECKING:
    from omegaconf import DictConfig

    from auvbench.config.grids import Job
    from auvbench.scheduling.loop import Result
    from auvbench.tuning.folder import Plan, StudyFolder


def main(arguments: Sequence[str]) -> int:
    from auvbench.config.compose import read
    from auvbench.grammar import read_named_sheets

    read_named_sheets(arguments)
    words, ranges, _ = split(arguments)
    request = read("tune", words, grid=True)
    if request is None:
        return 0
    _check_search(request.configs, arguments)
    return _studies(request.jobs, ranges, arguments)


def _check_search(configs: Sequence[DictConfig], arguments: Sequence[str]) -> None:
    """Raise ConfigError if the command line names a search file that does not exist.

    Hydra ignores a missing search file, since some algorithms have no search file.
    """
    from auvbench.config import folders

    for word in arguments:
        name = word.partition("=")[2]
        if re.match(r"\+*search=", word) and any(config.get("search") is None for config in configs):
            raise ConfigError(
                f"{word}: no such file in conf/search; {closest(name, folders.options('search'))}"
            )


def split(arguments: Sequence[str]) -> tuple[list[str], dict[str, str], dict[str, str]]:
    """Divide a command line into the words for Hydra, the ranges by key, and the fixed values by key.

    A range of a key such as algo.tau is a dimension of the study. A list of options such as algo=ppo,sac means
    several studies, and needs -m; the list stays among the words for Hydra.
    """
    words: list[str] = []
    ranges: dict[str, str] = {}
    fixed: dict[str, str] = {}
    before, place = "", 0
    for word in arguments:
        match = re.fullmatch(
            r"\+*((?:algo|train|reward|step|task|noise|disturbance|vehicle)\.[\w.]+)=(.+)", word
        )
        if match is None or before in ("-c", "--cfg"):
            words.append(word)
        elif _is_range(match[1], match[2]):
            if match[1] in ranges:
                raise ConfigError(f"{word}: {match[1]} already has a range: {match[1]}={ranges[match[1]]}")
            place = place if ranges else len(words)
            ranges[match[1]] = match[2]
        else:
            fixed[match[1]] = match[2]
            words.append(word)
        before = word
    if ranges:
        from auvbench.config.overrides import quote

        # Pass the ranges to Hydra in tune.space, so that --cfg job shows them; Hydra would read KEY=RANGE as a grid.
        quoted = ",".join(f"{key}:{quote(text)}" for key, text in ranges.items())
        words.insert(place, f"++tune.space={{{quoted}}}")
    return words, ranges, fixed


def _is_range(key: str, text: str) -> bool:
    from hydra.core.override_parser.overrides_parser import OverridesParser
    from hydra.errors import HydraException

    from auvbench.config.overrides import read

    try:
        return bool(OverridesParser.create().parse_override(read([f"{key}={text}"])[0]).is_sweep_override())
    except (HydraException, RecursionError) as error:
        if re.match(r"(choice|interval|range|tag|int|float)\(", text):
            from auvbench.tuning.space import FORMS

            raise ConfigError(f"{key}={text}: {' '.join(str(error).split())}; write {FORMS}") from error
        return False  # The error is reported when the configuration is composed later.


def _studies(jobs: Sequence[Job], ranges: Mapping[str, str], arguments: Sequence[str]) -> int:
    """Check all studies, then run one study after another; return the exit code."""
    command = shlex.join(["auvbench", "tune", *arguments])
    # A value from a grid of an experiment fixes its key, like a value on the command line.
    plans = [plan_of(job.config, ranges, split(job.overrides)[2], command) for job in jobs]
    for plan, _ in plans:
        _refuse_ignored(plan, arguments)
    names = [study.path for _, study in plans]
    for path in names:
        if names.count(path) > 1:
            raise ConfigError(
                f"{path}: two of these studies would have this name; run them one at a time, each with its own name=NAME"
            )
    code = 0
    for number, ((plan, study), job) in enumerate(zip(plans, jobs, strict=True), 1):
        if len(plans) > 1:
            print(f"study {number} of {len(plans)}: {plan.name}", flush=True)
        code = _study(plan, study, job.config)
        if code > 128:
            break
    return code


def plan_of(
    config: DictConfig, ranges: Mapping[str, str], fixed: Mapping[str, str], command: str = ""
) -> tuple[Plan, StudyFolder]:
    """Check the settings of a study, and return its plan and folder; write no file.

    Raises:
        ConfigError, VehicleError, ReportError: a value is wrong, or the search space is empty or
            contradictory.
    """
    from omegaconf import OmegaConf

    from auvbench.config import tuning
    from auvbench.config.compose import option, typed
    from auvbench.config.tasks import primary_of
    from auvbench.record import PRIMARY
    from auvbench.runs import plan as runs_plan
    from auvbench.training import execute
    from auvbench.tuning import search, space
    from auvbench.tuning.folder import Plan, StudyFolder
    from auvbench.untrusted.typed_json import Prose

    if config.algo.get("agent") == "onnx":
        raise ConfigError(f"algo={config.algo.name}: a policy in a file has no settings to search")
    tune, protocol = tuning.read(config)
    if tune.objective == PRIMARY:
        tune.objective = primary_of(config.task.name)
    search.objective(tune.objective, tune.then)
    base = tuning.without_search(config)
    # The study decides where its runs are, how they are scheduled and how long they train.
    name, output, seed = str(base.pop("name")), str(base.pop("output")), int(base.pop("seed"))
    base["launcher"] = OmegaConf.to_container(option("launcher", "local"))
    base["train"]["total_steps"] = tune.rungs[-1]
    checked = typed(OmegaConf.create({**base, "name": name, "output": output, "seed": seed}))
    runs_plan.check_vehicle(checked)
    execute.check_runnable(checked)
    searched = OmegaConf.to_container(config)
    assert isinstance(searched, dict)
    written = searched.get("search")
    if not isinstance(written, dict | str | None):
        raise ConfigError("search: its file must map keys to ranges (see conf/search)")
    keys = space.keys_of(base["algo"])
    typed_ranges = {**{str(key): str(text) for key, text in tune.space.items()}, **ranges}
    dimensions = space.read(written if isinstance(written, dict) else {}, typed_ranges, fixed, keys)
    space.validate_space(dimensions, checked, base["algo"])
    study = StudyFolder(Path(output) / "tune" / name)
    tune.space = {dimension.key: dimension.text for dimension in dimensions}
    return Plan(name, seed, base, tune, protocol, Prose(command)), study


def _refuse_ignored(plan: Plan, arguments: Sequence[str]) -> None:
    """Raise ConfigError if a value on the command line has no effect, since the agent is not trained and the protocol sets the value."""
    from omegaconf import OmegaConf

    from auvbench.config.compose import typed
    from auvbench.evaluation.protocol import resolve_conditions

    words = {}
    for word in arguments:
        if match := re.match(r"\+*(task|noise|disturbance|step)[.=]", word):
            words[match[1]] = word
    if plan.learns or not words:
        return
    config = {**plan.base, "name": plan.name, "output": "", "seed": plan.seed}
    own = typed(OmegaConf.create(config))
    for condition in resolve_conditions(plan.protocol, config):
        for group, word in words.items():
            if getattr(condition.config, group) != getattr(own, group):
                raise ConfigError(
                    f"{word}: has no effect, because protocol={plan.protocol.name} sets its own {group}; "
                    "leave out the protocol, or set the value in protocol.overrides"
                )


def _study(plan: Plan, study: StudyFolder, config: DictConfig) -> int:
    """Search, train the best settings with fresh seeds, and write the report and the preset."""
    from auvbench.tuning.folder import refuse_change

    existing = study.read() if study.plan_path.exists() else None
    if existing is not None:
        refuse_change(study, existing, plan)
    elif study.journal.exists():
        raise RunError(
            f"{study.path}: has a journal but no study.json; restore study.json, or choose another name=NAME"
        )
    with study.hold():
        study.write(plan)
        result = _search(plan, study, config)
        if result.signal is not None:
            print(f"{study.path}: interrupted; run the same command to continue", flush=True)
            return result.exit_code
        return _conclude(plan, study)


def _search(plan: Plan, study: StudyFolder, config: DictConfig) -> Result:
    from omegaconf import OmegaConf
    from rich.console import Console

    from auvbench.analysis.formatting import counted
    from auvbench.config.compose import typed
    from auvbench.scheduling.grid import backend
    from auvbench.tuning import runs
    from auvbench.tuning.controller import Controller, StudyView
    from auvbench.tuning.search import Search, open_study
    from auvbench.tuning.search import objective as objective_of

    values = {**plan.base, "name": plan.name, "output": str(study.path), "seed": plan.seed}
    search = Search(plan, open_study(plan, study.journal), typed(OmegaConf.create(values)))
    objective = objective_of(plan.tune.objective, plan.tune.then)
    shown = StudyView(search, objective, Console())
    rungs = " / ".join(f"{budget:,}" for budget in plan.budgets)
    trials, keys = counted(search.limit, "trial"), counted(len(plan.dimensions), "key")
    what = f"{trials} of {plan.base['algo']['name']} begun, {keys}, {rungs} steps"
    print(f"{study.path}: {len(search.trials)} of {what}", flush=True)
    launcher = backend(config.launcher, target=runs.TARGET, learning=plan.learns)
    result = Controller(study, search, launcher, shown).carry_out()
    if result.signal is not None and (best := shown.best()):
        print(best)
    return result


def _conclude(plan: Plan, study: StudyFolder) -> int:
    """Write the preset and the report, and print the result.

    Return 1 if every trial failed, or if a training with fresh seeds failed; else 0. Single failed trials are allowed.
    """
    from auvbench.reporting import tuning
    from auvbench.tuning import outcome

    result = outcome.read(study)
    best = result.best
    if best is None:
        print(f"{study.path}: every trial failed, so there are no best settings")
    else:
        outcome.write(result, best, tuning.evidence(result))
    trials = tuning.report(result)
    for sentence in tuning.summary(result):
        print(sentence)
    if best is not None:
        name = outcome.name_of(plan)
        print(f"{study.best}: cp it to conf/algo/{name}.yaml, then algo={name}")
    print(f"{trials}", flush=True)
    return int(best is None or bool(result.broken))
