"""`auvbench publish`: what is shipped gives the same numbers again, and says nothing of the machine it came from."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from PIL import Image

from auvbench import cli
from auvbench.analysis.archive import FOLLOWING
from auvbench.registry import TASKS
from auvbench.reporting.archive import _compacted
from auvbench.reporting.tables.text_formats import escape
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


@pytest.mark.slow
@pytest.mark.parametrize("study", [(), ("--study", "thesis")])
def test_a_report_of_what_is_shipped_has_the_same_numbers(grid, tmp_path, study):
    assert publish("--pictures", "success_over_time", *study) == 0
    assert report("outputs/grid", "--out", "before", *study) == 0
    assert report("results/grid", "--out", "after", *study) == 0
    names = {path.name for path in (tmp_path / "before").iterdir()}
    assert {"table.csv", "comparisons.csv", "verdicts.json"} <= names
    for name in names & {"table.csv", "verdicts.json"}:
        shipped, before = tmp_path / "results/grid" / name, tmp_path / "before" / name
        assert shipped.read_bytes() == (tmp_path / "after" / name).read_bytes()
        assert_same_numbers(shipped.read_text(), before.read_text())


@pytest.mark.slow
def test_the_verdicts_are_the_claims_of_the_study_and_the_findings(grid, tmp_path):
    assert publish("--pictures", "success_over_time", "--study", "thesis") == 0
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
    assert publish("--pictures", "success_over_time") == 0
    verdicts = json.loads((tmp_path / "results/grid/verdicts.json").read_text())
    assert [v["finding"] for v in verdicts] == list(range(1, len(verdicts) + 1))
    assert all(v["text"] for v in verdicts)
    assert any(v["run_ids"] for v in verdicts)


@pytest.mark.slow
def test_nothing_of_the_machine_is_published(runs, tmp_path):
    for run in runs:
        manifest = json.loads((run / "manifest.json").read_text())
        manifest["host"] = {"name": "secret-host", "cpu": "a processor", "cores": 2, "threads": 1}
        manifest["command"] = "auvbench train -m algo=ppo 'output=/home/somebody/outputs'"
        (run / "manifest.json").write_text(json.dumps(integrity.sealed(manifest)))
        config = yaml.safe_load((run / "config.yaml").read_text())
        (run / "config.yaml").write_text(yaml.safe_dump({**config, "output": "/home/somebody/outputs"}))
    assert publish("--pictures", "success_over_time") == 0
    study = tmp_path / "results/grid"
    texts = [path.read_bytes() for path in study.rglob("*") if path.is_file() and path.suffix != ".parquet"]
    texts += [path.read_text().encode() for path in study.glob("*.json")]
    texts += [pd.read_parquet(path).to_csv().encode() for path in study.glob("*.parquet")]
    assert not any(secret in text for text in texts for secret in (b"secret-host", b"somebody"))
    assert "a processor" in (study / "README.md").read_text()


@pytest.mark.slow
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
    assert publish("--pictures", "success_over_time") == 1
    output = capsys.readouterr()
    (said,) = (line for line in output.out.splitlines() if line.startswith("not published: "))
    assert runs[0].name in said
    assert next(iter(changes)) in said
    assert len(pd.read_parquet("results/grid/runs.parquet")) == len(runs) - 1


@pytest.mark.slow
@pytest.mark.parametrize("old", ["outcome", "return", "step,"])
def test_a_renamed_training_column_costs_the_training_rows_alone(runs, tmp_path, capsys, old: str):
    learner = next(run for run in runs if "ppo" in run.name)
    path = learner / "train" / "episodes.csv"
    path.write_text(path.read_text().replace(old, f"x{old}", 1))
    seal(learner / "manifest.json")
    assert publish("--pictures", "success_over_time") == 1
    assert "lacks the columns" in capsys.readouterr().out
    rows = pd.read_parquet("results/grid/episodes.parquet")
    assert set(rows.loc[rows["run"] == learner.name, "protocol"]) == {"test"}


@pytest.mark.slow
def test_a_condition_may_be_called_as_a_number(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_experiment(tmp_path / "outputs/grid", algorithms=("pid",), protocols={"test": ("1.30",)})
    assert publish("--pictures", "success_over_time") == 0
    assert report("results/grid", "--out", "after") == 0
    assert "PID" in (tmp_path / "after/table.csv").read_text()


@pytest.mark.slow
def test_every_number_is_kept(grid, tmp_path):
    assert publish("--pictures", "success_over_time", "--also", "robustness") == 0
    rows = pd.read_parquet("results/grid/episodes.parquet")
    original = pd.read_csv(grid[0] / "evaluations/test/episodes.csv")
    mine = rows[(rows["run"] == grid[0].name) & (rows["protocol"] == "test")]
    for name in original.columns:
        if name not in FOLLOWING:
            assert mine[name].tolist() == original[name].tolist(), name
    trained = rows[(rows["run"] == grid[0].name) & (rows["protocol"] == "train")]
    assert trained["return"].tolist() == pd.read_csv(grid[0] / "train/episodes.csv")["return"].tolist()
    further = rows[rows["protocol"] == "robustness"]
    assert further["return"].isna().all()
    energy = pd.read_csv(grid[0] / "evaluations/robustness/episodes.csv")["energy_J"]
    mine = further.loc[further["run"] == grid[0].name, "energy_J"]
    assert mine.tolist() == [float(f"{value:.3g}") for value in energy]


@pytest.mark.parametrize("task", list(TASKS))
def test_a_compact_table_has_what_ranks_each_task(task):
    primary = TASKS[task].primary
    needed = "steps" if primary.startswith("par1") else primary.removeprefix("mean_")
    frame = pd.DataFrame({"frequency_hz": [10.0], "outcome": ["success"], needed: [0.12345]})
    frame["return"] = 1.0
    table = _compacted(frame)
    assert table[needed].iloc[0] == pytest.approx(frame[needed].iloc[0], rel=1e-2)
    assert "return" not in table


@pytest.mark.slow
def test_a_compact_study_gives_its_own_table_again(grid, tmp_path):
    assert publish("--pictures", "success_over_time", "--also", "robustness", "--compact") == 0
    rows = pd.read_parquet("results/grid/episodes.parquet")
    assert set(rows["protocol"]) == {"test", "robustness"}
    assert set(rows) == {
        "run",
        "protocol",
        "condition",
        "frequency_hz",
        "episode",
        "outcome",
        "steps",
        "energy_J",
    }
    original = pd.read_csv(grid[0] / "evaluations/test/episodes.csv")
    mine = rows[(rows["run"] == grid[0].name) & (rows["protocol"] == "test")]
    for name in ("outcome", "steps"):
        assert mine[name].tolist() == original[name].tolist()
    np.testing.assert_allclose(mine["energy_J"], original["energy_J"], rtol=5e-3)
    assert report("results/grid", "--out", "after") == 0
    shipped = tmp_path / "results/grid/table.csv"
    assert shipped.read_bytes() == (tmp_path / "after/table.csv").read_bytes()
    assert (
        publish("results/grid", "--pictures", "success_over_time", "--also", "robustness", "--compact") == 0
    )
    again = pd.read_parquet("results/grid/episodes.parquet")
    pd.testing.assert_frame_equal(rows, again)


@pytest.mark.slow
def test_pictures_have_few_colours_and_look_the_same(runs, tmp_path):
    assert publish("--pictures", "success_over_time") == 0
    report = ["report", "results/grid", "--format", "md", "--out", "after"]
    assert cli.main(report) == 0
    shipped, drawn = (tmp_path / f / "figures/success_over_time.png" for f in ("results/grid", "after"))
    assert shipped.stat().st_size < 0.6 * drawn.stat().st_size
    with Image.open(shipped) as few, Image.open(drawn) as many:
        assert few.mode == "P"
        difference = np.asarray(few.convert("RGB"), dtype=int) - np.asarray(many.convert("RGB"), dtype=int)
    assert np.abs(difference).mean() < 1.0


@pytest.mark.slow
def test_conditions_of_all_protocols_are_one_table(runs, tmp_path):
    assert publish("--pictures", "success_over_time", "--also", "robustness") == 0
    rows = pd.read_csv(tmp_path / "results/grid/conditions.csv")
    assert set(rows["protocol"]) == {"robustness"}
    assert len(set(rows["condition"])) > 1
    assert cli.main(["publish", "outputs/grid", "--to", "results/x", "--also", "transfer"]) == 2


@pytest.mark.slow
def test_what_a_person_wrote_stays(runs, tmp_path, capsys):
    assert publish("--pictures", "success_over_time") == 0
    assert "next: replace the brackets" in capsys.readouterr().out
    readme = tmp_path / "results/grid/README.md"
    readme.write_text(
        "# Mine\n\nThe answer.\n\n" + readme.read_text().partition("\n")[2].replace("PPO", "XXX")
    )
    assert publish("--pictures", "success_over_time") == 0
    text = readme.read_text()
    assert text.startswith("# Mine\n\nThe answer.")
    assert "XXX" not in text
    assert "PPO" in text
    readme.write_text("# Mine\n")
    assert publish("--pictures", "success_over_time") == 2
    assert "<!-- begin: table -->" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "said"),
    [("difference_from_baseline", "leave it out"), ("success_over_tim", "success_over_time")],
)
def test_the_main_figure_is_not_asked_for_again(name, said, capsys):
    assert publish("--pictures", name) == 2
    assert f"--pictures {name}" in (err := capsys.readouterr().err)
    assert said in err


@pytest.mark.slow
def test_published_again_from_what_was_published_is_the_same(runs):
    assert publish("--pictures", "success_over_time") == 0
    before = parquet("results/grid")
    for to in ("results/grid", "results/copy"):
        assert cli.main(["publish", "results/grid", "--to", to, "--pictures", "success_over_time"]) == 0
        assert parquet(to) == before


def parquet(folder: str) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in Path(folder).glob("*.parquet")}


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["outputs/grid"], "--to"),
        (["outputs/grid", "--to", "x", "--out", "y"], "--to DIR names the folder"),
        (["outputs/grid", "--to", "a-file"], "is a file"),
        (["outputs/grid", "--to", "x", "--pictures", "success_over_tim"], "did you mean 'success_over_time'"),
        (["outputs/nothing", "--to", "x"], "no such file or directory"),
        (["outputs/grid", "--to", "x", "--protocol", "thesis"], "robustness, test"),
        (["outputs/grid", "--to", "x", "--also", "transfer"], "evaluated by protocol 'transfer'"),
        (["outputs/grid", "--to", "x", "--baseline", "pdi"], "--baseline 'pdi' is not one of the agents"),
        (["outputs/grid", "--to", "x", "--columns", "energies"], "energies"),
        (["outputs/grid", "--to", "x", "--rank-by", "luck"], "luck"),
    ],
)
def test_mistakes_are_said_before_anything_is_written(runs, arguments, said, tmp_path, capsys):
    (tmp_path / "a-file").write_text("mine")
    assert cli.main(["publish", *arguments]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "x").exists()
