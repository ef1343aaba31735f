"""The fingerprint covers what computes outcomes, survives refactoring and the last bits of another machine."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from omegaconf import OmegaConf

import auvbench
from auvbench.config import schema
from auvbench.config.compose import compose, typed
from auvbench.evaluation import reference
from auvbench.simulators import fossen

PACKAGE = Path(auvbench.__file__).parent

PLAY = """
from omegaconf import OmegaConf
from auvbench.config.compose import compose, typed
from auvbench.evaluation import reference
config = OmegaConf.create(OmegaConf.to_container(compose("train", ["disturbance=severe"]), resolve=True))
print(reference.digest(typed(config), None))
"""


@lru_cache
def config(*overrides: str) -> schema.TrainConfig:
    return typed(OmegaConf.create(OmegaConf.to_container(compose("train", list(overrides)), resolve=True)))


def digest(*overrides: str) -> str:
    return reference.digest(config(*overrides), None)


def played_elsewhere(folder: Path, file: str = "", old: str = "", new: str = "") -> str:
    """Return the digest of a copy of the package in which one file was changed, interpreted instead of compiled."""
    shutil.copytree(PACKAGE, folder / "auvbench", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(PACKAGE.parent / "conf", folder / "auvbench" / "conf", dirs_exist_ok=True)
    if file:
        source = folder / "auvbench" / file
        text = source.read_text()
        assert old in text
        source.write_text(text.replace(old, new))
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(folder)}
    done = subprocess.run(
        [sys.executable, "-c", PLAY], capture_output=True, text=True, cwd=folder, env=environment, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split()[-1]


@pytest.mark.slow
def test_it_is_the_same_interpreted_and_compiled(tmp_path: Path) -> None:
    assert played_elsewhere(tmp_path) == digest("disturbance=severe")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("file", "old", "new"),
    [
        ("dynamics/equations.py", "absolute(v)", "scale(2.0, absolute(v))"),
        ("tasks/rewards.py", "return float(p.success)", "return float(2 * p.success)"),
    ],
)
def test_changed_sources_change_it(tmp_path: Path, file: str, old: str, new: str) -> None:
    assert played_elsewhere(tmp_path, file, old, new) != digest("disturbance=severe")


@pytest.mark.slow
def test_a_doubled_drag_changes_it_and_a_thousandth_does_too(monkeypatch: pytest.MonkeyPatch) -> None:
    before = digest()
    ordinary = fossen.parameter_rows
    for factor in (2.0, 1.001):

        def draggy(vehicle: object, scales: np.ndarray, factor: float = factor) -> np.ndarray:
            return ordinary(vehicle, scales * [1, 1, 1, 1, factor, 1])  # type: ignore[arg-type]

        monkeypatch.setattr(fossen, "parameter_rows", draggy)
        assert digest() != before


@pytest.mark.slow
def test_agents_and_their_rewards_do_not_enter() -> None:
    same = ["algo=pid", "reward.k=100", "seed=7", "task.position_frame=body", "task.max_steps=77"]
    assert {digest(override) for override in same} == {digest()}


@pytest.mark.slow
@pytest.mark.parametrize(
    "override",
    [
        "vehicle=rexrov",
        "noise=none",
        "disturbance=severe",
        "simulator.max_step=0.003",
        "disturbance.randomisation.damping={low: 1.1, high: 1.1}",
    ],
)
def test_what_is_played_enters(override: str) -> None:
    assert digest(override) != digest()


@pytest.mark.slow
def test_the_last_bits_of_another_machine_do_not_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    """Errors of a hundred last places, in every number, on vehicles and disturbances of many kinds."""
    conditions = [("vehicle=" + name,) for name in ("bluerov2", "bluerov2_heavy", "rexrov", "lrauv")]
    conditions += [("disturbance=" + name,) for name in ("calm", "moderate", "severe")]
    before = [digest(*condition) for condition in conditions]
    ordinary, rng = reference._played, np.random.default_rng(1)

    def jittered(*arguments: object) -> Iterator[tuple[str, np.ndarray]]:
        for name, values in ordinary(*arguments):  # type: ignore[arg-type]
            yield name, values * (1.0 + 100 * 2.0**-52 * rng.uniform(-1, 1, values.shape))

    monkeypatch.setattr(reference, "_played", jittered)
    assert [digest(*condition) for condition in conditions] == before


def test_some_arrive_some_leave_the_water_and_some_run_out_of_time() -> None:
    outcomes = dict(reference._played(config("vehicle=bluerov2", "task=waypoint"), None))["outcome"]
    assert set(outcomes.tolist()) == {0.0, 1.0, 2.0}
