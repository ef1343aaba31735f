"""Settings are searched in the task, noise, disturbances and at the frequency that were typed."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from auvbench import cli
from auvbench.commands import tune
from auvbench.config import schema
from auvbench.config.compose import compose
from auvbench.evaluation.protocol import resolve_conditions
from auvbench.tuning import runs
from auvbench.tuning.folder import Plan, StudyFolder, of_run

TYPED = (
    "algo=pid",
    "task=station_keeping",
    "disturbance=sea_state_3",
    "disturbance.current.speed=0.8",
    "task.station=[0,0,-5]",
    "noise.scale=2",
    "step.frequency=20",
)
BRIEF = (
    "tune.trials=1",
    "tune.startup=1",
    "tune.fresh_seeds=[7]",
    "protocol.episodes=2",
    "launcher.workers=1",
)


def circumstances(folder: Path, *arguments: str) -> list[schema.TrainConfig]:
    """The configurations in which a trial, and a run with fresh seeds, are tested."""
    words, ranges, fixed = tune.split([*arguments, f"output={folder}"])
    plan, study = tune.plan_of(compose("tune", words), ranges, fixed)
    config = runs.configuration(plan, study, plan.base["algo"], 0, plan.budgets[-1])
    return [
        resolve_conditions(protocol, config)[0].config for protocol in (plan.protocol, plan.fresh_protocol)
    ]


def test_trials_are_tested_in_what_was_typed(tmp_path: Path) -> None:
    for config in circumstances(tmp_path, *TYPED):
        assert config.disturbance.waves.height > 0
        assert config.disturbance.current.speed == 0.8
        assert config.task.station == [0, 0, -5]
        assert (config.noise.scale, config.step.frequency) == (2, 20)


def test_an_experiment_s_values_count_as_typed_ones(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    experiment = Path("conf/experiment/sea.yaml")
    experiment.parent.mkdir(parents=True)
    experiment.write_text("# @package _global_\ndefaults: [{override /disturbance: sea_state_2}]\n")
    (config, _) = circumstances(tmp_path, "algo=pid", "experiment=sea")
    assert config.disturbance.name == "sea_state_2"


def test_a_value_in_a_grid_of_an_experiment_is_not_searched(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    experiment = Path("conf/experiment/fixed.yaml")
    experiment.parent.mkdir(parents=True)
    experiment.write_text(
        "# @package _global_\nhydra:\n  mode: MULTIRUN\n  sweeper:\n    grids:\n"
        "      - {algo: pid, algo.bandwidth: '1.5'}\n      - {algo: lqr}\n"
    )
    plans: list[Plan] = []
    monkeypatch.setattr(tune, "_study", lambda plan, study, config: plans.append(plan) or 0)
    assert cli.main(["tune", "experiment=fixed"]) == 0
    pid, lqr = plans
    assert pid.base["algo"]["bandwidth"] == 1.5
    assert "algo.bandwidth" not in pid.tune.space
    assert {"algo.cruise_speed", "algo.approach"} <= pid.tune.space.keys() & lqr.tune.space.keys()
    capsys.readouterr()
    assert cli.main(["tune", "experiment=fixed", "algo=pid", "algo.bandwidth=interval(1.0,2.0)"]) == 2
    assert "fixed by algo.bandwidth=1.5 and searched by" in capsys.readouterr().err


def test_typed_overrides_of_the_protocol_choose_other_conditions(tmp_path: Path) -> None:
    overrides = "protocol.overrides=['task=same','noise=thesis','disturbance=unknown_vehicle']"
    (config, _) = circumstances(tmp_path, "algo=pid", overrides)
    assert config.disturbance.name == "unknown_vehicle"


@pytest.mark.parametrize(
    ("word", "group"),
    [
        ("disturbance=sea_state_2", "disturbance"),
        ("disturbance.current.speed=0.5", "disturbance"),
        ("task.goal_radius=2", "task"),
        ("noise=none", "noise"),
        ("step.frequency=20", "step"),
    ],
)
def test_a_value_that_no_test_and_no_training_uses_is_refused(
    word: str, group: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["tune", "algo=pid", "protocol=validation", word, f"output={tmp_path}"]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert f"{word}: has no effect, because protocol=validation sets its own {group}" in error
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_study_is_of_the_conditions_that_were_typed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    typed = ["tune", *TYPED, *BRIEF, f"output={tmp_path}"]
    assert cli.main(typed) in (0, 1)  # one trial may show no gain
    study = StudyFolder(tmp_path / "tune" / "pid")
    plan = json.loads(study.plan_path.read_text())
    assert plan["base"]["disturbance"]["current"]["speed"] == 0.8
    made = [path.parent for path in study.path.glob("*/*/manifest.json")]
    assert len(made) == 3
    for run in made:
        found: Plan = of_run(run)[0]
        summary = json.loads(next(run.glob("evaluations/*/summary.json")).read_text())
        assert [c["frequency_hz"] for c in summary["conditions"]] == [20]
        assert found.protocol.overrides == []
    calm = [word for word in typed if not word.startswith("disturbance")]
    capsys.readouterr()
    assert cli.main(calm) == 2
    assert "disturbance.current.speed 0.8 -> 0.0" in capsys.readouterr().err
