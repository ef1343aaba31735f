"""The analysis that an experiment declares: written before the runs, in no run's identity, read without trust."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from auvbench.analysis.measures import measures
from auvbench.config.compose import compose
from auvbench.errors import ConfigError, UserError
from auvbench.record import measure_names
from auvbench.runs import declared, identity
from auvbench.runs.declared import Declared
from auvbench.runs.plan import freeze_all, plan, prepare

ANALYSIS = Declared("par1_time_s", "pid", 1.5, 5)


def settings(folder: Path, *more: str) -> list[str]:
    return ["experiment=quickstart", f"output={folder}", *more]


def test_the_measures_that_can_be_declared_are_those_of_a_report() -> None:
    assert set(measure_names()) == set(measures())


def test_a_run_carries_the_digest_and_its_folder_the_analysis(tmp_path: Path) -> None:
    run = prepare(compose("train", settings(tmp_path)))
    ((file, found),) = declared.find([tmp_path / "quickstart"])
    assert file == tmp_path.resolve() / "quickstart" / declared.FILE
    assert (found.measure, found.baseline, found.margin, found.seeds) == ("par1_time_s", "pid", 1.0, 5)
    assert (found.protocol, found.conditions, found.episodes, found.scenario_seed) == (
        "test",
        ("nominal",),
        25,
        123,
    )
    assert [stage.runs for stage in found.rows] == [{"bluerov2_2026": [run.id]}]
    assert run.manifest()[declared.KEY] == found.digest
    assert declared.KEY not in run.config()


@pytest.mark.slow
def test_the_same_run_serves_another_analysis(tmp_path: Path) -> None:
    first = prepare(compose("train", settings(tmp_path)))
    other = settings(tmp_path, "analysis.measure=success_rate", "analysis.margin=2")
    assert plan(compose("train", other)).run.path == first.path
    before = first.manifest()[declared.KEY]
    assert prepare(compose("train", other)).path == first.path
    ((_, found),) = declared.find([tmp_path / "quickstart"])
    assert found.measure == "success_rate"
    assert first.manifest()[declared.KEY] == before != found.digest


def test_a_run_without_an_experiment_declares_nothing(tmp_path: Path) -> None:
    run = prepare(compose("train", [f"output={tmp_path}"]))
    assert declared.KEY not in run.manifest()
    assert declared.find([tmp_path]) == []


def test_it_is_no_part_of_an_identity() -> None:
    config = {"algo": {"name": "pid", "agent": "pid"}, "seed": 0}
    assert identity.relevant(config) == identity.relevant(config | {declared.KEY: {"measure": "x"}})


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("analysis.measure=succes_rate", "did you mean 'success_rate'"),
        ("analysis.margin=0", "analysis.margin=0: must be more than 0"),
        ("analysis.seeds=0", "analysis.seeds=0"),
        ("analysis.seed=5", "seed"),
        ("analysis.protocol=tset", "analysis.protocol=tset: did you mean 'test'"),
        ("analysis.conditions=[nominl]", "analysis.conditions=nominl"),
    ],
)
def test_a_wrong_value_is_said_before_anything_is_written(tmp_path: Path, override: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        prepare(compose("train", settings(tmp_path, override)))
    assert not list(tmp_path.iterdir())


def test_the_digest_is_of_what_was_declared() -> None:
    assert replace(ANALYSIS, margin=1.5).digest == ANALYSIS.digest
    assert replace(ANALYSIS, report={"columns": ["par1_steps"]}).digest == ANALYSIS.digest
    for change in ({"measure": "par1_steps"}, {"baseline": None}, {"margin": 2.0}, {"seeds": 3}):
        assert replace(ANALYSIS, **change).digest != ANALYSIS.digest  # type: ignore[arg-type]


def test_what_is_written_is_read_back(tmp_path: Path) -> None:
    stored = replace(ANALYSIS, report={"protocol": "gazebo"})
    declared.write(tmp_path, stored)
    assert declared.read(tmp_path / declared.FILE) == stored
    before = (tmp_path / declared.FILE).stat().st_mtime_ns
    declared.write(tmp_path, stored)
    assert (tmp_path / declared.FILE).stat().st_mtime_ns == before


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[", "did not find expected node"),
        ("- a", "must be"),
        ("baseline: pid", "measure is missing"),
        ("measure: luck", "measure 'luck'"),
        ("{measure: success_rate, marginn: 2}", "did you mean 'margin'"),
        ("{measure: success_rate, margin: .inf}", "margin is inf"),
        ("{measure: success_rate, margin: 0}", "margin is 0"),
        ("{measure: success_rate, margin: true}", "margin is True"),
        ("{measure: success_rate, seeds: 1.5}", "seeds is 1.5"),
        ("{measure: success_rate, baseline: [1]}", "baseline"),
        ("{measure: success_rate, report: 5}", "report is 5"),
        ("{measure: success_rate, protocol: test}", "conditions and rows must not be empty"),
        ("{measure: success_rate, rows: [{declared: today}]}", "rows.0..runs is missing"),
    ],
)
def test_a_damaged_file_is_one_line(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / declared.FILE).write_text(text)
    with pytest.raises(UserError, match=said) as error:
        declared.read(tmp_path / declared.FILE)
    assert "\n" not in str(error.value)


def test_it_is_found_from_any_folder_above_a_run(tmp_path: Path) -> None:
    study, run = tmp_path / "results" / "study", tmp_path / "results" / "study" / "runs" / "pid-1"
    run.mkdir(parents=True)
    (run / "manifest.json").write_text("{}")
    declared.write(study, ANALYSIS)
    for path in (tmp_path / "results", study, study / "runs", run):
        assert [found for _, found in declared.find([path, path])] == [ANALYSIS]
    assert declared.find([tmp_path]) == []


WHOLE = Declared("par1_time_s", "pid", 1.5, 5, "test", ("nominal",), 25, 123)


def test_each_stage_has_a_digest_of_everything_declared_by_then(tmp_path: Path) -> None:
    one = declared.declare(tmp_path, WHOLE, {"bluerov2": ["a", "b"]}, "2026-11-25T00:00:00+00:00")
    two = declared.declare(tmp_path, WHOLE, {"bluerov2": ["b", "c"]}, "2026-11-27T00:00:00+00:00")
    assert two.digests == [one.digest, two.digest]
    assert [stage.runs for stage in two.rows] == [{"bluerov2": ["a", "b"]}, {"bluerov2": ["c"]}]
    assert two.stage_of("b") == (two.rows[0], one.digest)
    assert two.stage_of("c") == (two.rows[1], two.digest)
    assert two.stage_of("d") is None
    assert two.extends(one)
    assert not one.extends(two)
    assert declared.read(tmp_path / declared.FILE) == two
    again = declared.declare(tmp_path, WHOLE, {"bluerov2": ["c", "a"]}, "2026-11-28T00:00:00+00:00")
    assert again == two


@pytest.mark.parametrize(
    "change",
    [
        {"protocol": "suite"},
        {"conditions": ("nominal", "current=1")},
        {"episodes": 26},
        {"scenario_seed": 124},
        {"rows": (declared.Stage("2026-11-25T00:00:00+00:00", {"bluerov2": ["a"]}),)},
    ],
)
def test_the_digest_covers_protocol_conditions_and_runs(change: dict[str, Any]) -> None:
    whole = replace(WHOLE, rows=(declared.Stage("2026-11-25T00:00:00+00:00", {"bluerov2": ["a", "b"]}),))
    assert replace(whole, **change).digest != whole.digest


def test_a_declaration_of_an_earlier_version_keeps_its_digest() -> None:
    shipped = Declared("primary", "pid", None, None)
    assert shipped.digest == "efe133c5b4fdccd3"
    assert not shipped.names_runs


def test_another_analysis_declares_its_runs_anew(tmp_path: Path) -> None:
    declared.declare(tmp_path, WHOLE, {"bluerov2": ["a"]}, "2026-11-25T00:00:00+00:00")
    other = declared.declare(
        tmp_path, replace(WHOLE, margin=2.0), {"bluerov2": ["b"]}, "2026-11-27T00:00:00+00:00"
    )
    assert other.ids() == {"b"}


def test_a_grid_is_declared_as_a_whole_before_its_runs(tmp_path: Path) -> None:
    plans = [plan(compose("train", settings(tmp_path, "algo=pid", f"seed={seed}"))) for seed in (0, 1)]
    runs = freeze_all(plans)
    ((_, found),) = declared.find([tmp_path])
    assert [stage.runs for stage in found.rows] == [{"bluerov2_2026": [run.id for run in runs]}]
    assert {run.manifest()[declared.KEY] for run in runs} == {found.digest}


def test_the_lock_of_a_declaration_is_no_link(tmp_path: Path) -> None:
    target = tmp_path / "other"
    target.write_text("kept")
    (tmp_path / declared.LOCK).symlink_to(target)
    with pytest.raises(UserError, match="symbolic link"):
        declared.declare(tmp_path, WHOLE, {"bluerov2": ["a"]}, "2026-11-25T00:00:00+00:00")
    assert target.read_text() == "kept"
