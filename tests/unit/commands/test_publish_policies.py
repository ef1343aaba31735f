"""`auvbench publish --policies`: each agent's best run as a file, kept, replaced, and other files left alone."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

pytest.importorskip("onnx")

from auvbench import cli
from tests.numbers import assert_same_numbers
from tests.synthetic import seal, write_evaluation
from tests.unit.evaluation.test_policies_as_files import trained
from tests.unit.runs.test_damage import frozen

TO = Path("results/study")


@pytest.fixture
def runs(tmp_path, monkeypatch):
    """Two PPO of which the second is better, and a PID, all tested."""
    monkeypatch.chdir(tmp_path)
    made = [trained(Path("outputs"), "algo=ppo", f"seed={seed}") for seed in (0, 1)]
    made.append(frozen(Path("outputs"), "algo=pid", state="complete"))
    for run in made:
        write_evaluation(run.path, "test", ("nominal",), 20)
    better(made[0], made[1])
    return made


def better(worse, best):
    """Makes all episodes of one run successes, and of the other collisions."""
    for run, outcome in ((worse, "collision"), (best, "success")):
        folder = write_evaluation(run.path, "test", ("nominal",), 20)
        rows = (folder / "episodes.csv").read_text()
        for name in ("success", "collision", "timeout"):
            rows = rows.replace(name, outcome)
        (folder / "episodes.csv").write_text(rows)
        summary = json.loads((folder / "summary.json").read_text())
        for condition in summary["conditions"]:
            for name in ("success", "collision", "timeout"):
                condition[f"{name}_rate"] = float(name == outcome)
        seal(folder / "summary.json", summary)


def publish(*words: str) -> int:
    return cli.main(["publish", *words, "--to", str(TO), "--pictures", "success_over_time"])


def there() -> list[str]:
    return sorted(path.name for path in (TO / "policies").iterdir())


def table(folder: str) -> str:
    assert cli.main(["report", folder, "--format", "csv", "--no-figures", "--out", "some-report"]) == 0
    return Path("some-report/table.csv").read_text()


@pytest.mark.slow
def test_the_best_of_each_agent_is_exported_and_named(runs):
    assert publish("outputs", "--policies") == 0
    name = runs[1].id
    assert there() == [f"{name}.json", f"{name}.onnx"]
    readme = (TO / "README.md").read_text()
    assert f"100.0 | [{name}.onnx](<policies/{name}.onnx>)" in readme
    assert table(str(TO)) == (TO / "table.csv").read_text()
    assert_same_numbers(table(str(TO)), table("outputs"), rel=1e-2)  # a wide interval ends near zero


@pytest.mark.slow
def test_what_is_there_is_kept_also_without_the_weights(runs, capsys):
    assert publish("outputs", "--policies") == 0
    file = TO / "policies" / f"{runs[1].id}.onnx"
    before = file.stat().st_mtime_ns
    readme = (TO / "README.md").read_text()
    for words in (("outputs", "--policies"), (str(TO), "--policies"), ("outputs",)):
        assert publish(*words) == 0
        assert file.stat().st_mtime_ns == before
        assert f"policies/{runs[1].id}.onnx" in (TO / "README.md").read_text()
    for name in there():
        (TO / "policies" / name).unlink()
    assert publish(str(TO), "--policies") == 1
    said = capsys.readouterr().out
    assert f"cannot export a policy of PPO ({runs[1].id}): its weights are not in the given folders" in said
    assert "weights are not" in (TO / "README.md").read_text()
    assert there() == []
    assert "## Policies" in readme


@pytest.mark.slow
def test_one_that_is_no_longer_best_goes_and_others_files_stay(runs, capsys):
    assert publish("outputs", "--policies") == 0
    policies = TO / "policies"
    old = policies / f"{runs[1].id}.onnx"
    (policies / "mine.onnx").write_bytes(old.read_bytes())
    (policies / "mine.json").write_bytes(old.with_suffix(".json").read_bytes())
    better(runs[1], runs[0])
    assert publish("outputs", "--policies") == 0
    assert "no longer the best of its algorithm" in capsys.readouterr().out
    assert there() == sorted([f"{runs[0].id}.json", f"{runs[0].id}.onnx", "mine.json", "mine.onnx"])


@pytest.mark.slow
def test_damaged_weights_are_named_and_the_study_is_there(runs, capsys):
    weights = runs[1].model / "policy.pt"
    weights.write_bytes(weights.read_bytes()[:-1])
    assert publish("outputs", "--policies") == 1
    assert f"cannot export a policy of PPO ({runs[1].id}): " in capsys.readouterr().out
    assert (TO / "table.csv").is_file()


@pytest.mark.slow
def test_of_equals_the_first_by_id(runs):
    better(runs[0], runs[0])
    better(runs[1], runs[1])
    assert publish("outputs", "--policies", "--rank-by", "success_rate") == 0
    assert there()[1] == f"{min(runs[0].id, runs[1].id)}.onnx"


@pytest.mark.slow
def test_a_missing_extra_is_said_before_anything_is_written(runs, capsys, monkeypatch):
    import importlib.util

    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *a: None if name == "onnx" else find(name, *a)
    )
    assert publish("outputs", "--policies") == 2
    assert "auvbench[onnx]" in capsys.readouterr().err
    assert not TO.exists()


@pytest.mark.slow
def test_a_readme_without_a_place_is_said_before_anything_is_written(runs, capsys):
    assert publish("outputs") == 0
    before = {path: path.read_bytes() for path in TO.rglob("*") if path.is_file()}
    assert publish("outputs", "--policies") == 2
    assert "<!-- begin: policies -->" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in TO.rglob("*") if path.is_file()} == before
