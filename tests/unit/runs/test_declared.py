"""The analysis that an experiment declares: written before the runs, in no run's identity, read without trust."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from auvbench.analysis.measures import measures
from auvbench.config.compose import compose
from auvbench.errors import ConfigError, UserError
from auvbench.record import measure_names
from auvbench.runs import declared, identity
from auvbench.runs.declared import Declared
from auvbench.runs.plan import plan, prepare

ANALYSIS = Declared("par1_time_s", "pid", 1.5, 5)


def settings(folder: Path, *more: str) -> list[str]:
    return ["experiment=quickstart", f"output={folder}", *more]


def test_the_measures_that_can_be_declared_are_those_of_a_report() -> None:
    assert set(measure_names()) == set(measures())


def test_a_run_carries_the_digest_and_its_folder_the_analysis(tmp_path: Path) -> None:
    run = prepare(compose("train", settings(tmp_path)))
    ((file, found),) = declared.find([tmp_path / "quickstart"])
    assert file == tmp_path.resolve() / "quickstart" / declared.FILE
    assert found == Declared("par1_time_s", "pid", 1.0, 5)
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
