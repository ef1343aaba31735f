"""Comparisons under each condition of several protocols: the same as each condition's own report, wherever they are shown."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from auvbench import cli
from tests.synthetic import write_experiment

PROTOCOLS = {"test": ("nominal",), "robustness": ("nominal", "current=0.5", "dead-thruster")}
SAME = ("difference", "difference_low", "difference_high", "verdict", "margin", "baseline", "not_behind")


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The folder of two experiments, one of them on another vehicle, and the files of their report."""
    folder = tmp_path_factory.mktemp("by-condition")
    for name, vehicle in (("grid", "bluerov2"), ("large", "rexrov")):
        write_experiment(
            folder / name,
            algorithms=("ppo", "sac", "pid"),
            frequencies=(10,),
            seeds=range(8),
            protocols=PROTOCOLS,
            train_episodes=0,
            trajectories=0,
            vehicle=vehicle,
        )
    paths = [str(folder / name) for name in ("grid", "large")]
    command = ["report", *paths, "--also", "robustness", "--no-figures", "--out", str(folder / "all")]
    assert cli.main([*command, "--format", "md,csv,html,tex"]) == 0
    return folder


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize(("protocol", "condition"), [("test", "nominal"), ("robustness", "current=0.5")])
def test_a_condition_has_the_numbers_of_its_own_report(written, tmp_path, protocol, condition):
    vehicle = "rexrov"
    command = [
        "report",
        str(written),
        "--where",
        f"vehicle={vehicle}",
        "--protocol",
        protocol,
        "--condition",
        condition,
    ]
    assert cli.main([*command, "--format", "csv", "--no-figures", "--out", str(tmp_path / "one")]) == 0
    own = {row["agent"]: [row[name] for name in SAME] for row in rows(tmp_path / "one/table.csv")}
    shown = {
        row["agent"]: [row[name] for name in SAME]
        for row in rows(written / "all/by_condition.csv")
        if (row["vehicle"], row["protocol"], row["condition"]) == (vehicle, protocol, condition)
    }
    assert shown == own


COMMANDS = ("--baseline", "ppo", "--rank-by", "mean_command_norm_mean_N")
"""options with which the synthetic PID, whose commands are small, is ahead"""


@pytest.mark.parametrize(("options", "baseline", "ahead"), [((), "PID", False), (COMMANDS, "PPO", True)])
def test_the_first_table_names_the_agent_furthest_ahead_or_the_baseline(
    written, tmp_path, options, baseline, ahead
):
    command = ["report", str(written), "--also", "robustness", "--no-figures", "--format", "md,csv", *options]
    assert cli.main([*command, "--out", str(tmp_path)]) == 0
    text = (tmp_path / "report.md").read_text()
    headings, _, *lines = text[text.index("## Furthest ahead") :].split("\n\n")[1].splitlines()
    vehicles = [cell.partition(" ")[0] for cell in headings.strip("| ").split(" | ")[1:]]
    shown = {
        (vehicle, condition): cell
        for condition, *cells in (line.strip("| ").split(" | ") for line in lines)
        for vehicle, cell in zip(vehicles, cells, strict=True)
    }
    titles = ["nominal", "nominal, robustness", "current 0.5 m/s", "dead-thruster"]
    assert sorted(shown) == sorted((v, title) for v in ("bluerov2", "rexrov") for title in titles)
    verdicts: dict[tuple[str, str], list[dict[str, str]]] = {}
    for row in rows(tmp_path / "by_condition.csv"):
        title = row["condition"].replace("current=0.5", "current 0.5 m/s")
        title += ", robustness" if (row["protocol"], title) == ("robustness", "nominal") else ""
        better = row["verdict"].rstrip("*") == "ahead"
        verdicts.setdefault((row["vehicle"], title), []).extend([row] if better else [])
    for cell, better in verdicts.items():
        assert bool(better) == ahead
        if ahead:
            best = min(better, key=lambda row: float(row["difference"]))
            assert shown[cell].startswith(f"{best['agent']} -")
        else:
            assert shown[cell].startswith(f"{baseline} (none ahead")


def test_the_page_and_the_paper_have_the_tables(written):
    assert 'id="by-condition-1"' in (written / "all/index.html").read_text()
    assert (written / "all/by_condition.tex").read_text().count(r"\begin{tabular}") == 5


def test_a_report_without_further_protocols_removes_the_tables(written, tmp_path):
    out = ["--no-figures", "--format", "md,csv,tex", "--out", str(tmp_path / "report")]
    assert cli.main(["report", str(written / "grid"), "--also", "robustness", *out]) == 0
    names = {"by_condition.csv", "by_condition.tex"}
    assert names <= {path.name for path in (tmp_path / "report").iterdir()}
    assert cli.main(["report", str(written / "grid"), *out]) == 0
    assert not names & {path.name for path in (tmp_path / "report").iterdir()}
    assert "Furthest ahead" not in (tmp_path / "report/report.md").read_text()


def test_a_study_shows_them_where_its_readme_has_a_place(written, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    command = ["publish", str(written / "grid"), "--to", "study", "--also", "robustness", "--pictures", ""]
    assert cli.main(command) == 0
    readme = Path("study/README.md")
    first = readme.read_text()
    assert "### Furthest ahead of the baseline" in first
    assert len(rows(Path("study/by_condition.csv"))) == 4 * 3
    assert cli.main(["publish", "study", *command[2:]]) == 0
    marked = (
        readme.read_text().partition("<!-- end: conditions -->")[0],
        first.partition("<!-- end: conditions -->")[0],
    )
    assert marked[0] == marked[1]
    begin, end = first.index("<!-- begin: conditions -->"), first.index("<!-- end: conditions -->")
    readme.write_text(first[:begin] + first[end + len("<!-- end: conditions -->") :])
    assert cli.main(["publish", "study", *command[2:]]) == 0
    assert "Furthest ahead" not in readme.read_text()
    assert not Path("study/by_condition.csv").exists()
