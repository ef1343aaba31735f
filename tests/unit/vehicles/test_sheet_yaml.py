"""Sheets are read as Hydra reads them, and no key is lost."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from omegaconf import OmegaConf

from auvbench import cli
from auvbench.config.compose import compose
from auvbench.errors import VehicleError
from auvbench.untrusted import reading
from auvbench.vehicles.sheet import load

SHEET = Path(__file__).parents[3] / "conf/vehicle/bluerov2.yaml"
SCALARS = (
    *("1e-3", "156812e-7", "1E5", ".5e-3", ".5", "1.", "1.5e3", "1_000", "1_0.5", "+1e3", "1:30", "1:30.5"),
    *("2024-01-01", "on", "Off", "~", "null", "0x1F", "010", "inf", ".inf", "-.INF", "1e", "e1", "text", "''"),
)  # fmt: skip


@pytest.mark.parametrize("scalar", SCALARS)
def test_a_value_is_what_hydra_reads(scalar: str) -> None:
    text = f"a: {scalar}"
    assert repr(reading.yaml_value(text.encode())) == repr(OmegaConf.to_container(OmegaConf.create(text)))


def sheet(folder: Path, *changes: tuple[str, str]) -> Path:
    text = SHEET.read_text(encoding="utf-8").replace("name: bluerov2\n", "name: mine\n")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "conf/vehicle/mine.yaml"
    path.parent.mkdir(parents=True)
    path.write_text(text, encoding="utf-8")
    return path


def test_a_number_with_an_exponent_is_one_for_vehicles_and_for_train(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    path = sheet(tmp_path, ("value: 15.22", "value: 1522e-2"))
    assert load(path).mass == load("mine").mass == 15.22
    assert load(OmegaConf.to_container(compose("train", ["algo=pid", "vehicle=mine"]).vehicle)).mass == 15.22
    assert cli.main(["vehicles", "mine"]) == 0


def test_keys_that_yaml_reads_as_one_truth_value_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    path = sheet(tmp_path, ("thruster1:", "on:"), ("thruster2:", "yes:"))
    with pytest.raises(VehicleError, match=r'the key on is read as a truth value.*write "on" in quotes'):
        load(path)
    for words in (["vehicles", "mine"], ["train", "algo=pid", "vehicle=mine"]):
        assert cli.main(words) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1
        assert 'write "on" in quotes' in error
    quoted = path.read_text(encoding="utf-8").replace(" on:", ' "on":').replace(" yes:", ' "yes":')
    path.write_text(quoted, encoding="utf-8")
    assert load(path).actuators == ("on", "yes", *(f"thruster{n}" for n in range(3, 7)))
    capsys.readouterr()
    assert cli.main(["train", "algo=pid", "vehicle=mine", f"output={tmp_path / 'out'}"]) == 0


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("on: 1", "on"),
        ("a: {b: [{no: 1}]}", "no"),
        ("1: x", "1"),
        ("~: x", "~"),
        ("2020-01-01: x", "2020-01-01"),
    ],
)
def test_a_key_that_is_no_text_is_refused_in_every_file(text: str, key: str) -> None:
    with pytest.raises(ValueError, match=f"line 1: the key {key} is read as"):
        reading.yaml_value(text.encode())


@pytest.mark.parametrize("text", ['"on": {"1": 2}', "a: [on, 1, ~]", "a: {<<: {b: 1}}", "a: {[on]: 1}"])
def test_texts_as_keys_and_other_values_are_read(text: str) -> None:
    if "[on]:" in text:
        with pytest.raises(ValueError, match="unhashable"):
            reading.yaml_value(text.encode())
    else:
        assert reading.yaml_value(text.encode()) == yaml.safe_load(text)
