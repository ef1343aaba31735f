"""A report over several vehicles: a section for each, in every format, and a first page that leads to them."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import pytest

from auvbench import cli
from tests.synthetic import write_experiment


def report(*arguments: object) -> int:
    return cli.main(["report", *map(str, arguments)])


@pytest.fixture
def fleet(tmp_path: Path) -> Path:
    folder = tmp_path / "fleet"
    for vehicle, algorithms in (
        ("bluerov2", ("ppo", "pid")),
        ("rexrov", ("ppo", "pid")),
        ("lrauv", ("ppo",)),
    ):
        write_experiment(
            folder, algorithms=algorithms, seeds=(0, 1), episodes=20, train_episodes=30, vehicle=vehicle
        )
    return folder


def test_no_vehicle_is_lost(fleet: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert report(fleet, "--no-figures") == 0
    screen = capsys.readouterr().out
    out = fleet / "report"
    with (out / "table.csv").open() as file:
        rows = [(row["vehicle"], row["agent"]) for row in csv.DictReader(file)]
    assert sorted(rows) == [
        ("bluerov2", "PID"),
        ("bluerov2", "PPO"),
        ("lrauv", "PPO"),
        ("rexrov", "PID"),
        ("rexrov", "PPO"),
    ]
    page, text = (out / "index.html").read_text(), (out / "report.md").read_text()
    for vehicle in ("bluerov2", "rexrov", "lrauv"):
        assert f"vehicle {vehicle}" in screen
        assert f"## Vehicle {vehicle}" in text
        assert f"Vehicle {vehicle}</h2>" in page
        for name in ("index.html", "report.md", "table.tex", "table.csv"):
            assert (out / vehicle / name).is_file()
        assert 'href="../index.html"' in (out / vehicle / "index.html").read_text()
    assert "evaluate it again" not in screen


@pytest.mark.slow
def test_every_link_of_the_first_page_leads_somewhere(fleet: Path) -> None:
    report(fleet, "--no-figures", "--format", "html")
    page = fleet / "report" / "index.html"
    links = set(re.findall(r'href="([^"]+)"', page.read_text()))
    assert "./rexrov/index.html" in links
    for link in links:
        name, _, anchor = link.partition("#")
        target = (page.parent / name).resolve() if name else page
        assert target.is_file(), link
        if anchor:
            assert f'id="{anchor}"' in target.read_text(), link


def test_a_section_may_lack_the_baseline_but_not_all_of_them(
    fleet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert report(fleet, "--baseline", "pid", "--format", "terminal") == 0
    assert "vehicle lrauv: --baseline 'pid' is not one of the agents" in " ".join(
        capsys.readouterr().out.split()
    )
    assert report(fleet, "--baseline", "sac", "--format", "terminal") == 2
    assert "'sac'" in capsys.readouterr().err


@pytest.mark.slow
def test_what_a_report_of_one_section_left_behind_goes(fleet: Path) -> None:
    out = fleet / "report"
    report(*fleet.glob("ppo-k*"), "--no-figures", "--out", out)
    assert (out / "table.tex").is_file()
    report(fleet, "--no-figures")
    assert not (out / "table.tex").exists()
