"""The published studies: a report of their files gives the numbers that are shipped, and the pages quote them rightly."""

import csv
import json
import re
from collections import Counter
from pathlib import Path

import pandas as pd
import pytest

from auvbench.cli import main
from tests.numbers import assert_same_numbers

ROOT = Path(__file__).parents[2]
STUDIES = {
    "thesis": ["--study", "thesis"],
    "leaderboard": ["--rank-by", "par1_steps", "--columns", "action_ms,training_cpu_s"],
    "defaults": [],
    "differences": [],
    "gazebo": ["--protocol", "gazebo", "--rank-by", "par1_steps"],
    "robust": [],
    "station": ["--protocol", "models_sea"],
    "suite": [],
}

SINGLE = ("defaults",)
"""studies in which not two agents have several training seeds"""

SECTIONS = ("differences", "suite")
"""studies with several vehicles or tasks"""

SIMULATED = ("bluerov2_gz_sim_8_11", "bluerov2_gz_sim_8_12")
"""vehicles of which a study has few agents"""


def rows(file):
    with file.open(newline="") as stream:
        return list(csv.DictReader(stream))


@pytest.mark.slow
@pytest.mark.parametrize("name", STUDIES)
def test_a_report_gives_the_numbers_that_are_shipped(name, tmp_path, capsys):
    shipped = ROOT / "results" / name
    words = [*STUDIES[name], "--format", "csv", "--no-figures", "--out", str(tmp_path / "report")]
    assert main(["report", str(shipped), *words]) == 0
    out = tmp_path / "report"
    assert len(rows(shipped / "table.csv")) >= 6
    table = (out / "table.csv").read_text()
    assert_same_numbers(table, (shipped / "table.csv").read_text(), rel=1e-9, abs=1e-12)
    assert (out / "comparisons.csv").exists() == (name not in (*SINGLE, *SECTIONS))
    made = [
        json.loads(file.read_text()) for file in out.rglob("verdicts.json")
    ]  # of several vehicles one each
    entries = [json.dumps(verdict) for verdicts in made for verdict in verdicts]
    published = json.loads((shipped / "verdicts.json").read_text())
    there = [json.dumps({k: v for k, v in verdict.items() if k != "section"}) for verdict in published]
    assert there
    for one, other in zip(sorted(entries), sorted(there), strict=True):
        assert_same_numbers(one, other, rel=1e-9, abs=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("protocol", ["transfer", "robustness"])
def test_so_does_one_by_another_protocol(protocol, tmp_path, capsys):
    shipped = ROOT / "results/leaderboard"
    words = ["--rank-by", "par1_steps", "--format", "csv", "--no-figures", "--out", str(tmp_path)]
    assert main(["report", str(shipped), "--protocol", protocol, *words]) == 0
    there = [row for row in rows(shipped / "conditions.csv") if row.pop("protocol") == protocol]
    here = rows(tmp_path / "conditions.csv")
    assert len(there) > 50
    assert_same_numbers(json.dumps(here), json.dumps(there), rel=1e-9, abs=1e-12)


@pytest.mark.parametrize(
    "file", sorted(ROOT.glob("results/*/conditions.csv")), ids=lambda file: file.parent.name
)
def test_the_conditions_of_a_study_name_the_tasks_of_its_runs(file):
    configurations = pd.read_parquet(file.parent / "runs.parquet", columns=["config"])["config"]
    tasks = {json.loads(text)["task"]["name"] for text in configurations}
    found = rows(file)
    assert {row["task"] for row in found} == tasks
    for row in found:
        assert row.get("vehicle", "").partition(", task ")[2] in ("", row["task"])


REAL, EARLY, LATE = "bluerov2", *SIMULATED
OF_TYPICAL_TRAININGS = {
    ("suite", "docking", "SAC 200k steps"): "behind",
    ("suite", "path_following", "PPO 500k steps"): "behind",
    ("suite", "path_following", "PPO 1M steps"): "behind",
    ("suite", "trajectory_tracking", "SAC 200k steps"): "open",
    ("leaderboard", "", "PPO added to PID, tuned"): "open",
    ("leaderboard", "", "PPO, tuned"): "open",
    ("leaderboard", "", "TQC, tuned"): "open",
    ("leaderboard", "", "TD3, tuned"): "open",
    ("leaderboard", "", "DDPG, tuned"): "open",
    ("leaderboard", "", "RecurrentPPO, tuned"): "open",
    ("thesis", "", "PPO K=1, trained at 10 Hz"): "equivalent*",
    ("thesis", "", "PPO K=1, trained at 25 Hz"): "equivalent*",
    ("thesis", "", "DDPG K=100, trained at 10 Hz"): "open",
    ("differences", REAL, "PPO, 10 Hz, positive noise"): "open",
    ("differences", REAL, "PPO, 25 Hz"): "open",
    ("gazebo", "", "PPO, 25 Hz, trained in published Gazebo"): "open",
}
"""rows whose verdict about the typical training is another than that about the mean would be"""


def test_the_shipped_verdicts_are_those_of_typical_trainings() -> None:
    """The rows of every study; a slow test computes the same files from their episodes."""
    found = {}
    for study in STUDIES:
        for row in rows(ROOT / "results" / study / "table.csv"):
            if row["trainings"]:
                section = row.get("vehicle", "").rpartition("task ")[2]
                found[study, section, row["agent"]] = row
                assert row["not_behind"], (study, row["agent"])
                few = int(row["trainings"]) < int(row["enough"])
                assert row["verdict"].endswith("*") == (few and row["verdict"] != "open")
    assert len(found) == 118
    verdicts = [row["verdict"].rstrip("*") for row in found.values()]
    assert verdicts.count("ahead") == 14
    assert {key: found[key]["verdict"] for key in OF_TYPICAL_TRAININGS} == OF_TYPICAL_TRAININGS


def test_the_transfer_to_gazebo_is_quoted_rightly():
    study = ROOT / "results/gazebo"
    table = {(row["agent"], row["condition"]): row for row in rows(study / "conditions.csv")}
    lines = (study / "README.md").read_text(encoding="utf-8").splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith("| agent (five trainings"))
    quoted = lines[start + 2 : lines.index("", start)]
    assert len(quoted) == len({agent for agent, _ in table})
    for line in quoted:
        _, agent, calm, *cells, _ = (cell.strip() for cell in line.split("|"))
        of = {c: table[agent, c] for c in ("nominal", "simulator=gazebo", "simulator=gazebo-published")}
        embedded, *there = of.values()
        assert abs(float(calm) - 100 * float(embedded["success_rate"])) <= 0.051, line
        for row, rate, change in zip(there, cells[::2], cells[1::2], strict=True):
            assert abs(float(rate) - 100 * float(row["success_rate"])) <= 0.051, line
            numbers = re.findall(r"[-+]?[\d.]+", change)
            last = 10.0 ** -len(numbers[0].partition(".")[2])
            for number, end in zip(numbers, ("", "_low", "_high"), strict=True):
                assert abs(float(number) - float(row[f"par1_change{end}"])) <= 0.51 * last, line


AS_IN_THE_THESIS = [  # vehicle, algorithm and, where they tell agents apart, sign of the noise and steps: the table's rows
    (REAL, "ppo", "both", "200000"),
    (REAL, "ppo", "positive", "200000"),
    (REAL, "ppo", "both", "1000000"),
    (REAL, "ppo_thesis", "both", "1000000"),
    (REAL, "ppo_thesis", "positive", "1000000"),
    (EARLY, "ppo", "", ""),
    (LATE, "ppo", "", ""),
    (EARLY, "ppo_thesis", "", ""),
]


def test_what_differs_from_the_thesis_is_quoted_rightly():
    study = ROOT / "results/differences"
    table = {
        (row["vehicle"], row["algo"], row["noise.sign"], row["train.total_steps"]): row
        for row in rows(study / "table.csv")
        if float(row["step.frequency"]) == 25.0
    }
    tested = pd.read_parquet(study / "episodes.parquet").query("protocol == 'test'")
    success = (tested["outcome"] == "success").groupby(tested["run"]).mean()
    lines = (study / "README.md").read_text(encoding="utf-8").splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith("| as in the original study |"))
    quoted = lines[start + 2 : lines.index("", start)]
    for line, key in zip(quoted, AS_IN_THE_THESIS, strict=True):
        _, _, trainings, cell, _ = (part.strip() for part in line.split("|"))
        row = table[key]
        found = [100 * success[run] for run in row["runs"].split()]
        assert int(trainings) == len(found), line
        expected = [100 * float(row[f"success_rate{end}"]) for end in ("", "_low", "_high")]
        numbers = [float(n) for n in re.findall(r"[\d.]+", cell)]
        assert numbers == pytest.approx(expected if "[" in cell else found, abs=0.051), line


def test_the_trainings_on_the_outside_model_are_quoted_rightly() -> None:
    study = ROOT / "results/outside"
    tested = pd.read_parquet(study / "episodes.parquet").query(
        "condition == 'vehicle=bluerov2-vonbenzon2022'"
    )
    success = (tested["outcome"] == "success").groupby(tested["run"]).mean()
    learned = [100 * rate for run, rate in success.items() if run.startswith("ppo_robust-")]
    text = " ".join((study / "README.md").read_text(encoding="utf-8").split())
    (quoted,) = re.findall(r"on this model in still water: ([\d., ]+)\.", text)
    assert [float(rate) for rate in quoted.split(", ")] == pytest.approx(learned)


def test_the_cases_of_the_answer_on_disturbances_are_those_of_the_table() -> None:
    text = " ".join((ROOT / "results/suite/README.md").read_text(encoding="utf-8").split())
    (sum_,) = re.findall(r"\| all \| (\d+) \| (\d+) \| (\d+) \|", text)
    fewer, more, rest = map(int, sum_)
    assert f"fewer goals than PID in {fewer} of {fewer + more + rest} cases, and more in {more}" in text


def test_the_studies_are_few_and_small_files() -> None:
    files = [path for path in (ROOT / "results").rglob("*") if path.is_file() and "report" not in path.parts]
    counts = Counter(path.relative_to(ROOT / "results").parts[0] for path in files)
    # README, declaration, runs, rows, three tables, history, a figure for each section, policies.
    assert max(counts.values()) <= 13, counts
    # Each task of suite-2026 adds half a megabyte.
    assert sum(path.stat().st_size for path in files) < 18_000_000


@pytest.mark.parametrize("name", STUDIES)
def test_every_figure_of_a_study_is_in_its_readme(name: str) -> None:
    study = ROOT / "results" / name
    text = (study / "README.md").read_text(encoding="utf-8")
    assert [f.name for f in study.glob("figures/*.png") if f"figures/{f.name}" not in text] == []
