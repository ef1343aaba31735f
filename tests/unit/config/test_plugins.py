"""What installed packages bring: chosen, listed, checked, and refused in one line."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from omegaconf import OmegaConf

from auvbench import cli
from auvbench.commands.completion import candidates
from auvbench.config import folders
from auvbench.config.compose import compose, typed
from auvbench.config.validate import train_config
from auvbench.errors import ConfigError
from auvbench.registry import AGENTS
from auvbench.runs.identity import run_id
from auvbench.vehicles import reader
from tests.packages import MINE, Site, learning, site, steering

__all__ = ["site"]


def composed(*overrides: str) -> dict[str, object]:
    found = OmegaConf.to_container(compose("train", list(overrides)), resolve=True)
    assert isinstance(found, dict)
    return {str(key): value for key, value in found.items()}


def refused(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    """The one line with which a command ends with exit code 2."""
    assert cli.main(list(words)) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1, error
    return error


@pytest.mark.slow
def test_it_is_chosen_with_its_types_and_its_package(site: Site) -> None:
    steering(site)
    algo = composed("algo=mine", "algo.gain=2", "algo.patience=1e3")["algo"]
    assert algo == {
        "name": "mine",
        "agent": "mine",
        "n_envs": 1,
        "gain": 2.0,
        "patience": 1000,
        "package": "mine-package==1.0",
        "learns": False,
        "tuned": None,
    }
    config = train_config(compose("train", ["algo=mine"]))
    assert type(config.algo).__name__ == "MineConfig"
    assert config.algo.gain == 0.5


@pytest.mark.slow
def test_it_is_listed_and_completed_without_being_imported(
    site: Site, capsys: pytest.CaptureFixture[str]
) -> None:
    steering(site)
    (site.folder / "mine/__init__.py").write_text("raise RuntimeError('imported')")
    assert "mine" in folders.options("algo")
    assert candidates(["report", "outputs", "--baseline", "mi"]) == ["mine"]
    assert cli.main(["train", "--help"]) == 0
    assert " mine," in capsys.readouterr().out
    assert "mine" not in sys.modules


@pytest.mark.slow
@pytest.mark.parametrize(
    ("typed", "message"),
    [
        ("algo.gain=abc", "algo.gain: 'abc' is not a number"),
        ("algo.gain=-1", "algo.gain=-1: must be more than 0 and at most 10"),
        ("algo.gian=1", "algo.gian: unknown key; did you mean algo.gain?"),
        ("algo.patience=1.5", "algo.patience: '1.5' is not a whole number"),
        (
            "+algo.package=other",
            "algo.package=other: auvbench sets it (mine-package==1.0); leave it out",
        ),
        ("+algo.learns=true", "algo.learns=True: auvbench sets it (False); leave it out"),
        ("algo.name=../up", "must be a plain name"),
    ],
)
def test_what_is_typed_wrong_is_one_line(
    site: Site, capsys: pytest.CaptureFixture[str], typed: str, message: str
) -> None:
    steering(site)
    assert message in refused(capsys, "train", "algo=mine", typed)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("import nothing_of_this_name", "ModuleNotFoundError: No module named 'nothing_of_this_name'"),
        ("raise SystemExit(0)", "cannot be imported: SystemExit: 0"),
        (
            "def other(): pass",
            "cannot be imported: AttributeError: module 'mine.steering' has no attribute 'Mine'",
        ),
        ("Mine = 3", "is a int; it must be a class or a function"),
        (
            "class Mine:\n    Config = 3",
            "mine.steering:Mine of mine-package==1.0 has a Config that is not a dataclass derived from",
        ),
        ("class Mine:\n    def learn(self): pass", "learns but lacks save, load, exact_resume"),
        (
            "class Mine:\n    exact_resume = True\n    def learn(self): pass\n    save = load = state = learn",
            "learns but lacks restore",
        ),
    ],
)
def test_what_cannot_be_used_is_named_with_its_package(
    site: Site, capsys: pytest.CaptureFixture[str], text: str, message: str
) -> None:
    steering(site)
    (site.folder / "mine/steering.py").write_text(text)
    site.look_again()
    error = refused(capsys, "train", "algo=mine")
    assert message in error
    assert "mine-package==1.0" in error
    assert cli.main(["train", "algo=pid", "--cfg", "job"]) == 0  # nobody else is concerned


@pytest.mark.slow
def test_two_packages_with_one_name(site: Site, capsys: pytest.CaptureFixture[str]) -> None:
    steering(site)
    site.install("other", {"other.py": ""}, agents={"mine": "other:Mine"})
    error = refused(capsys, "train", "algo=mine")
    assert "algo.agent=mine: mine-package and other each provide a part of this name" in error
    assert "pip uninstall" in error


def test_two_packages_with_one_file(site: Site, capsys: pytest.CaptureFixture[str]) -> None:
    steering(site)
    site.install("other", {"other/__init__.py": "", "other/conf/algo/mine.yaml": MINE}, conf="other.conf")
    assert "algo=mine: mine-package==1.0 and other==1.0 have the same file" in refused(
        capsys, "train", "algo=mine"
    )


def test_an_agent_without_a_file(site: Site, capsys: pytest.CaptureFixture[str]) -> None:
    site.install("bare", {"bare.py": ""}, agents={"bare": "bare:Agent"})
    assert "algo=bare: no such option" in refused(capsys, "train", "algo=bare")


@pytest.mark.slow
def test_names_of_auvbench_itself_are_taken(site: Site, capsys: pytest.CaptureFixture[str]) -> None:
    steering(site)
    files = {"thief/__init__.py": "", "thief/conf/algo/pid.yaml": MINE}
    site.install("thief", files, agents={"ppo": "thief:PPO"}, conf="thief.conf")
    assert "algo=pid: thief==1.0 and auvbench itself have the same file" in refused(
        capsys, "train", "algo=pid"
    )
    assert "algo.agent=ppo: auvbench and thief each provide a part of this name" in refused(
        capsys, "train", "algo=ppo"
    )


def test_a_folder_that_is_not_there(site: Site, capsys: pytest.CaptureFixture[str]) -> None:
    site.install("empty", {"empty/__init__.py": ""}, conf="empty.conf")
    assert "auvbench.conf: empty.conf of empty==1.0 is not a folder" in refused(capsys, "train", "algo=pid")


def test_a_package_s_files_name_no_code(site: Site, capsys: pytest.CaptureFixture[str]) -> None:
    steering(site)
    (site.folder / "mine/conf/algo/mine.yaml").write_text("name: mine\nagent: mine\n_target_: os.system\n")
    assert "a configuration cannot name code" in refused(capsys, "train", "algo=mine")


@pytest.mark.slow
def test_a_configuration_names_no_code_but_an_entry_point_s(
    site: Site, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (site.folder / "loose.py").write_text("raise RuntimeError('imported')")
    (tmp_path / "conf/algo").mkdir(parents=True)
    (tmp_path / "conf/algo/loose.yaml").write_text("name: loose\nagent: loose:Agent\nn_envs: 1\n")
    monkeypatch.chdir(tmp_path)
    assert "algo.agent=loose:Agent: unknown" in refused(capsys, "train", "algo=loose")


@pytest.mark.slow
def test_vehicles_and_protocols_of_a_package(site: Site) -> None:
    conf = Path(__file__).parents[3] / "conf"
    sheet = (conf / "vehicle/bluerov2.yaml").read_text().replace("name: bluerov2", "name: theirs", 1)
    protocol = (conf / "protocol/test.yaml").read_text().replace("name: test", "name: brief", 1)
    site.install(
        "fleet",
        {
            "fleet/__init__.py": "",
            "fleet/sheets/vehicle/theirs.yaml": sheet,
            "fleet/sheets/protocol/brief.yaml": protocol,
        },
        conf="fleet.sheets",
    )
    assert "theirs" in reader.sheet_names()
    assert composed("vehicle=theirs")["vehicle"]["name"] == "theirs"  # type: ignore[index]
    assert compose("evaluate", ["protocol=brief"]).protocol.name == "brief"


@pytest.mark.slow
def test_version_and_package_are_part_of_a_run_s_identity(site: Site) -> None:
    steering(site)
    first = run_id(composed("algo=mine"))
    assert run_id(composed("algo=mine")) == first
    assert run_id(composed("algo=mine", "train.total_steps=7")) == first  # nothing to learn
    steering(site, version="1.1")
    assert run_id(composed("algo=mine")) != first
    learning(site)
    assert run_id(composed("algo=slow")) != run_id(composed("algo=slow", "train.total_steps=7"))


@pytest.mark.slow
def test_a_frozen_configuration_wants_the_package_it_was_made_with(site: Site) -> None:
    steering(site)
    frozen = OmegaConf.create(composed("algo=mine"))
    assert type(typed(frozen).algo).__name__ == "MineConfig"
    steering(site, version="2.0")
    with pytest.raises(
        ConfigError, match=r"comes with mine-package==1\.0, and mine-package==2\.0 is installed; pip"
    ):
        typed(frozen)
    site.uninstall("mine-package")
    with pytest.raises(
        ConfigError, match=r"and is not installed|is not installed; pip install 'mine-package==1\.0'"
    ):
        typed(frozen)
    assert AGENTS.find("mine") is None
