"""`key=value` is configuration, `--flag` how it is shown: the wrong one of the two names the right one."""

from __future__ import annotations

import doctest
import json
from pathlib import Path

import pytest

from auvbench import cli, grammar
from auvbench.config import folders, overrides, suggestions
from auvbench.config.compose import compose
from auvbench.config.validate import train_config
from auvbench.errors import ConfigError
from auvbench.record import measure_names
from auvbench.runs.plan import prepare
from tests import fake_training


@pytest.mark.parametrize("module", [grammar, suggestions, overrides, folders])
def test_the_examples_in_the_documentation(module: object) -> None:
    assert doctest.testmod(module).failed == 0  # type: ignore[arg-type]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    fake_training.make(tmp_path / "outputs" / "a" / "ppo-1")
    return tmp_path


def told(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """The one line that a mistake is answered with."""
    assert cli.main(list(arguments)) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1, captured.err
    return captured.err


@pytest.mark.parametrize(
    ("arguments", "right"),
    [
        (["evaluate", "outputs", "--protocol", "thesis"], "protocol=thesis"),
        (["evaluate", "outputs", "force=true"], "takes flags: --force\n"),
        (["evaluate", "outputs", "workers=2"], "--workers 2"),
        (["bound", "workers=2"], "--workers 2"),
        (["evaluate", "--protocol=thesis", "outputs"], "protocol=thesis"),
        (["train", "--seed", "3"], "seed=3"),
        (["train", "--seed=3"], "seed=3"),
        (["train", "--total-steps", "1000"], "train.total_steps=1000"),
        (["train", "--algo", "sac"], "algo=sac"),
        (["simulate", "--duration", "3"], "duration=3"),
        (["report", "outputs", "baseline=pid"], "--baseline pid"),
        (["report", "outputs", "rank_by=mean_steps"], "--rank-by mean_steps"),
        (["report", "outputs", "reward.k=1"], "--where reward.k=1"),
        (["evaluate", "outputs", "reward.k=40"], "--where reward.k=40"),
        (["evaluate", "outputs", "vehicle=rexrov"], "--where vehicle=rexrov"),
        (["runs", "outputs", "state=failed"], "--where state=failed"),
        (["runs", "outputs", "reward.k=40"], "--where reward.k=40"),
        (["replay", "outputs", "episode=3"], "--episode 3"),
        (["resume", "outputs", "workers=3"], "--workers 3"),
    ],
)
def test_the_wrong_one_names_the_right_one(
    folder: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], right: str
) -> None:
    assert right in told(capsys, *arguments)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["train", "--bogus"], "unknown option '--bogus' of train"),
        (["train", "--cfg"], "--cfg"),
        (["train", "--cfg", "all of it"], "invalid choice"),
        (["train", "--multi"], "did you mean '--multirun'"),
        (["evaluate", "outputs", "--workers", "-1"], "must be a whole number from 0 to 4096"),
        (["resume", "outputs", "--workers", "two"], "must be a whole number from 0 to 4096, got two"),
        (["resume", "--bogus"], "unknown option '--bogus' of resume"),
        (["replay", "--bogus", "outputs"], "unknown option '--bogus' of replay"),
        (["replay"], "RUN"),
        (["vehicles", "--bogus"], "unknown option '--bogus' of vehicles"),
        (["report"], "PATH"),
        (["report", "outputs", "--rank-byy", "x"], "did you mean '--rank-by'"),
        (["runs", "--where"], "--where"),
        (["runs", "--where", "outputs"], "must be followed by KEY=VALUE"),
        (["evaluate", "outputs", "--where", "seed=0", "protocol=thesis"], "type it before --where"),
        (["train", "--config-name=mine"], "unknown option '--config-name'"),
        (["train", "hydra.run.dir=here"], "output=FOLDER"),
        (["train", "-m", "hydra.sweep.dir=here", "seed=0,1"], "output=FOLDER"),
        (["train", "hydra/launcher=joblib"], "launcher=NAME"),
    ],
)
def test_a_mistake_is_one_line(
    folder: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], words: str
) -> None:
    assert words in told(capsys, *arguments)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("algo.bufer_size=3", "did you mean algo.buffer_size of sac, ddpg, td3, tqc, crossq"),
        ("zzz=1", r"unknown key; auvbench train --cfg job shows all keys"),
        ("algo=ppo,sac", "several values make a grid: auvbench train -m algo=ppo,sac"),
        ("algo.net_arch=64,64", r"takes a list, algo.net_arch=\[64,64\]"),
        ("algo.tau=0.1", "only sac, ddpg, td3, tqc, sac_residual have it"),
        ("algo.residual.share=0.1", "only ppo_residual, sac_residual have it"),
        ("learning_rate=0.1", "did you mean algo.learning_rate"),
        ("k=40", "did you mean reward.k"),
        ("train.total_steps=1.5", "'1.5' is not a whole number"),
    ],
)
def test_hints_lead_to_the_key(override: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        train_config(compose("train", [override]))


@pytest.mark.parametrize("command", ["evaluate", "simulate"])
def test_a_command_without_an_algorithm_proposes_no_key_of_one(command: str) -> None:
    with pytest.raises(ConfigError, match=r"^gamma: unknown key; (?!.*algo\.)"):
        compose(command, ["gamma=1"])


@pytest.mark.parametrize(
    ("typed", "total"), [("1e6", 1_000_000), ("1.5e3", 1500), ("2_000", 2000), ("3000.0", 3000)]
)
def test_a_whole_number_may_be_typed_with_an_exponent(typed: str, total: int) -> None:
    assert compose("train", [f"train.total_steps={typed}"]).train.total_steps == total


def test_whole_numbers_in_a_grid() -> None:
    assert overrides.read(["train.total_steps=1e5,1e6", "algo.learning_rate=1e-3,1e2"]) == [
        "train.total_steps=100000,1000000",
        "algo.learning_rate=1e-3,1e2",
    ]


@pytest.mark.parametrize(
    "path",
    ["Größe/läufe", "日本", "with a blank", "x(1)", "a#b;c&d", "it's", "~no-such-user/x", "back\\slash"],
)
def test_any_path_can_be_typed(path: str) -> None:
    assert compose("train", [f"output={path}"]).output == path


@pytest.mark.slow
def test_the_home_folder_is_the_users(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", "/home/nemo")
    assert compose("train", ["output=~/aa"]).output == "/home/nemo/aa"


@pytest.mark.slow
def test_a_run_in_a_folder_with_a_foreign_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    here = tmp_path / "übung 1"
    (here / "conf" / "experiment").mkdir(parents=True)
    (here / "conf" / "experiment" / "mine.yaml").write_text("# @package _global_\nname: mine\nseed: 7\n")
    monkeypatch.chdir(here)
    assert cli.main(["train", "experiment=mine", "algo=pid", "output=Läufe"]) == 0
    (run,) = (here / "Läufe" / "mine").glob("*/")
    assert json.loads((run / "manifest.json").read_text(encoding="utf-8"))["seed"] == 7


@pytest.mark.parametrize("command", ["evaluate", "report", "runs", "replay", "resume"])
@pytest.mark.parametrize(
    ("typed", "meant"),
    [("output", "outputs"), ("ppo-1", "outputs/a/ppo-1"), ("outputs/b/ppo-1", "outputs/a/ppo-1")],
)
def test_a_path_that_does_not_exist_names_the_closest(
    folder: Path, capsys: pytest.CaptureFixture[str], command: str, typed: str, meant: str
) -> None:
    assert f"did you mean {meant}?" in told(capsys, command, typed)


def test_a_path_that_is_like_no_other_names_none(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert told(capsys, "runs", "zzz") == "auvbench: zzz: no such file or directory\n"


def test_a_command_of_another_program_names_ours(capsys: pytest.CaptureFixture[str]) -> None:
    assert set(cli.CORRECTIONS.values()) <= cli.COMMANDS.keys()
    assert not cli.CORRECTIONS.keys() & cli.COMMANDS.keys()
    assert "did you mean 'runs'?" in told(capsys, "list")


def test_help_of_report_explains_every_measure(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["report", "--help"]) == 0
    shown = capsys.readouterr().out
    for name in measure_names():
        assert f"\n  {name}\n      " in shown


@pytest.mark.parametrize("command", ["evaluate", "report", "runs", "resume"])
def test_a_file_is_no_run(folder: Path, capsys: pytest.CaptureFixture[str], command: str) -> None:
    (folder / "outputs" / "README.md").write_text("nothing")
    assert "README.md: is a file, not a run" in told(capsys, command, "outputs/README.md")


def test_a_protocol_nobody_was_tested_by_is_told_from_a_misspelt_one(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    prepare(compose("train", ["algo=pid", "output=trained"]))
    message = "--protocol tset: no such protocol; did you mean 'test'?"
    assert message in told(capsys, "report", "trained", "--protocol", "tset")
