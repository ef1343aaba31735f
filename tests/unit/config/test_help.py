"""`--help` shows the common options with their true defaults, and `--help all` every key."""

from __future__ import annotations

import re

import pytest
from omegaconf import OmegaConf

from auvbench import cli
from auvbench.config.compose import compose


def shown(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert cli.main(list(arguments)) == 0
    return capsys.readouterr().out


@pytest.mark.parametrize("entry", ["train", "tune", "simulate"])
def test_the_common_options_come_first_with_their_defaults(
    capsys: pytest.CaptureFixture[str], entry: str
) -> None:
    text = shown(capsys, entry, "--help")
    options = re.findall(
        r"^  ([\w.]+)=(\S+)", text.partition("common options")[2].partition("flags:")[0], re.M
    )
    config = compose(entry)
    assert len(options) > 5
    for key, value in options:
        found = OmegaConf.select(config, key)
        name = found.name if OmegaConf.is_dict(found) else found
        name = "null" if name is None else name
        if key == "experiment":
            assert value == "null"
        elif key == "task":  # a file of the waypoint task
            assert value == "waypoint_state"
        elif key != "disturbance":  # its file has no name
            assert str(name).replace(" ", "").replace(".0", "") == value.replace(".0", ""), key
    assert "--help all" in text
    assert "batch_size" not in text
    assert len(text.splitlines()) < 70


def test_help_all_shows_every_key(capsys: pytest.CaptureFixture[str]) -> None:
    text = shown(capsys, "train", "--help", "all", "algo=sac")
    assert "common options" in text
    assert "buffer_size" in text
