"""The code blocks of README.md and docs/ run, page by page in the order of the page, with tiny budgets.

A page begins in a folder with the runs of `prepare`. Trainings have 64 steps, tests 2 episodes, grids two runs of each algorithm, or
one if there are many algorithms.
"""

from __future__ import annotations

import contextlib
import re
import shlex
import shutil
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from omegaconf import DictConfig

from auvbench.cli import main
from auvbench.commands import plan
from auvbench.config import complete as completing
from auvbench.config import compose, grids
from auvbench.envs import settings
from auvbench.metrics import Metric
from auvbench.reporting import replay_pictures
from tests import synthetic
from tests.conftest import Once
from tests.docs_blocks import MISTAKES, PAGES, ROOT, steps

NOT_RUN = {
    r"pursuit|circling|outputs/poles": "installs a package: tests/integration/test_example_package.py runs these pages",
    r"my_agent|^train -m \.\.\.": "the reader's own agent or words",
    r"simulator=gazebo|protocol=gazebo": "Gazebo",
    r"--face ardusub|--mavlink": "ArduSub: tests/unit/ardusub and tests/unit/mavlink",
    r"^serve|^pilot|protocol=ros2|simulator=ros2|^replay missions": "ROS 2: tests/integration/test_ros2_*.py",
    r"^bound protocol=test": "hours",
    r"experiment=tune_all": "hours: a study of every algorithm",
    r"algo=ardusub|outputs/ardusub": "ArduSub's SITL: tests/integration/test_ardusub_contest.py",
    r"mine\.onnx": "the reader's own network",
    r"bottom\.npz": "the reader's own grid: tests/unit/worlds/test_bottom_files.py",
    r"sealed-2026": "files that one person keeps: tests/unit/evaluation/test_sealed.py",
    r"state=failed,interrupted": "a run that failed",
    r"^identify|^validate": "the reader's logs: tests/unit/identification",
}
"""regular expressions of blocks, and what they need"""
COUNTS = {"run": 131, "not run": 47}


SMALL = {
    "n_envs": 2,
    "n_steps": 8,
    "batch_size": 8,
    "n_epochs": 1,
    "net_arch": [8],
    "learning_starts": 8,
    "buffer_size": 200,
    "gradient_steps": 1,
    "members": 1,
    "samples": 16,
    "updates": "sb3",  # nothing to compile
}
PREPARED = (
    "train -m experiment=quickstart",
    "train -m algo=ppo,sac seed=0,42",
    "train -m algo=pid vehicle=rexrov reward.k=1,40",
    "evaluate outputs",
)


def reason(text: str) -> str | None:
    """Return why a block is not run; None where it is."""
    return next((why for pattern, why in NOT_RUN.items() if re.search(pattern, text)), None)


BLOCKS = [(page, text, reason(text)) for page in PAGES for kind, text in steps(page) if kind != "yaml"]


def shrink(config: DictConfig) -> None:
    """Set tiny budgets in a composed configuration."""
    if "train" in config:
        config.train.total_steps = 64
        for key, value in SMALL.items():
            if key in config.algo and "tune" not in config:  # whose ranges fit the usual values
                config.algo[key] = value
    if "protocol" in config:
        config.protocol.episodes = 2
        config.protocol.conditions = config.protocol.conditions[:2]
    if "tune" in config:
        if "updates" in config.algo:
            config.algo.updates = "sb3"
        config.tune.trials, config.tune.startup = 2, 1
        config.tune.rungs, config.tune.fresh_seeds = [64], [1000]


def two_of_each(jobs: list[list[str]]) -> list[list[str]]:
    """Return the overrides of the first two jobs of each algorithm, of the first alone where there are many."""
    names = [next((word for word in job if word.startswith("algo=")), "") for job in jobs]
    most = 2 if len(set(names)) <= 4 else 1
    seen: Counter[str] = Counter()
    kept = []
    for name, job in zip(names, jobs, strict=True):
        seen[name] += 1
        if seen[name] <= most:
            kept.append(job)
    return kept


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    complete, jobs = completing.complete, grids.jobs

    def completed(config: DictConfig, **words: Any) -> DictConfig:
        found = complete(config, **words)
        if not words.get("frozen"):
            shrink(found)
        return found

    monkeypatch.setattr(completing, "complete", completed)
    monkeypatch.setattr(plan, "REPLICATIONS", 10)
    monkeypatch.setattr(grids, "jobs", lambda found: two_of_each(jobs(found)))
    assert compose.complete is completing
    yield
    settings._composed.cache_clear()  # Later tests of this process take the usual budgets.


def with_ids(text: str) -> str:
    """Return a text with the ids of the runs that are here: an id ends in a hash of the configuration."""
    return re.sub(
        r"\b([a-z]+(?:-\w+)?-k\d+-f\d+-s\d+)-[0-9a-f]{8}",
        lambda id: next(Path("outputs").rglob(f"{id[1]}-*")).name,
        text,
    )


def run(line: str) -> None:
    """Run a line of `auvbench` here, in the current folder."""
    text = re.sub(r"train\.total_steps=\d+$", "train.total_steps=128", line)
    text = re.sub(r"--episode \d+", "--episode 1", text)
    text, _, target = text.partition(" > ")
    text = with_ids(text)
    words = [
        path
        for word in shlex.split(text)
        for path in (
            sorted(map(str, Path().glob(word))) if word.endswith("*") and "=" not in word else [word]
        )
    ]
    if words[0] == "report" and words[1] != "--help":
        words += ["--no-figures", "--format", "terminal,md,csv"]
    with contextlib.ExitStack() as stack:
        if target:
            Path(target).parent.mkdir(parents=True, exist_ok=True)
            stack.enter_context(contextlib.redirect_stdout(stack.enter_context(open(target, "w"))))
        code = main(words)
    assert code == (2 if line in MISTAKES else 0), line


def prepare(folder: Path) -> None:
    with contextlib.chdir(folder):
        for line in PREPARED:
            run(line)


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_the_blocks_of_a_page_run(
    page: Path, once: Once, small: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    blocks = [(kind, text) for kind, text in steps(page) if reason(text) is None]
    if not {kind for kind, _ in blocks} & {"auvbench", "python"}:
        pytest.skip("no block to run")
    shutil.copytree(once("docs", prepare), tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    protocols = {"test": ("nominal",), "robustness": synthetic.ROBUSTNESS[:6]}
    for name in ("thesis", "grid", "a", "b"):
        if any(re.search(rf"outputs/{name}\b", text) for _, text in blocks):
            synthetic.write_experiment(Path("outputs") / name, protocols=protocols)
    if any("results/leaderboard" in text for _, text in blocks):
        # A copy: a report is written into the folder of its study.
        shutil.copytree(ROOT / "results/leaderboard", "results/leaderboard")
    if any("vehicle=mine" in text for _, text in blocks):
        identified = (ROOT / "conf/vehicle/bolt.yaml").read_text(encoding="utf-8")
        Path("conf/vehicle").mkdir(parents=True)
        Path("conf/vehicle/mine.yaml").write_text(identified.replace("name: bolt\n", "name: mine\n", 1))
    Path("paper.yaml").write_text("format: md\n")
    names: dict[str, Any] = {"Metric": Metric, "observation": np.zeros((1, 19), np.float32)}
    sheet = Path("conf/vehicle/polyu.yaml")
    for kind, text in blocks:
        if kind == "python":
            exec(compile(with_ids(text), page.name, "exec"), names)
        elif kind == "auvbench":
            run(text)
            if sheet.exists():
                shutil.copy(ROOT / "examples/polyu.yaml", sheet)  # as the page asks the reader to


@pytest.mark.long
@pytest.mark.slow
def test_the_commands_of_the_example_of_a_team_run(
    small: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(ROOT / "examples/team", tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(replay_pictures, "LONGEST", 10)
    for kind, text in steps(tmp_path / "README.md"):
        assert kind == "auvbench"
        run(text)
    agents = pd.read_csv("outputs/team/report/table.csv")["agent"]
    assert sorted(agents) == ["PID", "PPO"]
    assert Path("team.gif").read_bytes().startswith(b"GIF89a")


def test_what_is_not_run_is_named_and_counted() -> None:
    unused = [pattern for pattern in NOT_RUN if not any(re.search(pattern, text) for _, text, _ in BLOCKS)]
    assert unused == []
    not_run = sum(why is not None for *_, why in BLOCKS)
    assert {"run": len(BLOCKS) - not_run, "not run": not_run} == COUNTS
