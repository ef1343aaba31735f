"""An environment is made the same wherever Python is, and leaves the caller's Hydra alone."""

from __future__ import annotations

from pathlib import Path

import gymnasium
import pytest
from hydra import compose, initialize_config_dir
from hydra.core.config_store import ConfigStore
from hydra.core.global_hydra import GlobalHydra
from hydra.version import VersionBase

import auvbench
from auvbench.envs import settings
from auvbench.errors import ConfigError

assert auvbench.__version__


def own_conf(folder: Path) -> Path:
    conf = folder / "conf"
    (conf / "reward").mkdir(parents=True)
    (conf / "reward" / "thesis.yaml").write_text(
        "defaults: [/reward_thesis_schema@_here_, _self_]\nname: thesis\nk: 7.0\nlength: 20.0\nsuccess: 500.0\ncollision: -550.0\nregress: -10.0\n"
    )
    return conf


@pytest.mark.slow
def test_the_working_directory_counts_when_asked_for(tmp_path, monkeypatch):
    conf = own_conf(tmp_path)
    (conf / "train.yaml").write_text("this: is somebody else's\n")
    monkeypatch.chdir(tmp_path)
    settings._composed.cache_clear()
    assert gymnasium.make("auvbench/Waypoint-v1").unwrapped.config.reward.k == 1
    (conf / "train.yaml").unlink()
    assert gymnasium.make("auvbench/Waypoint-v1", conf="conf").unwrapped.config.reward.k == 7
    with pytest.raises(ConfigError, match="conf=cnof: no such folder"):
        gymnasium.make("auvbench/Waypoint-v1", conf="cnof")


def test_the_callers_hydra_is_left_as_it_was(tmp_path):
    (tmp_path / "mine.yaml").write_text("a: 1\n")
    store = ConfigStore.instance()
    store.store(name="train_schema", node={"mine": True})
    before = VersionBase.instance().version_base
    try:
        with initialize_config_dir(str(tmp_path), version_base="1.2"):
            hydra, base = GlobalHydra.instance().hydra, VersionBase.instance().version_base
            settings._composed.cache_clear()
            gymnasium.make("auvbench/Waypoint-v1")
            assert GlobalHydra.instance().hydra is hydra
            assert VersionBase.instance().version_base == base
            assert compose("mine").a == 1
        assert store.load("train_schema.yaml").node == {"mine": True}
    finally:
        VersionBase.instance().version_base = before
        del store.repo["train_schema.yaml"]


def test_keywords_and_overrides():
    same = [
        settings.configuration(k=40, frequency=25, vehicle="rexrov"),
        settings.configuration(overrides=["reward.k=40", "step.frequency=25", "vehicle=rexrov"]),
        settings.configuration(overrides="reward.k=40 step.frequency=25 vehicle=rexrov"),
    ]
    assert same[0] == same[1] == same[2]
    same[0].reward.k = 3.0
    assert settings.configuration(k=40, frequency=25, vehicle="rexrov").reward.k == 40, "a copy is handed out"
    with pytest.raises(ConfigError, match=r"leave out reward\.k=40"):
        settings.configuration(same[0], k=40)
    with pytest.raises(ConfigError, match="3 is not a text"):
        settings.configuration(overrides=[3])
    with pytest.raises(ConfigError, match="vehicle=rexorv: no such option; did you mean 'rexrov'"):
        settings.configuration(vehicle="rexorv")
