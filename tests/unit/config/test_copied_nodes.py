"""`copied` makes what `copy.deepcopy` makes, and the loader what Hydra's makes, node by node."""

from __future__ import annotations

import copy
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from types import SimpleNamespace

import pytest
from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra.errors import ConfigCompositionException
from hydra.types import RunMode
from omegaconf import DictConfig, Node, OmegaConf
from omegaconf.errors import ReadonlyConfigError, ValidationError

from auvbench.config import compose
from auvbench.config.copies import copied


@dataclass
class Inner:
    size: float = 1.0
    names: list[str] = field(default_factory=lambda: ["a", "${outer}"])


@dataclass
class Outer:
    inner: Inner = field(default_factory=Inner)
    either: int | str = 3
    missing: Inner | None = None
    outer: str = "???"


def config() -> DictConfig:
    made = OmegaConf.merge(OmegaConf.structured(Outer), {"inner": {"size": 2.5}})
    OmegaConf.set_readonly(made.inner, True)
    assert isinstance(made, DictConfig)
    return made


def assert_same(one: Node, other: Node, parents: tuple[object, object] = (None, None)) -> None:
    assert type(one) is type(other)
    mine, yours = vars(one), vars(other)
    assert mine.keys() == yours.keys()
    assert mine["_parent"] is parents[0]
    assert yours["_parent"] is parents[1]
    assert vars(mine["_metadata"]) == vars(yours["_metadata"])
    assert mine["_metadata"].flags is not yours["_metadata"].flags
    assert mine.get("_val") == yours.get("_val")
    content, twin = mine.get("_content"), yours.get("_content")
    assert type(content) is type(twin)
    if isinstance(content, Node):
        assert_same(content, twin, (one, other))
    elif isinstance(content, dict | list):
        pairs = zip(*(c.values() if isinstance(c, dict) else c for c in (content, twin)), strict=True)
        assert not isinstance(content, dict) or list(content) == list(twin)
        for a, b in pairs:
            assert_same(a, b, (one, other))


def test_a_copy_is_that_of_deepcopy() -> None:
    made = config()
    assert_same(copy.deepcopy(made), copied(made))


def test_a_copy_changes_alone_and_keeps_types_and_flags() -> None:
    made = config()
    twin = copied(made)
    twin.either, twin.outer = "word", "b"
    assert (made.either, twin.inner.names[1]) == (3, "b")
    with pytest.raises(ReadonlyConfigError):
        twin.inner.size = 1.0
    OmegaConf.set_readonly(twin.inner, False)
    with pytest.raises(ValidationError):
        twin.inner.size = "large"
    with pytest.raises(ReadonlyConfigError):
        made.inner.size = 1.0


@pytest.mark.parametrize(
    "choices", ["task=transit", "algo=ppo_residual disturbance=[current,waves]", "experiment=quickstart"]
)
def test_a_configuration_is_as_hydra_composes_it(choices: str, monkeypatch: pytest.MonkeyPatch) -> None:
    nodes = []
    begun = datetime.now()  # Hydra's configuration contains the time of day.
    monkeypatch.setattr("hydra.core.utils.datetime", SimpleNamespace(now=lambda: begun))
    for loader, interpolations in (
        (compose._Loader, compose._interpolations),
        (ConfigLoaderImpl, compose._create_interpolation_map),
    ):
        monkeypatch.setattr(compose, "_Loader", loader)
        monkeypatch.setattr(compose, "_interpolations", interpolations)
        with compose._loader(None) as own:
            nodes.append(own.load_configuration("train", choices.split(), RunMode.RUN))
    assert_same(*nodes)


def test_a_wrong_value_in_a_file_is_named_as_hydra_names_it(tmp_path: Path) -> None:
    (tmp_path / "experiment").mkdir()
    (tmp_path / "experiment" / "wrong.yaml").write_text("train:\n  total_steps: many\n")
    with (
        compose._loader(tmp_path) as own,
        pytest.raises(ConfigCompositionException, match="experiment/wrong"),
    ):
        own.load_configuration("train", ["experiment=wrong"], RunMode.RUN)
