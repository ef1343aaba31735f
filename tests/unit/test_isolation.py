"""What dependencies may read of the working directory is decided before they are imported."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from auvbench import cli, isolation
from auvbench.envs import rendering
from auvbench.errors import ConfigError


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("NUMBA_CACHE_DIR", "cache"),
        ("NUMBA_CACHE_DIR", "~/cache"),  # numba takes the tilde for a name
        ("CYCLONEDDS_URI", "file://cyclonedds.xml"),
        ("CYCLONEDDS_URI", "file:///etc/cyclonedds.xml,mine.xml"),
        ("FASTRTPS_DEFAULT_PROFILES_FILE", "./profiles.xml"),
        ("MPLCONFIGDIR", "."),
    ],
)
def test_relative_settings_are_one_line(
    name: str, value: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(name, value)
    assert cli.main(["runs"]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"auvbench: {name}=")
    assert "must be an absolute path" in error
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("CYCLONEDDS_URI", "file:///etc/cyclonedds.xml"),
        ("CYCLONEDDS_URI", "<CycloneDDS><Domain Id='any'>a:b,c</Domain></CycloneDDS>"),
        ("FASTRTPS_DEFAULT_PROFILES_FILE", "/etc/profiles.xml"),
        ("CASADIPATH", "/opt/a:/opt/b"),
    ],
)
def test_what_the_user_set_stays(name: str, value: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(name, value)
    with isolation.restored():
        isolation.isolate()
        assert os.environ[name] == value


def test_a_caller_goes_on_with_its_own_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MPLBACKEND", "module://theirs")
    monkeypatch.delenv("PYTHONSAFEPATH", raising=False)
    before = dict(os.environ)
    assert cli.main(["runs", "nowhere"]) == 2
    assert dict(os.environ) == before


CONFIGURATION = """
import os, sys
from auvbench import isolation
isolation.isolate()
before = os.getcwd()
from numba.core import config
import matplotlib
config.reload_config()
print(config.CACHE_DIR == "", os.getcwd() == before, matplotlib.rcParams["axes.facecolor"])
"""


@pytest.mark.slow
def test_files_of_the_folder_are_not_read(tmp_path: Path) -> None:
    (tmp_path / ".numba_config.yaml").write_text("cache_dir: /nowhere\n")
    (tmp_path / "matplotlibrc").write_text("axes.facecolor: red\n")
    done = subprocess.run(
        [sys.executable, "-P", "-c", CONFIGURATION], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert done.stdout == "True True white\n"


def test_the_style_is_independent_of_the_user_s() -> None:
    def drawn() -> bytes:
        with rendering.own_style(rendering.LOOK):
            figure = Figure()
            figure.add_subplot().plot([0, 1])
            canvas = FigureCanvasAgg(figure)
            canvas.draw()
            return np.asarray(canvas.buffer_rgba()).tobytes()

    plain = drawn()
    with mpl.rc_context({"axes.facecolor": "red", "font.family": "monospace", "lines.linewidth": 9}):
        assert drawn() == plain
        assert mpl.rcParams["axes.facecolor"] == "red"


@pytest.mark.skipif(importlib.util.find_spec("wandb") is None, reason="W&B is not installed")
def test_settings_of_a_folder_get_no_key(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from auvbench import tracking

    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("WANDB_DIR", raising=False)
    (tmp_path / "wandb").mkdir()
    (tmp_path / "wandb" / "settings").write_text("[default]\nbase_url = http://127.0.0.1:1\n")
    tracking.prepare.cache_clear()
    with pytest.raises(ConfigError, match=r"wandb/settings: .*WANDB_BASE_URL"):
        tracking.prepare("wandb", "default")
