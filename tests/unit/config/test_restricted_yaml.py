"""A folder from a stranger with a conf/ in it: its files give values and run nothing."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from auvbench import cli
from auvbench.runs import directory
from tests.unit.runs.test_damage import frozen

CALL = "{_target_: pathlib.Path.touch, self: {_target_: pathlib.Path, _args_: [owned]}}"
LOGGING = (
    "{version: 1, handlers: {h: {(): pathlib.Path.touch, self: ext://sys.stdout}}, root: {handlers: [h]}}"
)

PRESET = "# @package _global_\n"
FILES: dict[str, dict[str, str]] = {
    "callbacks": {"experiment/evil.yaml": f"{PRESET}hydra: {{callbacks: {{x: {CALL}}}}}"},
    "logging": {"experiment/evil.yaml": f"{PRESET}hydra: {{job_logging: {LOGGING}}}"},
    "hydra's logging": {"experiment/evil.yaml": f"{PRESET}hydra: {{hydra_logging: {LOGGING}}}"},
    "environment": {"experiment/evil.yaml": f"{PRESET}hydra: {{job: {{env_set: {{LD_PRELOAD: evil.so}}}}}}"},
    "search path": {"train.yaml": "defaults: [train_schema]\nhydra: {searchpath: ['pkg://evil']}"},
    "launcher": {"experiment/evil.yaml": f"{PRESET}hydra: {{launcher: {CALL}}}"},
    "sweeper": {"hydra/sweeper/auvbench.yaml": "_target_: evil.Sweeper\n"},
    "a group of Hydra's": {"hydra/job_logging/default.yaml": "version: 1\n"},
    "a package in the header": {"experiment/evil.yaml": "# @package hydra.callbacks\nx: {y: 1}"},
    "a package in the defaults": {
        "experiment/evil.yaml": f"{PRESET}defaults: [/noise@hydra.job_logging: evil]",
        "noise/evil.yaml": "version: 1\n",
    },
    "a target anywhere": {"experiment/evil.yaml": f"{PRESET}reward: {{k: {CALL}}}"},
    "a folder to write into": {"experiment/evil.yaml": f"{PRESET}hydra: {{output_subdir: x}}"},
    "a folder to change into": {"experiment/evil.yaml": f"{PRESET}hydra: {{run: {{dir: /tmp/evil}}}}"},
}


@pytest.fixture(autouse=True)
def somewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["auvbench"])
    package = tmp_path / "evil"
    package.mkdir()
    (package / "__init__.py").write_text("import pathlib; pathlib.Path('owned').touch()")
    monkeypatch.syspath_prepend(str(tmp_path))
    return tmp_path


@pytest.mark.slow
@pytest.mark.parametrize("case", FILES)
def test_files_in_conf_run_no_code(case: str, somewhere: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name, text in FILES[case].items():
        path = somewhere / "conf" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    choice = ["experiment=evil"] if any("experiment" in name for name in FILES[case]) else []
    for flags in (["--cfg", "job"], ["train.total_steps=0"], ["-m", "train.total_steps=0", "seed=1,2"]):
        assert cli.main(["train", *flags, *choice]) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1
        assert error.startswith("auvbench: conf/"), error
    assert not (somewhere / "owned").exists()


@pytest.mark.parametrize(
    "override",
    [
        "+hydra.callbacks.x._target_=evil.x",
        "hydra.job_logging.version=2",
        "+hydra.job.env_set.LD_PRELOAD=x",
        "hydra.launcher._target_=evil.x",
    ],
)
def test_what_is_typed_reaches_no_code_either(override: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["train", override, "train.total_steps=0"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("experiment/evil.yaml", f"{PRESET}defaults: [/../secret@reward]"),
        ("experiment/evil.yaml", f"{PRESET}defaults: [/noise/../../secret@reward]"),
        ("experiment/evil.yaml", None),  # a link
    ],
)
def test_no_file_outside_of_conf_is_read(
    name: str, content: str | None, somewhere: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (somewhere / "secret.yaml").write_text("password: hunter2\n")
    path = somewhere / "conf" / name
    path.parent.mkdir(parents=True)
    (somewhere / "conf" / "noise").mkdir()
    if content is None:
        path.symlink_to(somewhere / "secret.yaml")
    else:
        path.write_text(content)
    assert cli.main(["train", "--cfg", "job", "experiment=evil"]) == 2
    captured = capsys.readouterr()
    assert "hunter2" not in captured.out + captured.err
    assert captured.err.count("\n") == 1
    assert "is outside conf/" in captured.err


def test_help_of_a_folder_is_shown_as_text(somewhere: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = somewhere / "conf" / "hydra" / "help" / "auvbench_train.yaml"
    path.parent.mkdir(parents=True)
    path.write_text('template: "\\e[2Jhello\\nworld\\n\\e]0;title\\a"\n')
    assert cli.main(["train", "--help"]) == 0
    assert capsys.readouterr().out == "\\x1b[2Jhello\nworld\n\\x1b]0;title\\x07\n"


def test_presets_and_sheets_of_one_s_own_work(somewhere: Path, capsys: pytest.CaptureFixture[str]) -> None:
    preset = somewhere / "conf" / "experiment" / "mine.yaml"
    preset.parent.mkdir(parents=True)
    preset.write_text(
        f"{PRESET}name: mine\nhydra:\n  sweeper:\n    params: {{seed: '0,1'}}\nreward: {{k: 7}}\n"
    )
    assert cli.main(["train", "--cfg", "job", "experiment=mine"]) == 0
    assert "k: 7" in capsys.readouterr().out


@pytest.mark.parametrize(
    "text", ["a: " + "[" * 100_000, "a0: &a0 [x,x,x,x,x,x,x,x,x,x]\n" + "".join(
        f"a{n}: &a{n} [{','.join([f'*a{n - 1}'] * 10)}]\n" for n in range(1, 10)
    )]
)  # fmt: skip
def test_a_file_without_end_is_one_line(
    text: str, somewhere: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = somewhere / "conf" / "reward" / "evil.yaml"
    path.parent.mkdir(parents=True)
    path.write_text(text)
    for command in ("train", "simulate"):
        group = "reward" if command == "train" else "vehicle"
        (somewhere / "conf" / group).mkdir(exist_ok=True)
        (somewhere / "conf" / group / "evil.yaml").write_text(text)
        assert cli.main([command, f"{group}=evil"]) == 2
        assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.slow
@pytest.mark.parametrize("value", ["${oc.env:HOME}", "${seed}", "a${nope}b"])
def test_a_frozen_configuration_is_never_resolved(
    value: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    run = frozen(tmp_path, "algo=random", state="complete")
    monkeypatch.setattr(directory.identity, "mismatch", lambda *_: "")  # the digest is not what refuses it
    config = run.config()
    config["vehicle"]["title"] = value
    run.write_config(config)
    for arguments in (["resume"], ["evaluate"], ["replay"], ["resume", "train.total_steps=99999999"]):
        command, *rest = arguments
        assert cli.main([command, str(run.path), *rest]) in (1, 2)
        error = capsys.readouterr().err
        assert "vehicle.title is" in error
        assert "the file was edited, since a run" in error
    assert value in run.config_path.read_text()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("key", "value"),
    [
        *(
            ("seed", value)
            for value in ("${nope}", "${oc.env:NOPE}", "${oc.env:}", "${", "${hydra:nope}", "${seed")
        ),
        *((key, "${nope}") for key in ("output", "vehicle", "+x", "reward.k", "name", "algo.net_arch")),
    ],
)
def test_an_interpolation_of_nothing_is_one_line(
    key: str, value: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    for command in (
        ["train"],
        ["simulate"],
        ["evaluate", str(tmp_path)],
        ["train", "-m"],
        ["train", "--cfg", "job"],
    ):
        code = cli.main([*command, f"{key}={value}"])
        error = capsys.readouterr().err
        assert code in (0, 2)
        assert error.count("\n") == (code == 2)
