"""The jobs of a grid are composed as Hydra composes each of them alone."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from omegaconf import DictConfig, OmegaConf

from auvbench.config.compose import compose, read
from auvbench.errors import ConfigError


def jobs(*arguments: str) -> list[DictConfig]:
    """What `auvbench train -m ARGUMENTS` composes."""
    request = read("train", ["-m", *arguments], grid=True)
    assert request is not None
    assert request.grid
    return request.configs


def alone(overrides: Sequence[str]) -> Any:
    return OmegaConf.to_container(compose("train", overrides), resolve=True)


@pytest.mark.slow
def test_each_job_is_what_it_would_be_alone() -> None:
    found = jobs(
        "algo=sac,ppo",
        "algo.learning_rate=0.01",
        "seed=3,4",
        "noise=none",
        "++task.goal_radius=0.5",
        "~experiment",
    )
    typed = [
        [f"algo={algo}", "algo.learning_rate=0.01", f"seed={seed}", "noise=none", "++task.goal_radius=0.5"]
        for algo in ("sac", "ppo")
        for seed in (3, 4)
    ]
    assert [OmegaConf.to_container(config, resolve=True) for config in found] == [
        alone(line) for line in typed
    ]


@pytest.mark.slow
def test_jobs_do_not_share_what_they_may_change() -> None:
    first, second = jobs("algo=ppo", "seed=1,2")
    first.algo.net_arch.append(8)
    assert second.algo.net_arch == compose("train", ["algo=ppo"]).algo.net_arch


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["seed=1,two"], "seed: 'two' is not a whole number"),
        (["algo=ppo,pppo"], "algo=pppo: no such option; did you mean 'ppo'"),
        (["reward.kk=1,2"], "reward.kk: unknown key; did you mean reward.k"),
        (
            ["algo=ppo,sac", "algo.n_epochs=3"],
            "algo.n_epochs: unknown key; only ppo, recurrent_ppo, ppo_residual have it",
        ),
    ],
)
def test_a_mistake_in_any_job_is_one_line(arguments: list[str], message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        jobs(*arguments)
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)


@pytest.mark.slow
def test_an_experiment_with_grids_cannot_be_an_axis(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "conf" / "experiment"
    folder.mkdir(parents=True)
    (folder / "study.yaml").write_text("# @package _global_\nhydra: {sweeper: {grids: [{seed: '1,2'}]}}\n")
    monkeypatch.chdir(tmp_path)
    assert [config.seed for config in jobs("experiment=study")] == [1, 2]
    with pytest.raises(ConfigError, match="an experiment with grids must be the only one"):
        jobs("experiment=study,null")


@pytest.mark.slow
def test_a_grid_that_nothing_remains_of_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "conf" / "experiment"
    folder.mkdir(parents=True)
    grids = "[{algo: sac, seed: '1,2'}, {algo: pid, seed: 0}]"
    (folder / "study.yaml").write_text(f"# @package _global_\nhydra: {{sweeper: {{grids: {grids}}}}}\n")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigError, match=r"algo=pid seed=1: no job"):
        jobs("experiment=study", "algo=pid", "seed=1")


@pytest.mark.slow
def test_a_value_that_only_the_swept_algorithms_have() -> None:
    composed = jobs("algo=sac,td3", "algo.learning_starts=304", "algo.net_arch=[8,8]")
    assert [config.algo.name for config in composed] == ["sac", "td3"]
    assert {config.algo.learning_starts for config in composed} == {304}
    assert all(list(config.algo.net_arch) == [8, 8] for config in composed)


def test_what_shows_one_configuration_shows_no_grid() -> None:
    with pytest.raises(ConfigError, match="leave out -m"):
        read("train", ["-m", "algo=ppo", "--cfg=job"], grid=True)


@pytest.mark.parametrize("override", ["vehicle=null", "vehicle=3", "disturbance=null"])
def test_an_option_is_a_name(override: str) -> None:
    with pytest.raises(ConfigError, match=f"{override}: no such option; valid: "):
        read("train", [override])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"name: w\n  foo: [1,2\n", r"w\.yaml.* line 2: "),
        (b"a: 1\n\tb: 2\n", r"w\.yaml.* line 2: "),
        (b"\xff\xfe\x00", "not UTF-8 text"),
        (b"defaults: [w, _self_]\n", "form a circle"),
    ],
)
def test_a_broken_file_of_conf_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, content: bytes, message: str
) -> None:
    (tmp_path / "conf" / "vehicle").mkdir(parents=True)
    (tmp_path / "conf" / "vehicle" / "w.yaml").write_bytes(content)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigError, match=message):
        read("train", ["vehicle=w"])
