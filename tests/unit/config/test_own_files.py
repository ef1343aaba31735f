"""Files of ./conf as editors and other programs write them."""

from __future__ import annotations

from pathlib import Path

import pytest

from auvbench import cli
from auvbench.config.compose import compose
from auvbench.config.validate import evaluate_config, train_config
from auvbench.errors import AuvbenchWarning, ConfigError


@pytest.fixture
def conf(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for group in ("experiment", "algo", "protocol"):
        (tmp_path / "conf" / group).mkdir(parents=True)
    return tmp_path / "conf"


@pytest.mark.parametrize(
    "text",
    [
        "# @package _global_\ntrain: {total_steps: 1e6}\n",
        "# @package _global_\ntrain: {total_steps: 1000000.0}\n",
        "\ufeff# @package _global_\ntrain: {total_steps: 1000000}\n",
        "\ufefftrain: {total_steps: 1_000_000}\n",
        "train:\r\n  total_steps: 1e6\r\n",
    ],
)
def test_an_experiment_is_read_however_it_is_written(text: str, conf: Path) -> None:
    (conf / "experiment" / "mine.yaml").write_bytes(text.encode())
    assert train_config(compose("train", ["experiment=mine"])).train.total_steps == 1_000_000


def test_whole_numbers_below_other_packages(conf: Path) -> None:
    (conf / "algo" / "mine.yaml").write_text(
        "defaults: [ppo, _self_]\nn_epochs: 1e1\nnet_arch: [3.2e1, 64]\n"
    )
    algo = train_config(compose("train", ["algo=mine"])).algo
    assert (algo.n_epochs, algo.net_arch) == (10, [32, 64])
    (conf / "protocol" / "mine.yaml").write_text("defaults: [test, _self_]\nname: mine\nepisodes: 1e2\n")
    assert evaluate_config(compose("evaluate", ["protocol=mine"])).protocol.episodes == 100


def test_a_share_of_a_whole_number_is_none(conf: Path) -> None:
    (conf / "experiment" / "mine.yaml").write_text("train: {total_steps: 1.5}\n")
    with pytest.raises(ConfigError, match=r"train.total_steps: '1.5' is not a whole number"):
        compose("train", ["experiment=mine"])


@pytest.mark.slow
def test_a_grid_takes_whole_numbers_too(conf: Path) -> None:
    grid = "hydra: {mode: MULTIRUN, sweeper: {grids: [{algo: random, seed: [1e0, 2e0]}]}}\n"
    (conf / "experiment" / "mine.yaml").write_text(grid)
    assert cli.main(["train", "experiment=mine", "output=out"]) == 0
    assert len(list(Path("out").glob("*/random-*"))) == 2


def test_a_file_that_ends_in_yml_is_named(conf: Path) -> None:
    (conf / "experiment" / "mine.yml").write_text("seed: 3\n")
    with pytest.raises(
        ConfigError, match=r"conf/experiment/mine.yml: has the wrong suffix; rename it to mine.yaml"
    ):
        compose("train", ["experiment=mine"])


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"\xff\xfe#\x00", r"conf/experiment/mine.yaml: is not UTF-8 text"),
        (b"- 1\n", r"conf/experiment/mine.yaml: must map keys to values"),
        (b"a: [\n", r"experiment/mine.yaml line 2"),
    ],
)
def test_an_unreadable_file_is_named(data: bytes, message: str, conf: Path) -> None:
    (conf / "experiment" / "mine.yaml").write_bytes(data)
    with pytest.raises(ConfigError, match=message):
        compose("train", ["experiment=mine"])


@pytest.mark.parametrize("entry", ["train", "evaluate", "tune", "simulate"])
def test_the_entry_of_another_program_is_passed_over(entry: str, conf: Path) -> None:
    (conf / f"{entry}.yaml").write_text("defaults: [model: resnet]\nlr: 0.1\n")
    with pytest.warns(
        AuvbenchWarning, match=f"conf/{entry}.yaml is ignored: it is not a configuration of auvbench"
    ):
        assert "lr" not in compose(entry)


def test_an_entry_of_one_s_own_is_read(conf: Path) -> None:
    text = (Path(__file__).parents[3] / "conf" / "train.yaml").read_text()
    (conf / "train.yaml").write_text(text.replace("seed: 42", "seed: 7"))
    assert compose("train").seed == 7
