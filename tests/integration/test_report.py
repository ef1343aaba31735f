"""`auvbench report` as a user calls it, on directories that look like trained runs."""

import csv
import shutil
from pathlib import Path

import pytest

from auvbench.cli import main
from tests.synthetic import damage, set_state, write_experiment


def write_grid(root: Path) -> list[Path]:
    """2 algorithms x 2 K x 3 seeds and a PID: 13 runs."""
    return write_experiment(
        root / "outputs" / "grid",
        algorithms=("ppo", "sac", "pid"),
        reward_k=(1, 100),
        seeds=(0, 1, 2),
        episodes=40,
        train_episodes=150,
    )


@pytest.fixture
def grid(tmp_path: Path) -> list[Path]:
    return write_grid(tmp_path)


@pytest.fixture(scope="module")
def untouched(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """A grid for tests that write nothing."""
    return write_grid(tmp_path_factory.mktemp("untouched"))


def report(*arguments: object) -> int:
    return main(["report", *map(str, arguments)])


def rows(folder: Path) -> list[dict[str, str]]:
    with (folder / "table.csv").open() as file:
        return list(csv.DictReader(file))


@pytest.mark.slow
def test_all_files_lie_beside_the_runs(grid: list[Path], capsys: pytest.CaptureFixture[str]) -> None:
    assert report(grid[0].parent, "--format", "terminal,md,tex,csv", "--baseline", "pid") == 0
    out = grid[0].parent / "report"
    names = {path.name for path in out.iterdir()}
    assert {"report.md", "table.tex", "table.csv", "comparisons.csv", "figures"} <= names
    screen = capsys.readouterr().out
    table = rows(out)
    assert {row["agent"] for row in table} == {"PID", "PPO K=1", "PPO K=100", "SAC K=1", "SAC K=100"}
    for row in table:
        assert row["agent"] in screen
    success = [float(row["success_rate"]) for row in table]
    assert success == sorted(success, reverse=True)
    text = (out / "report.md").read_text()
    assert "from PID (s)" in text
    assert "## Appendix: ranks" in text
    for figure in (out / "figures").glob("*.png"):
        assert f"(<figures/{figure.name}>)" in text
        assert figure.with_suffix(".svg").is_file()
    assert "training_curves.png" in text


def test_the_rates_are_those_of_the_episodes(grid: list[Path], tmp_path: Path) -> None:
    report(grid[0].parent, "--format", "csv", "--out", tmp_path / "out")
    outcomes = []
    for run in grid[:3]:  # PPO K=1
        with (run / "evaluations" / "test" / "episodes.csv").open() as file:
            outcomes += [row["outcome"] for row in csv.DictReader(file)]
    row = next(row for row in rows(tmp_path / "out") if row["agent"] == "PPO K=1")
    assert float(row["success_rate"]) == pytest.approx(outcomes.count("success") / 120)
    assert float(row["timeout_rate"]) == pytest.approx(outcomes.count("timeout") / 120)
    assert float(row["success_rate_low"]) < float(row["success_rate"]) < float(row["success_rate_high"])
    assert row["seeds"] == "0 1 2"


@pytest.mark.slow
def test_the_same_runs_give_the_same_bytes(grid: list[Path], tmp_path: Path) -> None:
    written = []
    for _ in range(2):
        report(grid[0].parent, "--format", "md,tex,csv,html", "--no-figures", "--out", tmp_path / "out")
        written.append({path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()})
    assert len(written[0]) == 6
    assert "verdicts.json" in written[0]
    assert written[0] == written[1]


@pytest.mark.slow
def test_what_can_be_reported_is_and_the_rest_is_named(
    grid: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    set_state([grid[0]], "failed", "loss is nan")
    damage(grid[4] / "evaluations" / "test" / "episodes.csv", "cut")
    shutil.rmtree(grid[7] / "evaluations")
    shutil.rmtree(grid[11])
    assert report(grid[0].parent, "--format", "terminal,md", "--no-figures") == 0
    screen, text = capsys.readouterr().out, (grid[0].parent / "report" / "report.md").read_text()
    for piece in (
        grid[0].name,
        "loss is nan",
        grid[4].name,
        "cut short",
        grid[7].name,
    ):
        assert piece in text.replace("\\", "")
        assert piece in " ".join(screen.split())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--rank-by", "succes_rate"), "did you mean 'success_rate'?"),
        (("--rankby", "x"), "unknown option '--rankby' of report; did you mean '--rank-by'?"),
        (("--baseline", "pit"), "is not one of the agents; did you mean 'PID'? valid: PID"),
        (("--baseline", "ppo"), "PPO K=1"),
        (("--protocol", "robust"), "robust"),
        (("--condition", "nominel"), "did you mean 'nominal'?"),
        (("--format", "pdf"), "--format is 'pdf', must be one of terminal, md, tex, csv, html"),
        (("--confidence", "95"), "--confidence: must be a number from 0.5 to 0.999, got 95"),
        (("--margin", "0"), "--margin: must be a number from 1e-12 to 1e+12, got 0"),
        (("--study", "thesys"), "--study is 'thesys', must be one of thesis"),
        (("--out", "/dev/null/report"), "cannot write into /dev/null/report"),
        (("--format", ","), "--format is ''"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(
    untouched: list[Path], capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], message: str
) -> None:
    assert report(untouched[0].parent, *arguments) == 2
    error = capsys.readouterr().err
    assert error.startswith("auvbench: ")
    assert message in error
    assert len(error.splitlines()) == 1
    assert not (untouched[0].parent / "report").exists()


def test_nothing_to_report_is_exit_code_2(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert report(tmp_path / "nowhere") == 2
    assert "nowhere: no such file or directory" in capsys.readouterr().err
    assert report(tmp_path) == 2
    assert "no run under" in capsys.readouterr().err
    runs = write_experiment(tmp_path / "grid", algorithms=("pid",), protocols={}, episodes=5)
    assert report(runs[0]) == 2
    assert "'test'" in capsys.readouterr().err
    assert main(["report"]) == 2


def test_the_thesis_is_answered_and_stands_beside_our_table(
    grid: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert report(grid[0].parent, "--study", "thesis", "--format", "terminal,md,html", "--no-figures") == 0
    screen = " ".join(capsys.readouterr().out.split())
    text = (grid[0].parent / "report" / "report.md").read_text()
    page = (grid[0].parent / "report" / "index.html").read_text()
    claims = text.partition("## Claims of the study")[2].partition("## ")[0]
    assert [line[:2] for line in claims.splitlines() if line[:1].isdigit()] == [f"{i}." for i in range(1, 8)]
    for verdict in ("Holds.", "Does not hold.", "Cannot be said."):
        assert screen.count(verdict) == claims.count(f"**{verdict}**")
    assert claims.count("**") == 2 * 7
    assert "SAC4 (SAC K=1)" in text  # 25 Hz, as all of the grid
    assert "SAC4 (SAC K=1) 100 / " in screen
    assert "straightness and step count" in page


def test_help_lists_the_options(capsys: pytest.CaptureFixture[str]) -> None:
    assert report("--help") == 0
    text = capsys.readouterr().out
    for option in ("--rank-by", "--columns", "--baseline", "--study", "--out"):
        assert option in text
