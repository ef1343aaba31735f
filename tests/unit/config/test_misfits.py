"""An override that does not fit the configuration is answered in one line with what to type instead."""

from __future__ import annotations

import doctest
import math
import re
from pathlib import Path

import pytest

from auvbench import cli
from auvbench.config import misfits, validate
from auvbench.config.compose import compose
from auvbench.config.validate import limit, train_config
from auvbench.errors import ConfigError


@pytest.mark.parametrize("module", [misfits, validate])
def test_the_examples_in_the_documentation(module: object) -> None:
    assert doctest.testmod(module).failed == 0  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        # A block of values, a list and a single value.
        ("disturbance.current=0.8", "set one of disturbance.current.speed, "),
        ("noise.position=[0,1]", "set one of noise.position.low, noise.position.high"),
        ("train.checkpoint=100", "set one of train.checkpoint.steps, "),
        ("algo=ppo_residual algo.residual=3", "set one of algo.residual.share, "),
        ("algo.net_arch=64", "takes a list, for example algo.net_arch=[64]"),
        ("algo.net_arch=", "takes a list, for example algo.net_arch=[64,64]"),
        ("task=station_keeping task.station=5", "takes a list, for example task.station=[0,0,-20]"),
        ("task.start=0,0,-20", "takes a list, task.start=[0,0,-20]"),
        ("task.observation=velocity", "takes a list, for example task.observation=[velocity]"),
        ("seed=[1,2]", "takes one value, not a list, for example seed=42"),
        ("output={a:1}", "takes one value, not keys, for example output=outputs"),
        ("disturbance.current.speed.x=1", "disturbance.current.speed has no keys below it; type disturbance.current.speed=0"),
        ("sensors=bluerov2 sensors.dvl.lost=1", "sensors=bluerov2 has no sensors.dvl; use another sensors="),
        ("algo=suite_2026/waypoint_pid", "did you mean 'suite_2026/waypoint_state_pid'"),
        # Removed and added keys.
        ("~noise.position", "a key cannot be removed; set one of noise.position.low"),
        ("~algo.n_epochs", "a key cannot be removed; type algo.n_epochs=10"),
        ("~algo.nope", "there is no such key"),
        ("~seed", "a key cannot be removed; type seed=VALUE"),
        ("~task", "a key cannot be removed; type task=VALUE"),
        ("+seed=7", "seed already has a value; type seed=7"),
        ("++algo=sac", "algo already has a value; type algo=sac"),
        ("+experiment=quickstart", "experiment already has a value; type experiment=quickstart"),
        ("=3", "an override must be key=value"),
        # Groups.
        ("vehicle=/path/x.yaml", "put the file into conf/vehicle/x.yaml, then vehicle=x"),
        ("experiment=mine.yml", "put the file into conf/experiment/mine.yaml, then experiment=mine"),
        ("step=10", "no such option; valid: default, or set one of step.frequency"),
        ("algo=null", "no such option; valid: adrc, "),
        ("vehicle=[bluerov2,bluerov2_wu2018]", "takes one name; for several (a grid) type auvbench train -m vehicle=bluerov2,bluerov2_wu2018"),
        ("vehicle=[bluerov2]", "takes one name; type vehicle=bluerov2"),
        ("algo=[ppo,sac]", "takes one name; for several (a grid) type auvbench train -m algo=ppo,sac"),
        ("experiment=[quickstart,nope]", "experiment=nope: no such option"),
        ("analysis=3", "an analysis is declared in the file of an experiment"),
        ("analysis.measure=x", "an analysis is declared in the file of an experiment"),
        # Names of other programs.
        ("agent=ppo", "did you mean algo?"),
        ("lr=0.1", "did you mean algo.learning_rate?"),
        ("env=docking", "did you mean task?"),
        ("current=0.5", "did you mean disturbance.current.speed?"),
        # Several values of which one is wrong make no grid.
        ("reward.k=1,a", "reward.k: 'a' is not a number"),
        ("seed=range(0,3)", "several values make a grid: auvbench train -m 'seed=range(0,3)'"),
        ("disturbance.fault.actuator=[thruster1]", "disturbance.fault.actuator: takes one value, not a list"),
        ("protocol=test", "protocol: unknown key; it is a key of auvbench evaluate"),
        ("task=docking task.position_frame=world,body", "task.position_frame=world: unknown; valid: body"),
    ],
)  # fmt: skip
def test_it_says_what_to_type(words: str, message: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(message)) as raised:
        compose("train", words.split())
    assert "\n" not in str(raised.value)


def test_several_values_that_are_valid_are_a_grid() -> None:
    with pytest.raises(ConfigError, match=r"auvbench train -m task.position_frame=world,body"):
        compose("train", ["task.position_frame=world,body"])


def test_two_experiments_with_grids_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["train", "experiment=[quickstart,thesis]"]) == 2
    assert "an experiment with grids must be the only one" in capsys.readouterr().err


def test_a_flag_by_the_name_of_another_program(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["train", "--agent", "ppo"]) == 2
    assert "train takes it as algo=ppo" in capsys.readouterr().err


@pytest.mark.parametrize("mode", [[], ["disturbance.fault.mode=dead"]])
def test_a_fault_of_an_unknown_actuator_makes_no_run(
    mode: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for algo in ("pid", "ppo"):
        typed = [f"algo={algo}", "disturbance.fault.actuator=thruster9", *mode, f"output={tmp_path}"]
        assert cli.main(["train", *typed]) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1
        assert (
            "disturbance.fault.actuator=thruster9: bluerov2_2026 has no such actuator; did you mean" in error
        )
    assert list(tmp_path.iterdir()) == []


def test_the_ends_of_ranges_can_be_typed_as_they_are_shown() -> None:
    """Also with six digits, as docs/configuration.md shows them."""
    for digits in (6, 12):
        turn = limit(2 * math.pi, least=False, digits=digits)
        tilt = limit(-math.pi / 2, least=True, digits=digits)
        seed = limit(2**32 - 1, least=False, digits=digits)
        words = [
            f"disturbance.current.direction={turn}",
            f"disturbance.current.elevation={tilt}",
            f"seed={seed}",
        ]
        config = train_config(compose("train", words))
        assert config.seed == 2**32 - 1
        assert config.disturbance.current.direction == pytest.approx(2 * math.pi, rel=1e-5)
    with pytest.raises(ConfigError) as raised:
        train_config(compose("train", ["disturbance.current.direction=7"]))
    (shown,) = re.findall(r"at most ([\d.]+)", str(raised.value))
    train_config(compose("train", [f"disturbance.current.direction={shown}"]))
