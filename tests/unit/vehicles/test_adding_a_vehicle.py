"""docs/adding-a-vehicle.md does what it says: its commands run with the sheet that it includes, examples/polyu.yaml."""

from __future__ import annotations

import re
import shlex
import shutil
from pathlib import Path

import pytest

from auvbench.cli import main

ROOT = Path(__file__).parents[3]
PAGE = ROOT / "docs" / "adding-a-vehicle.md"


def blocks(kind: str) -> list[str]:
    return re.findall(rf"```{kind}\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)


@pytest.fixture
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "conf" / "vehicle").mkdir(parents=True)
    shutil.copy(ROOT / "examples" / "polyu.yaml", tmp_path / "conf" / "vehicle")


@pytest.mark.usefixtures("_folder")
@pytest.mark.slow
def test_the_commands_of_the_page(capsys: pytest.CaptureFixture[str]) -> None:
    lines = [line.removeprefix("$ ") for block in blocks("console") for line in block.splitlines()]
    typed = [shlex.split(line)[1:] for line in lines if line.startswith("auvbench ") and ">" not in line]
    assert [words[0] for words in typed] == [
        "vehicles",
        "simulate",
        "simulate",
        "train",
        "train",
        "evaluate",
        "report",
    ]
    for words in typed:
        if "algo=ppo" not in words:  # the learner's own tests train it
            assert main([*words, "protocol.episodes=20"] if words[0] == "evaluate" else words) == 0, words
    assert Path("forward.png").is_file()
    assert Path("push.csv").is_file()
    assert Path("outputs/polyu/report").is_dir()
    assert "PID" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.usefixtures("_folder")
def test_what_the_page_says_of_its_sheet(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["vehicles", "polyu"]) == 0
    assert "1.910 m/s" in capsys.readouterr().out
    own = Path("conf/vehicle/polyu.yaml")
    linear = own.read_text(encoding="utf-8").replace(
        "[33.73, 54.16, 73.23, 3.99, 3.99, 3.99]", "[0, 0, 0, 0, 0, 0]"
    )
    own.write_text(linear, encoding="utf-8")
    assert main(["vehicles", "polyu"]) == 0
    out = capsys.readouterr().out
    assert "12.393 m/s" in out
    assert "drag is only linear in surge, sway and heave" in out


def test_a_printed_sheet_is_a_sheet(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["vehicles", "rexrov", "--sheet"]) == 0
    own = tmp_path / "copy.yaml"
    own.write_text(capsys.readouterr().out, encoding="utf-8")
    assert main(["vehicles", str(own)]) == 0
