"""`auvbench plan`: seeds from runs that are there, or from a typed spread; and what it does not take."""

from __future__ import annotations

from pathlib import Path

import pytest

from auvbench import cli
from auvbench.analysis.planning import Basis, Need
from auvbench.commands import plan
from tests.synthetic import reconfigure, write_experiment


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plan, "REPLICATIONS", 60)


def planned(*arguments: str) -> tuple[Basis, list[tuple[str, Need]]]:
    options = plan.parser().read(arguments)
    basis, agents, episodes, _ = plan._basis(options)
    return basis, list(plan._needs(options, basis, agents, episodes))


def planned_basis(*arguments: str) -> Basis:
    return plan._basis(plan.parser().read(arguments))[0]


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("planned")
    write_experiment(
        folder, algorithms=("ppo",), reward_k=(1.0, 40.0), frequencies=(10.0,), seeds=(0, 1, 2), episodes=60
    )
    return folder


@pytest.mark.slow
def test_a_typed_spread(capsys: pytest.CaptureFixture[str]) -> None:
    basis, ((_, need),) = planned("--sd", "0.5", "--rates", "80,95", "--episodes", "200")
    assert basis.values == (0.8, 0.95)
    assert 5 <= need.alone[0.8] <= need.alone[0.95] <= 16
    _, ((_, wide),) = planned("--sd", "1.5", "--rates", "80,95", "--episodes", "200")
    assert wide.alone[0.8] > need.alone[0.8]
    assert cli.main(["plan", "--sd", "0.5", "--rates", "80,95", "--episodes", "200"]) == 0
    assert "below 10 %: 29, below 5 %: 59" in capsys.readouterr().out


@pytest.mark.slow
def test_the_spread_of_runs_that_are_there(runs: Path) -> None:
    basis, found = planned("--resolve", "20", "--metric", "success_rate", str(runs))
    assert basis.spread.df == 4
    assert basis.spread.upper() > basis.spread.sd
    assert basis.values[1] - basis.values[0] == pytest.approx(0.2)
    assert [(kind, need.episodes) for kind, need in found] == [("", 60), ("", 240), ("cautious", 60)]


def test_the_baseline_is_the_usual_one_unless_it_is_named(runs: Path, tmp_path: Path) -> None:
    options = ("--resolve", "20", "--episodes", "60")
    assert not planned_basis(*options, str(runs)).against_controller
    write_experiment(
        tmp_path, algorithms=("ppo", "pid"), reward_k=(1.0,), frequencies=(10.0,), seeds=(0, 1), episodes=20
    )
    assert planned_basis(*options, str(tmp_path)).against_controller
    assert not planned_basis(*options, "--against", "learner", str(tmp_path)).against_controller
    assert planned_basis("--sd", "0.5", "--rates", "90,95").against_controller


def test_a_mean(runs: Path) -> None:
    basis, _ = planned("--resolve", "200", "--metric", "mean_steps", "--episodes", "60", str(runs))
    assert basis.values[1] - basis.values[0] == pytest.approx(200)


@pytest.mark.slow
def test_what_a_reader_sees(capsys: pytest.CaptureFixture[str], runs: Path) -> None:
    assert cli.main(["plan", "--resolve", "20", "--metric", "success_rate", "--agents", "4", str(runs)]) == 0
    text = capsys.readouterr().out
    assert "Training seeds that resolve success rate of two learners" in text
    assert "table of 4" in text
    assert "6 trainings of 2 agents" in text
    assert "Fix the number of seeds in advance" in text


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ([], "name evaluated runs, or type --sd 0.5 --rates 90,95"),
        (["--sd", "0.5"], "--sd needs --rates"),
        (["--sd", "x", "--rates", "90,95"], "argument --sd: must be a number from 0 to 10, got x"),
        (["--sd", "0.5", "--rates", "90"], "two different rates"),
        (
            ["--sd", "0.5", "--rates", "90,100"],
            "argument --rates: must be a number from 0.5 to 99.5, got 100",
        ),
        (
            ["--sd", "0.5", "--rates", "90,95", "--episodes", "2.5"],
            "must be a whole number from 2 to 1000000, got 2.5",
        ),
        (["outputs", "--resolve", "0"], "must be a number from 0.001 to 1e+06, got 0"),
        (["outputs", "resolve=5"], "plan takes flags: --resolve 5"),
        (["nowhere", "--resolve", "5"], "nowhere"),
        (["outputs", "--resolve", "5", "--against", "pid"], "choose from 'controller', 'learner'"),
    ],
)
def test_mistakes_are_told_in_one_line(
    capsys: pytest.CaptureFixture[str], arguments: list[str], says: str
) -> None:
    assert cli.main(["plan", *arguments]) == 2
    captured = capsys.readouterr()
    assert says in captured.err
    assert captured.err.count("\n") == 1
    assert captured.out == ""


@pytest.mark.parametrize(("seeds", "episodes"), [((0,), 20), ((0, 1), 1)])
def test_runs_of_one_seed_or_one_episode_say_nothing_of_the_spread(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, seeds: tuple[int, ...], episodes: int
) -> None:
    write_experiment(tmp_path, algorithms=("ppo",), seeds=seeds, episodes=episodes)
    assert cli.main(["plan", "--resolve", "5", str(tmp_path)]) == 2
    assert "no agent has several training seeds" in capsys.readouterr().err


def test_runs_of_several_tasks_are_refused(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    for run in write_experiment(tmp_path, algorithms=("ppo",), frequencies=(10.0,), seeds=(0, 1), episodes=5)[
        :1
    ]:
        reconfigure(run, task__name="docking")
    assert cli.main(["plan", "--resolve", "20", str(tmp_path)]) == 2
    err = capsys.readouterr().err
    assert "docking, waypoint" in err
    assert "--where task=docking" in err
