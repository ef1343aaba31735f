"""The published studies: a report of their files gives the numbers that are shipped, and the pages quote them rightly."""

import csv
import json
import re
from pathlib import Path

import pandas as pd
import pytest

from auvbench.analysis.labels import title
from auvbench.cli import main
from tests.numbers import assert_same_numbers

ROOT = Path(__file__).parents[2]
STUDIES = {
    "thesis": ["--study", "thesis"],
    "leaderboard": ["--rank-by", "par1_steps", "--columns", "action_ms,training_cpu_s"],
    "defaults": [],
    "differences": [],
    "gazebo": ["--protocol", "gazebo", "--rank-by", "par1_steps"],
}

SINGLE = ("defaults",)
"""studies in which not two agents have several training seeds"""

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
    made = sorted((tmp_path / "report").rglob("*.csv"))  # of several vehicles there is a folder for each
    compared = {"comparisons.csv"} if name not in SINGLE else set()
    assert {"table.csv"} | compared <= {here.name for here in made}
    for here in made:
        there = shipped / here.relative_to(tmp_path / "report")
        assert len(rows(there)) >= (3 if here.parent.name in SIMULATED else 6)
        assert_same_numbers(here.read_text(), there.read_text(), rel=1e-9, abs=1e-12)
    said = sorted((tmp_path / "report").rglob("verdicts.json"))
    assert said
    for here in said:
        there = shipped / here.relative_to(tmp_path / "report")
        assert_same_numbers(here.read_text(), there.read_text(), rel=1e-9, abs=1e-12)
        assert json.loads(there.read_text())


@pytest.mark.slow
@pytest.mark.parametrize("protocol", ["transfer", "robustness"])
def test_so_does_one_by_another_protocol(protocol, tmp_path, capsys):
    shipped = ROOT / "results/leaderboard"
    words = ["--rank-by", "par1_steps", "--format", "csv", "--no-figures", "--out", str(tmp_path)]
    assert main(["report", str(shipped), "--protocol", protocol, *words]) == 0
    there, here = shipped / protocol / "conditions.csv", tmp_path / "conditions.csv"
    assert len(rows(there)) > 50
    assert_same_numbers(here.read_text(), there.read_text(), rel=1e-9, abs=1e-12)


IN_GAZEBO = {
    "PPO added to PID": "PPO added to PID, trained at 10 Hz in fossen",
    "PPO, 10 Hz": "PPO, trained at 10 Hz in fossen",
    "SAC, 10 Hz": "SAC, trained at 10 Hz in fossen",
    "DDPG, 10 Hz": "DDPG, trained at 10 Hz in fossen",
    "PPO, 25 Hz": "PPO, trained at 25 Hz in fossen",
    "PPO, 25 Hz, trained in corrected Gazebo": "PPO, trained at 25 Hz in gazebo with hydrodynamics=corrected",
    "PPO, 25 Hz, trained in published Gazebo": "PPO, trained at 25 Hz in gazebo with hydrodynamics=published",
}


def test_the_transfer_to_gazebo_is_quoted_rightly():
    study = ROOT / "results/gazebo"
    table = {(row["agent"], row["condition"]): row for row in rows(study / "conditions.csv")}
    lines = (study / "README.md").read_text(encoding="utf-8").splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith("| agent (five trainings"))
    quoted = lines[start + 2 : lines.index("", start)]
    assert len(quoted) == len({agent for agent, _ in table})
    for line in quoted:
        _, agent, calm, *cells, _ = (cell.strip() for cell in line.split("|"))
        of = {
            c: table[IN_GAZEBO.get(agent, agent), c]
            for c in ("nominal", "simulator=gazebo", "simulator=gazebo-published")
        }
        embedded, *there = of.values()
        assert abs(float(calm) - 100 * float(embedded["success_rate"])) <= 0.051, line
        for row, rate, change in zip(there, cells[::2], cells[1::2], strict=True):
            assert abs(float(rate) - 100 * float(row["success_rate"])) <= 0.051, line
            numbers = re.findall(r"[-+]?[\d.]+", change)
            last = 10.0 ** -len(numbers[0].partition(".")[2])
            for number, end in zip(numbers, ("", "_low", "_high"), strict=True):
                assert abs(float(number) - float(row[f"par1_change{end}"])) <= 0.51 * last, line


def test_the_results_page_quotes_the_leaderboard_rightly():
    table = {title(row["agent"]): row for row in rows(ROOT / "results" / "leaderboard" / "table.csv")}
    found = 0
    for line in (ROOT / "docs/results.md").read_text(encoding="utf-8").splitlines():
        match = re.search(r"\| ([\w ,]+?) \| ([\d.]+) \[([\d.]+), ([\d.]+)\] \|", line)
        if not match or match[1].isdecimal():  # of the table of conditions
            continue
        row = table[match[1]]
        for value, key in zip(match.groups()[1:], ("", "_low", "_high"), strict=True):
            assert float(value) == pytest.approx(float(row[f"par1_steps{key}"]), abs=0.051), line
        found += 1
    assert found >= 5


def numbers(text: str) -> list[float]:
    return [float(number) for number in re.findall(r"[-+]?[\d.]+", text)]


def conditions():
    """By agent and condition: the rows of the leaderboard's further protocols."""
    shipped = [
        rows(ROOT / "results/leaderboard" / name / "conditions.csv") for name in ("robustness", "transfer")
    ]
    return {(title(row["agent"]), row["condition"]): row for file in shipped for row in file}


def test_the_readme_quotes_the_leaderboard_rightly():
    lines = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith("| 500 waypoints |"))
    table = {title(row["agent"]): row for row in rows(ROOT / "results" / "leaderboard" / "table.csv")}
    by_condition, found = conditions(), 0
    for line in lines[start + 2 : lines.index("", start)]:
        _, agent, time, difference, success, current, other, _ = (
            cell.strip(" *") for cell in line.split("|")
        )
        row = table[agent]
        ends = ("", "_low", "_high")
        expected = [float(row[f"par1_time_s{end}"]) for end in ends]
        assert numbers(time) == pytest.approx(expected, abs=0.051), line
        if difference != "baseline":
            expected = [float(row[f"difference{end}"]) / 10 for end in ends]  # 10 steps a second
            assert numbers(difference) == pytest.approx(expected, abs=0.0051), line
        rates = [
            row,
            by_condition[agent, "current=1"],
            by_condition[agent, "vehicle=bluerov2-wu2018"],
        ]
        expected = [100 * float(rate["success_rate"]) for rate in rates]
        assert numbers(success + current + other) == pytest.approx(expected, abs=0.51), line
        found += 1
    assert found >= 8


def test_conditions_are_quoted_rightly():
    quoted_as = {
        "still water, its own vehicle": "nominal",
        "the BlueROV2 with Wu's hydrodynamics": "vehicle=bluerov2-wu2018",
        "current of 0.75 m/s": "current=0.75",
        "current of 1 m/s": "current=1",
        "one thruster dead": "dead-thruster",
        "a delay of 0.5 s": "delay=0.5",
        "noise eight times as strong": "noise=8",
    }
    table = conditions()
    lines = (ROOT / "docs/results.md").read_text(encoding="utf-8").splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith("| | MPC |"))
    agents = [cell.strip() for cell in lines[start].split("|")[2:-1]]
    found = 0
    for line in lines[start + 2 : start + 2 + len(quoted_as)]:
        _, condition, *cells, _ = (cell.strip(" *") for cell in line.split("|"))
        for agent, cell in zip(agents, cells, strict=True):
            if cell == "–":
                assert (agent, quoted_as[condition]) not in table
                continue
            row = table[agent, quoted_as[condition]]
            quoted = [float(n) for n in re.findall(r"[\d.]+", cell)]
            keys = ("", "_low", "_high")[: len(quoted)]
            for value, key in zip(quoted, keys, strict=True):
                assert abs(value - 100 * float(row[f"success_rate{key}"])) <= 0.51, (line, agent)
                found += 1
    assert found > 50


REAL, EARLY, LATE = "bluerov2", *SIMULATED
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
    start = next(i for i, line in enumerate(lines) if line.startswith("| what is as in the thesis |"))
    quoted = lines[start + 2 : lines.index("", start)]
    for line, key in zip(quoted, AS_IN_THE_THESIS, strict=True):
        _, _, trainings, cell, _ = (part.strip() for part in line.split("|"))
        row = table[key]
        found = [100 * success[run] for run in row["runs"].split()]
        assert int(trainings) == len(found), line
        expected = [100 * float(row[f"success_rate{end}"]) for end in ("", "_low", "_high")]
        numbers = [float(n) for n in re.findall(r"[\d.]+", cell)]
        assert numbers == pytest.approx(expected if "[" in cell else found, abs=0.051), line
