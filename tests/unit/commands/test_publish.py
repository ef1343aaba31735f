"""`auvbench publish`: what is shipped gives the same numbers again, and says nothing of the machine it came from."""

from __future__ import annotations

import bz2
import csv
import io
import json
import os
import shutil

import numpy as np
import pandas as pd
import pytest
import yaml
from PIL import Image

from auvbench import cli
from auvbench.analysis.derived_columns import FOLLOWING
from auvbench.record import SCENARIO_COLUMNS
from auvbench.reporting.shipped import (
    DIGITS,
    FURTHER_COLUMNS,
    FURTHER_DIGITS,
    TRAINING_COLUMNS,
    TRAINING_DIGITS,
    rounded,
)
from auvbench.reporting.tables.markdown import escape
from auvbench.runs import integrity
from tests.numbers import assert_same_numbers
from tests.synthetic import seal, write_experiment

PROTOCOLS = {"test": ("nominal",), "robustness": ("nominal", "current=0.5")}


@pytest.fixture
def runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return write_experiment(
        tmp_path / "outputs" / "grid", algorithms=("ppo", "pid"), protocols=PROTOCOLS, train_episodes=30
    )


@pytest.fixture
def grid(once, tmp_path, monkeypatch):
    """A grid whose report has claims, groups and findings; the first run is a learner's."""
    monkeypatch.chdir(tmp_path)

    def make(folder):
        write_experiment(
            folder / "grid",
            algorithms=("ppo", "sac", "pid"),
            reward_k=(1, 100),
            frequencies=(10, 25),
            seeds=(0, 1, 2),
            protocols=PROTOCOLS,
            train_episodes=30,
        )

    shutil.copytree(once("grid-to-publish", make), "outputs")
    return sorted(tmp_path.glob("outputs/grid/*"), key=lambda run: (run.name.startswith("pid"), run.name))


def publish(*more: str) -> int:
    return cli.main(["publish", "outputs/grid", "--to", "results/grid", *more])


def report(*arguments: str) -> int:
    return cli.main(["report", *arguments, "--format", "csv", "--no-figures"])


@pytest.mark.parametrize("study", [(), ("--study", "thesis")])
def test_a_report_of_what_is_shipped_has_the_same_numbers(grid, tmp_path, study):
    assert publish("--pictures", "failures", *study) == 0
    assert report("outputs/grid", "--out", "before", *study) == 0
    assert report("results/grid", "--out", "after", *study) == 0
    names = {path.name for path in (tmp_path / "before").iterdir()}
    assert {"table.csv", "comparisons.csv", "verdicts.json"} <= names
    for name in names:
        shipped, before = tmp_path / "results/grid" / name, tmp_path / "before" / name
        assert shipped.read_bytes() == (tmp_path / "after" / name).read_bytes()
        assert_same_numbers(shipped.read_text(), before.read_text())


@pytest.mark.slow
def test_the_verdicts_are_the_claims_of_the_study_and_the_findings(grid, tmp_path):
    assert publish("--pictures", "failures", "--study", "thesis") == 0
    verdicts = json.loads((tmp_path / "results/grid/verdicts.json").read_text())
    claims = [v for v in verdicts if "claim" in v]
    assert [v["claim"] for v in claims] == list(range(1, 8))
    assert {v["verdict"] for v in claims} <= {"holds", "does not hold", "cannot be said"}
    text = (tmp_path / "results/grid/README.md").read_text()
    assert all(f"{v['claim']}. " in text for v in claims)
    findings = verdicts[len(claims) :]
    assert [v["finding"] for v in findings] == list(range(1, len(findings) + 1))
    assert findings
    said = text.partition("<!-- begin: findings -->")[2].partition("<!-- end: findings -->")[0]
    assert said.count("\n* ") == len(findings)
    assert all(escape(v["text"]) in said for v in findings)


@pytest.mark.slow
def test_without_a_study_the_verdicts_are_the_findings(grid, tmp_path):
    assert publish("--pictures", "failures") == 0
    verdicts = json.loads((tmp_path / "results/grid/verdicts.json").read_text())
    assert [v["finding"] for v in verdicts] == list(range(1, len(verdicts) + 1))
    assert all(v["text"] for v in verdicts)
    assert any(v["run_ids"] for v in verdicts)


def test_nothing_of_the_machine_and_nothing_that_only_training_needs(runs, tmp_path):
    for run in runs:
        manifest = json.loads((run / "manifest.json").read_text())
        manifest["host"] = {"name": "secret-host", "cpu": "a processor", "cores": 2, "threads": 1}
        manifest["command"] = "auvbench train -m algo=ppo 'output=/home/somebody/outputs'"
        (run / "manifest.json").write_text(json.dumps(integrity.sealed(manifest)))
        config = yaml.safe_load((run / "config.yaml").read_text())
        (run / "config.yaml").write_text(yaml.safe_dump({**config, "output": "/home/somebody/outputs"}))
    assert publish("--pictures", "failures") == 0
    shipped = tmp_path / "results/grid"
    for path in shipped.rglob("*"):
        if path.is_file():
            data = path.read_bytes()
            data = bz2.decompress(data) if path.suffix == ".bz2" else data
            for secret in (b"secret-host", b"somebody"):
                assert secret not in data, path
    kinds = {path.name for path in shipped.glob("runs/*/**/*") if path.is_file()}
    assert kinds == {"config.yaml", "manifest.json", "summary.json", "episodes.csv.bz2", "trajectories.npz"}
    assert not list(shipped.glob("runs/*/evaluations/robustness/*.npz"))
    assert "a processor" in (shipped / "README.md").read_text()


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("manifest.json", {"wall_time_s": {}}),
        ("manifest.json", {"cpu_time_s": "nan"}),
        ("manifest.json", {"host": [1]}),
        ("evaluations/test/summary.json", {"versions": [1]}),
    ],
)
def test_an_entry_of_another_type_costs_its_run_alone(
    runs, tmp_path, capsys, name: str, changes: dict[str, object]
):
    path = runs[0] / name
    path.write_text(json.dumps(integrity.sealed(json.loads(path.read_text()) | changes)))
    assert publish("--pictures", "failures") == 1
    output = capsys.readouterr()
    (said,) = (line for line in output.out.splitlines() if line.startswith("not published: "))
    assert runs[0].name in said
    assert next(iter(changes)) in said
    assert len(list((tmp_path / "results/grid/runs").iterdir())) == len(runs) - 1


@pytest.mark.parametrize("old", ["outcome", "final_distance_m", "step,"])
def test_a_renamed_training_column_costs_the_training_rows_alone(runs, tmp_path, capsys, old: str):
    learner = next(run for run in runs if "ppo" in run.name)
    path = learner / "train" / "episodes.csv"
    path.write_text(path.read_text().replace(old, f"x{old}", 1))
    seal(learner / "manifest.json")
    assert publish("--pictures", "failures") == 1
    assert "lacks the columns" in capsys.readouterr().out
    copy = tmp_path / "results/grid/runs" / learner.name
    assert (copy / "evaluations/test/episodes.csv.bz2").is_file()
    assert not (copy / "train").exists()


def test_what_a_row_is_known_by_is_not_rounded():
    rows = b"condition,frequency_hz,steps,energy_J\n1.30,33.333333333333336,17,12345.678912345\n"
    assert rounded(rows, 9) == rows.replace(b"678912345", b"6789")
    assert rounded(rows, 5, ("condition", "steps")) == b"condition,steps\n1.30,17\n"


def test_a_condition_may_be_called_as_a_number(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_experiment(tmp_path / "outputs/grid", algorithms=("pid",), protocols={"test": ("1.30",)})
    assert publish("--pictures", "failures") == 0
    assert report("results/grid", "--out", "after") == 0
    assert "PID" in (tmp_path / "after/table.csv").read_text()


@pytest.mark.slow
def test_rows_are_complete_and_vouched_for(grid, tmp_path):
    assert publish("--pictures", "failures", "--also", "robustness") == 0
    (shipped,) = (tmp_path / "results/grid/runs").glob(f"{grid[0].name}")
    rows = bz2.decompress((shipped / "evaluations/test/episodes.csv.bz2").read_bytes())
    elsewhere = [*SCENARIO_COLUMNS, *FOLLOWING]
    original = pd.read_csv(grid[0] / "evaluations/test/episodes.csv").drop(columns=elsewhere)
    pd.testing.assert_frame_equal(
        pd.read_csv(io.BytesIO(rows)), original, rtol=0.5 * 10.0 ** (1 - DIGITS), atol=0.0
    )
    further = bz2.decompress((shipped / "evaluations/robustness/episodes.csv.bz2").read_bytes())
    kept = [name for name in FURTHER_COLUMNS if name not in FOLLOWING]
    assert next(csv.reader([further.decode().splitlines()[0]])) == kept
    for table, digits in ((rows, DIGITS), (further, FURTHER_DIGITS)):
        for row in csv.DictReader(table.decode().splitlines()):
            assert row["energy_J"] == repr(float(f"{float(row['energy_J']):.{digits}g}"))
    training = bz2.decompress((shipped / "train/episodes.csv.bz2").read_bytes()).decode().splitlines()
    assert set(next(csv.reader(training))) == {"outcome", "step", "steps", "return", "final_distance_m"}
    assert len(training) == 31
    full = pd.read_csv(grid[0] / "train/episodes.csv")
    pd.testing.assert_frame_equal(
        pd.read_csv(io.StringIO("\n".join(training))),
        full[[*TRAINING_COLUMNS]],
        rtol=0.5 * 10.0 ** (1 - TRAINING_DIGITS),
        atol=0.0,
    )
    for row in csv.DictReader(training):
        assert float(row["return"]) == float(f"{float(row['return']):.{TRAINING_DIGITS}g}")
    text = rows.replace(b"success", b"timeout", 1)
    assert text != rows
    (shipped / "evaluations/test/episodes.csv.bz2").write_bytes(bz2.compress(text))
    assert report("results/grid", "--out", "after") == 0  # the others are reported
    with open(tmp_path / "after/table.csv", newline="") as file:
        counted = {row["agent"]: row["seeds"] for row in csv.DictReader(file)}
    assert sorted(len(s.split()) for s in counted.values()) == [1, 2, 3, 3, 3, 3, 3, 3, 3]


@pytest.mark.slow
def test_pictures_have_few_colours_and_look_the_same(runs, tmp_path):
    assert publish("--pictures", "failures") == 0
    report = ["report", "results/grid", "--format", "md", "--out", "after"]
    assert cli.main(report) == 0
    shipped, drawn = (tmp_path / f / "figures/failures.png" for f in ("results/grid", "after"))
    assert shipped.stat().st_size < 0.6 * drawn.stat().st_size
    with Image.open(shipped) as few, Image.open(drawn) as many:
        assert few.mode == "P"
        difference = np.asarray(few.convert("RGB"), dtype=int) - np.asarray(many.convert("RGB"), dtype=int)
    assert np.abs(difference).mean() < 1.0


def test_other_protocols_get_tables_of_their_own(runs, tmp_path):
    assert publish("--pictures", "failures", "--also", "robustness") == 0
    assert (tmp_path / "results/grid/robustness/conditions.csv").is_file()
    assert cli.main(["publish", "outputs/grid", "--to", "results/x", "--also", "transfer"]) == 2


def test_the_closing_line_says_what_takes_the_room_and_what_is_the_author_s(runs, capsys):
    assert publish("--pictures", "failures", "--question", "Which?") == 0
    *_, last, closing = capsys.readouterr().out.splitlines()
    assert "README.md: question and answer are the author's" in last
    kinds = ["test episodes", "training rows", "paths", "figures", "the rest"]
    assert [part.rpartition(" ")[0] for part in closing.partition(": ")[2].split(", ")] == kinds
    assert publish("--pictures", "failures", "--question", "Which other?") == 0
    assert "its own question stays" in capsys.readouterr().out


def test_what_a_person_wrote_stays_and_what_is_gone_goes(runs, tmp_path, capsys):
    assert publish("--pictures", "failures") == 0
    readme = tmp_path / "results/grid/README.md"
    readme.write_text(
        "# Mine\n\nThe answer.\n\n" + readme.read_text().partition("\n")[2].replace("PPO", "XXX")
    )
    shutil.rmtree(runs[0])
    assert publish("--pictures", "failures") == 0
    text = readme.read_text()
    assert text.startswith("# Mine\n\nThe answer.")
    assert "XXX" not in text
    assert "PPO" in text
    assert not (tmp_path / "results/grid/runs" / runs[0].name).exists()
    assert f"removed results/grid/runs/{runs[0].name}" in capsys.readouterr().out
    readme.write_text("# Mine\n")
    assert publish("--pictures", "failures") == 2
    assert "<!-- begin: table -->" in capsys.readouterr().err


@pytest.mark.slow
def test_published_once_more_from_what_was_published(runs, tmp_path):
    assert publish("--pictures", "failures") == 0
    before = {p: p.read_bytes() for p in (tmp_path / "results/grid/runs").rglob("*") if p.is_file()}
    assert cli.main(["publish", "results/grid", "--to", "results/grid", "--pictures", "failures"]) == 0
    assert {p: p.read_bytes() for p in (tmp_path / "results/grid/runs").rglob("*") if p.is_file()} == before
    assert cli.main(["publish", "results/grid", "--to", "results/copy", "--pictures", "failures"]) == 0
    copies = {
        p.relative_to(tmp_path / "results/copy"): p.read_bytes()
        for p in (tmp_path / "results/copy/runs").rglob("*")
        if p.is_file()
    }
    assert os.listdir("results/copy/scenarios") == os.listdir("results/grid/scenarios")
    assert copies == {p.relative_to(tmp_path / "results/grid"): data for p, data in before.items()}


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["outputs/grid"], "--to"),
        (["outputs/grid", "--to", "x", "--out", "y"], "--to DIR is the folder"),
        (["outputs/grid", "--to", "a-file"], "is a file"),
        (["outputs/grid", "--to", "x", "--question", ""], "give one line of text"),
        (["outputs/grid", "--to", "x", "--title", "a\nb"], "give one line of text"),
        (["outputs/grid", "--to", "x", "--pictures", "failure"], "did you mean 'failures'"),
        (["outputs/nothing", "--to", "x"], "no such folder"),
        (["outputs/grid", "--to", "x", "--protocol", "thesis"], "robustness, test"),
        (["outputs/grid", "--to", "x", "--also", "transfer"], "evaluated by protocol 'transfer'"),
        (["outputs/grid", "--to", "x", "--baseline", "pdi"], "--baseline 'pdi' is not among the agents"),
        (["outputs/grid", "--to", "x", "--columns", "energies"], "energies"),
        (["outputs/grid", "--to", "x", "--rank-by", "luck"], "luck"),
    ],
)
def test_mistakes_are_said_before_anything_is_written(runs, arguments, said, tmp_path, capsys):
    (tmp_path / "a-file").write_text("mine")
    assert cli.main(["publish", *arguments]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "x").exists()
